"""T fig. 6.6: the roughness from a directional source in the recovered light.

    python experiments/figure_6_6.py [--samples 8000] [--lowest 0.5] [--out F.png]

The photographs of ``factorization_trial.py`` are factored by the nested method; in its light, which
is filtered by the lobe and cut at l* = 12, the region of the source is marked.  Beside it the mean
radiance around the peak, and beside that what a source of each sigma would show there.  Roughness
by T 6.25 as printed and corrected (ERRATA 48), against the truth: as printed; the truncated series
of exp(-sigma^2 l(l+1)) inverted, and the same of the lobe averaged over the views' exit angles.
"""

import argparse
from pathlib import Path

import factorization_trial as trials
import jax
import matplotlib.pyplot as plt
import numpy as np
from scipy.special import eval_legendre

from jaxrender.geometry import angles_from_direction
from jaxrender.harmonics import LatLongGrid, degree_table, synthesise
from jaxrender.inverse.factorization.nested import BAND_LIMIT
from jaxrender.inverse.factorization.roughness import Filter, SourceRoughness, lobe_filter
from jaxrender.pipelines.report.display import tone_key, tone_mapped

ROWS = 128


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=8000)
    parser.add_argument("--lowest", type=float, default=0.5, help="lowest exit cosine")
    parser.add_argument("--out", type=Path, default=Path("experiments/out/figure_6_6.png"))
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    trial = trials.nested_trial(arguments.samples, arguments.lowest)
    nested = trial.nested
    seen = lobe_filter(nested.brdf(0.1), BAND_LIMIT, trial.gram.nodes, trial.gram.counts)
    plain, averaged = nested.roughness(), nested.roughness(filtered_by=seen)
    truth = round(float(trials.MATERIAL.sigma), 6)
    source = np.asarray(trials.SOURCE.directions)[0]
    off = np.degrees(np.arccos(min(1.0, float(plain.direction @ source))))
    print(f"source found {off:.2f} degrees off; region of {np.degrees(plain.radius):.1f} degrees")
    print(
        f"L_cen {plain.centre:.4f}, L_tot {plain.total:.4f}, at the region's edge {plain.rim:.4f}"
    )
    values = {"printed": plain.printed, "corrected": plain.sigma, "lobe": averaged.sigma}
    print(f"{'sigma':10s} {'value':>7s} {'off by':>8s}   (truth {truth})")
    for name, value in values.items():
        print(f"{name:10s} {value:7.4f} {100 * (value / truth - 1):+7.1f} %")
    draw(nested.light, averaged, seen, values, arguments.out)


def draw(
    light: np.ndarray, found: SourceRoughness, seen: Filter, values: dict[str, float], out: Path
):
    """Draw the light with its region, and the radiance around the peak."""
    grid = LatLongGrid(ROWS, 2 * ROWS)
    lit = np.maximum(np.asarray(synthesise(grid, light)), 0)
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(11, 3.6), layout="constrained", gridspec_kw={"width_ratios": [2, 1.2]}
    )
    extent = (0, 360, 180, 0)
    left.imshow(tone_mapped(lit, tone_key(lit)), extent=extent)
    azimuth, polar = np.meshgrid((np.arange(2 * ROWS) + 0.5) * 180 / ROWS, _polar(ROWS))
    towards = grid.directions() @ found.direction
    left.contour(azimuth, polar, towards, levels=[np.cos(found.radius)], colors="red")
    peak = [np.degrees(float(one)) for one in angles_from_direction(found.direction)]
    left.plot(peak[1], peak[0], "r+")
    left.set(xlabel="azimuth, degrees", ylabel="polar angle, degrees")
    left.set_title(
        f"recovered light; in the region L_cen {found.centre:.2f}, L_tot {found.total:.3f}"
    )
    _draw_profiles(right, light, found, seen, values)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)
    print(f"picture: {out}")


def _draw_profiles(
    axes, light: np.ndarray, found: SourceRoughness, seen: Filter, values: dict[str, float]
):
    degree = np.arange(BAND_LIMIT + 1)
    angles = np.linspace(0, 1.5 * found.radius, 200)
    polynomials = eval_legendre(degree[None, :], np.cos(angles)[:, None])
    edge = eval_legendre(degree, np.cos(found.radius))
    grey = light.mean(axis=1, keepdims=True)
    around = np.asarray(degree_table(grey, found.direction[None]))[0, :, 0]
    axes.plot(np.degrees(angles), polynomials @ around, "k", label="recovered, mean over azimuth")
    truth = round(float(trials.MATERIAL.sigma), 6)
    for name, sigma in (
        (f"source of sigma {truth}, the truth", truth),
        ("source, found", found.sigma),
    ):
        source = seen(sigma) * (2 * degree + 1)
        scale = (found.centre - found.rim) / (source.sum() - source @ edge)
        shape = scale * (polynomials @ source - source @ edge) + found.rim
        axes.plot(np.degrees(angles), shape, "--", label=name)
    axes.axvline(np.degrees(found.radius), color="red", lw=0.8)
    axes.set(xlabel="degrees from the peak", ylabel="radiance")
    axes.set_title(
        f"sigma {truth}: " + ", ".join(f"{name} {value:.4f}" for name, value in values.items()),
        fontsize=9,
    )
    axes.legend(fontsize=7)


def _polar(rows: int) -> np.ndarray:
    return (np.arange(rows) + 0.5) * 180 / rows


if __name__ == "__main__":
    main()
