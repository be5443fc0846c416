"""The two measured materials of L 3.3.2, a sawtooth and a velvet; shared by scripts.

    python experiments/lalonde_micro_geometry.py [--material sawtooth] [--size 15 30 15 30]
        [--embedding polar] [--samples 256]

Each is measured by the virtual gonioreflectometer with at most four reflections, and kept in
``out/`` with its standard errors.  L gives neither dimensions nor colours nor numbers of paths.
The sawtooth is one Lambertian tooth, which is all of them: red to -x, blue to +x, 45 degrees.  The
velvet is 500 threads that lean to +x, glossy along their sides and diffuse where they were cut:
the library's threads are cut level, so that glossy ends would be so many small horizontal mirrors,
19 % of the area and a highlight of their own (``lalonde_figure_3_3`` shows both).
"""

import argparse
import time

import jax
import numpy as np
from lalonde_figure_3_2 import BLUE, OUT, RED

from jaxrender.brdf import BRDF, Lambertian, Phong, TabulatedBRDF, masked
from jaxrender.geometry import EMBEDDINGS, NUSSELT, Embedding
from jaxrender.geometry.height_fields import Patch, sawtooth, velvet
from jaxrender.io.tables import BRDFTable, read_table, write_table
from jaxrender.reflection.tracing import Gonioreflectometer, MeasureSettings

Size = tuple[int, int, int, int]

BASE = Lambertian(np.array([0.10, 0.01, 0.02]) / np.pi)
THREAD = Phong(np.array([0.45, 0.05, 0.08]) / np.pi, np.full(3, 0.15), 10.0)
CUT_END = Lambertian(np.array([0.45, 0.05, 0.08]) / np.pi)


def ridges(teeth: int = 1) -> tuple[Patch, list[BRDF]]:
    """The sawtooth: paths are spread better over one tooth than over some, the BRDF is the same."""
    return sawtooth(teeth), [RED, BLUE]


def threads(diffuse_ends: bool = True) -> tuple[Patch, list[BRDF]]:
    """The velvet, the threads' cut ends a material of their own."""
    patch = velvet(500, 0.25, 0.012, 0.35)
    level = patch.mesh.face_normals()[:, 2] > 1 - 1e-9
    ends = level & (patch.material == 1)
    material = np.where(ends, 2, patch.material)
    ends_brdf = CUT_END if diffuse_ends else THREAD
    return patch._replace(material=material), [BASE, THREAD, ends_brdf]


MATERIALS = {
    "sawtooth": ridges,
    "velvet": threads,
    "velvet, glossy ends": lambda: threads(diffuse_ends=False),
}


def meter(material: str) -> Gonioreflectometer:
    """The material on the bench."""
    return Gonioreflectometer.of(*MATERIALS[material]())


def measured(
    material: str, size: Size, embedding: Embedding = NUSSELT, samples: int = 256
) -> BRDFTable:
    """Measure, or read what was measured before; ``samples`` paths for each exit direction."""
    cells = "x".join(str(n) for n in size)
    stem = material.replace(", ", "_").replace(" ", "_")
    path = OUT / f"lalonde_{stem}_{embedding.name}_{cells}_{samples}.nc"
    if path.exists():
        return read_table(path)
    start = time.perf_counter()
    found = meter(material).measure(MeasureSettings(size, embedding, samples))
    about = {
        "material": material,
        "samples": samples,
        "seconds": round(time.perf_counter() - start, 1),
    }
    OUT.mkdir(exist_ok=True)
    values, errors = (part.astype(np.float32) for part in found)
    write_table(path, BRDFTable(values, errors, embedding, 0, about))
    return read_table(path)


def extended(table: BRDFTable) -> np.ndarray:
    """The values, cells that are no direction filled from the nearest that is one."""
    values = table.values.astype(float)
    covered = [
        np.asarray(table.embedding.covers(table.embedding.centres(ends)))
        for ends in (values.shape[:2], values.shape[2:4])
    ]
    values[~covered[0]] = np.nan
    values[:, :, ~covered[1]] = np.nan
    return np.asarray(masked(values).values)


def measured_brdf(
    material: str,
    size: Size,
    embedding: Embedding = NUSSELT,
    samples: int = 256,
    reconstruction: str = "linear",
) -> TabulatedBRDF:
    """The same as a BRDF that can be rendered with."""
    table = measured(material, size, embedding, samples)
    return TabulatedBRDF(extended(table), embedding, reconstruction)


def relative_error(table: BRDFTable) -> float:
    """Mean standard error over mean value."""
    assert table.standard_errors is not None
    return float(table.standard_errors.mean() / table.values.mean())


def describe(table: BRDFTable) -> str:
    """One line: size, embedding, paths, time, noise."""
    cells, about = " x ".join(str(n) for n in table.values.shape[:4]), table.about
    return (
        f"{about['material']}, {cells}, {table.embedding.name}, {about['samples']} paths an exit "
        f"direction, {about['seconds']} s: mean {table.values.mean():.4f} 1/sr, mean standard "
        f"error {relative_error(table):.2%} of it"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--material", choices=MATERIALS, default="sawtooth")
    parser.add_argument("--size", type=int, nargs=4, default=(15, 30, 15, 30))
    parser.add_argument("--embedding", choices=EMBEDDINGS, default="polar")
    parser.add_argument("--samples", type=int, default=256)
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    embedding = EMBEDDINGS[asked.embedding]
    print(describe(measured(asked.material, tuple(asked.size), embedding, asked.samples)))


if __name__ == "__main__":
    main()
