"""L fig. 3.4: rms error of the reconstructions against the resolution of the table.

    python experiments/lalonde_figure_3_4.py [--out FOLDER]

Reference tables are sub-sampled and reconstructed at the reference's own directions.  References
are those of the figure: the measured sawtooth, 15 polar angles by 30 azimuths for either direction,
and the measured velvet, 15 samples in each angle (``lalonde_micro_geometry``).  The figure's values
are not printed in the thesis; its text says that linear interpolation does well throughout, that
the interpolating cubic oscillates and is a poor choice, and that B-splines have low errors.  Beside
them tables without noise: an analytic sawtooth, Phong's lobe of exponent 30, an anisotropic Ward
and a microfacet.  Errors are shares of the reference's rms over its samples; in brackets those of
rho cos t_i cos t_r over solid angles, the light that is seen, since the last three grow without
bound at grazing and there rho itself has no rms to speak of.  At full resolution all but the
B-spline pass through the samples.  Draws ``lalonde_figure_3_4.png`` of the latter.
"""

import argparse
from pathlib import Path

import jax
import numpy as np
from lalonde_figure_3_1 import OUT, SAWTOOTH
from lalonde_micro_geometry import describe, measured, measured_brdf

from jaxrender.brdf import BRDF, Microfacet, Phong, Ward
from jaxrender.brdf.tables.cells import cell_weights
from jaxrender.brdf.tables.reconstruction import RECONSTRUCTIONS
from jaxrender.brdf.tables.tabulated import TabulatedBRDF
from jaxrender.geometry import POLAR

REFERENCE = (15, 30, 15, 30)
# Every fifth, every third and every sample of a reference: their cells have common centres.
DIVISORS = (5, 3, 1)
POLAR_ANGLES = [str(REFERENCE[0] // divisor) for divisor in DIVISORS]
ONE = np.ones(1)
# Size of the table, and paths for each exit direction: threads scatter more than ridges.
MEASURED = {"sawtooth": (REFERENCE, 512), "velvet": ((15, 15, 15, 15), 2048)}
ANALYTIC: dict[str, BRDF] = {
    "analytic sawtooth": SAWTOOTH,
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


def references() -> dict[str, TabulatedBRDF]:
    """The measured tables, then those of the analytic ones."""
    found = {}
    for name, (size, samples) in MEASURED.items():
        print(describe(measured(name, size, POLAR, samples)))
        found[name] = measured_brdf(name, size, POLAR, samples)
    analytic = {n: TabulatedBRDF.of(brdf, REFERENCE, POLAR) for n, brdf in ANALYTIC.items()}
    return {**found, **analytic}


def draw(found: dict[str, dict[str, list[float]]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(found), figsize=(4 * len(found), 3.6))
    for axis, (material, curves) in zip(axes, found.items(), strict=True):
        for name, curve in curves.items():
            axis.plot(POLAR_ANGLES, curve, marker="o", label=name)
        axis.set_title(material)
        axis.set_xlabel("polar angles")
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
    given = references()
    print(f"{'material':18s} {'samples':9s}" + "".join(f"{name:>18s}" for name in RECONSTRUCTIONS))
    drawn = {}
    for material, reference in given.items():
        drawn[material] = {name: [] for name in RECONSTRUCTIONS}
        for divisor in DIVISORS:
            row = errors(reference, divisor)
            size = f"{reference.size[0] // divisor} x {reference.size[1] // divisor}"
            print(
                f"{material:18s} {size:9s}"
                + "".join(f"{whole:10.4f} ({seen:.3f})" for whole, seen in row.values())
            )
            for name, (_, seen) in row.items():
                drawn[material][name].append(seen)
    draw(drawn, options.out / "lalonde_figure_3_4.png")


if __name__ == "__main__":
    main()
