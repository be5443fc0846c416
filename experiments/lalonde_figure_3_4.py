"""L fig. 3.4: rms error of the reconstructions against the resolution of the table.

    python experiments/lalonde_figure_3_4.py [--out FOLDER]

A reference table of 15 polar angles by 30 azimuths for either direction, as the sawtooth's in L
3.3.3, is sub-sampled and reconstructed at the reference's own directions.  The figure's values are
not printed in the thesis; its text says that linear interpolation does well throughout, that the
interpolating cubic oscillates and is a poor choice, and that B-splines have low errors.  Materials:
an analytic sawtooth, Phong's lobe of exponent 30, an anisotropic Ward and a microfacet.  ``errors``
takes any reference table, so a measured one too.  Errors are shares of the reference's rms over its
samples; in brackets those of rho cos t_i cos t_r over solid angles, the light that is seen, since
the last three grow without bound at grazing and there rho itself has no rms to speak of.  Draws
``lalonde_figure_3_4.png`` of the latter.
"""

import argparse
from pathlib import Path

import jax
import numpy as np
from lalonde_figure_3_1 import OUT, SAWTOOTH

from jaxrender.brdf import BRDF, Microfacet, Phong, Ward
from jaxrender.brdf.reconstruction import RECONSTRUCTIONS
from jaxrender.brdf.table_cells import cell_weights
from jaxrender.brdf.tabulated import TabulatedBRDF
from jaxrender.geometry import POLAR

REFERENCE = (15, 30, 15, 30)
# Every fifth, every third and every sample of a reference: their cells have common centres.
DIVISORS = (5, 3, 1)
ONE = np.ones(1)
MATERIALS: dict[str, BRDF] = {
    "sawtooth": SAWTOOTH,
    "Phong 30": Phong(0.05 * ONE, 0.3 * ONE, 30.0),
    "Ward .3 .6": Ward(0.05 * ONE, 0.3 * ONE, 0.3, 0.6),
    "microfacet .3": Microfacet(0.05 * ONE, 0.3 * ONE, 0.3, 1.5),
}


def subsampled(reference: TabulatedBRDF, divisor: int) -> np.ndarray:
    """Every ``divisor``-th sample of each axis, an odd number: the middle ones of its cells."""
    middle = slice(divisor // 2, None, divisor)
    return np.asarray(reference.values)[middle, middle, middle, middle]


def errors(reference: TabulatedBRDF, divisor: int) -> dict[str, tuple[float, float]]:
    """Relative rms error of each reconstruction at the reference's samples: rho, light seen."""
    found = {}
    values = np.asarray(reference.values, float)
    cosines = reference.embedding.cell_directions(reference.size[:2])[..., 2]
    # A projected solid angle holds one of the cosines' three powers.
    weights = cosines * cell_weights(reference.embedding, reference.size[:2])
    light = weights[..., None, None, None] * weights[..., None]
    for name in RECONSTRUCTIONS:
        coarse = TabulatedBRDF(subsampled(reference, divisor), reference.embedding, name)
        squares = (np.asarray(coarse.resampled(reference.size).values) - values) ** 2
        found[name] = (
            _share(squares, values**2),
            _share(light * squares, light * values**2),
        )
    return found


def _share(squares: np.ndarray, whole: np.ndarray) -> float:
    return float(np.sqrt(squares.mean() / whole.mean()))


def draw(found: dict[str, dict[str, list[float]]], sizes: list[str], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(found), figsize=(4 * len(found), 3.6))
    for axis, (material, curves) in zip(axes, found.items(), strict=True):
        for name, curve in curves.items():
            axis.plot(sizes, curve, marker="o", label=name)
        axis.set_title(material)
        axis.set_xlabel("polar angles x azimuths")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("relative rms error of rho cos cos")
    axes[0].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=90)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    options.out.mkdir(parents=True, exist_ok=True)
    sizes = [f"{REFERENCE[0] // d} x {REFERENCE[1] // d}" for d in DIVISORS]
    print(f"{'material':15s} {'samples':9s}" + "".join(f"{name:>18s}" for name in RECONSTRUCTIONS))
    drawn = {}
    for material, brdf in MATERIALS.items():
        reference = TabulatedBRDF.of(brdf, REFERENCE, POLAR)
        drawn[material] = {name: [] for name in RECONSTRUCTIONS}
        for size, divisor in zip(sizes, DIVISORS, strict=True):
            row = errors(reference, divisor)
            print(
                f"{material:15s} {size:9s}"
                + "".join(f"{whole:10.4f} ({seen:.3f})" for whole, seen in row.values())
            )
            for name, (_, seen) in row.items():
                drawn[material][name].append(seen)
    draw(drawn, sizes, options.out / "lalonde_figure_3_4.png")


if __name__ == "__main__":
    main()
