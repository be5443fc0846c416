"""Residuals against the exit angle: a wrong model shows at grazing angles."""

from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes

from jaxrender.inverse.conditioning import GRAZING_COSINE
from jaxrender.inverse.passes import Stop
from jaxrender.pipelines.report.plots import INK, MUTED, SERIES, plot
from jaxrender.shapes import Float

_BINS = 14
# Fewer residuals than this have no 5th percentile to speak of.
_FEWEST = 40
_PERCENTILES = (5, 50, 95)
# Where the 5th and 95th percentile of a normal distribution lie.
_NORMAL_90 = 1.645


class Bins(NamedTuple):
    """Bins of the exit angle in degrees, with three percentiles of the values in each."""

    angles: Float[np.ndarray, "bin"]
    low: Float[np.ndarray, "bin"]
    middle: Float[np.ndarray, "bin"]
    high: Float[np.ndarray, "bin"]


class ResidualPlots(NamedTuple):
    """Residuals in noise standard deviations, and relative to the prediction."""

    in_noise: Markup
    relative: Markup


def residual_plots(stop: Stop) -> ResidualPlots | None:
    """Plot photograph - prediction of the samples of the final fit, all channels together."""
    # Samples that a mended camera does not see stand for no pixel.
    seen = stop.observations.pixels > 0
    predicted = np.asarray(stop.fit.predicted, float)[seen]
    residual = np.asarray(stop.data.radiance, float)[seen] - predicted
    normals, outgoing = (np.asarray(array, float)[seen] for array in stop.observations.samples)
    cosines = np.sum(normals * outgoing, axis=1)
    angles = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    scale = float(np.abs(predicted).mean())
    noise = np.asarray(stop.noise.standard_deviation(np.maximum(predicted, 0)), float)
    in_noise = binned(angles, residual / np.maximum(noise, 1e-9 * max(scale, 1e-300)))
    relative = binned(angles, 100 * residual / np.maximum(predicted, 1e-2 * max(scale, 1e-300)))
    if not len(in_noise.angles):
        return None

    def paint_in_noise(axes: Axes) -> None:
        for level in (-_NORMAL_90, _NORMAL_90):
            axes.axhline(level, color=INK, linewidth=0.9, linestyle=(0, (4, 3)))
        _paint(axes, in_noise, 2 * _NORMAL_90)
        axes.set_ylabel("residual [noise standard deviations]")

    def paint_relative(axes: Axes) -> None:
        _paint(axes, relative, 0.1)
        axes.set_ylabel("residual [% of the prediction]")

    worst = float(np.max(np.abs(in_noise.middle)))
    return ResidualPlots(
        plot(
            "residual-noise",
            f"Residual against exit angle: medians within {worst:.2g} noise standard deviations.",
            paint_in_noise,
        ),
        plot(
            "residual-relative",
            "Relative residual against exit angle: medians within "
            f"{np.max(np.abs(relative.middle)):.2g} per cent.",
            paint_relative,
        ),
    )


def binned(
    angles: Float[np.ndarray, "sample"], values: Float[np.ndarray, "sample channel"]
) -> Bins:
    """Take percentiles in equal steps of the angle, leaving out bins with too few values."""
    edges = np.linspace(angles.min(), np.nextafter(angles.max(), np.inf), _BINS + 1)
    index = np.clip(np.searchsorted(edges, angles, side="right") - 1, 0, _BINS - 1)
    rows = []
    for number in range(_BINS):
        inside = values[index == number].ravel()
        if inside.size >= _FEWEST:
            centre = float(np.mean(angles[index == number]))
            rows.append([centre, *np.percentile(inside, _PERCENTILES)])
    return Bins(*np.array(rows, float).reshape(-1, 4).T)


def _paint(axes: Axes, bins: Bins, least: float) -> None:
    axes.axhline(0, color=INK, linewidth=0.8)
    axes.fill_between(bins.angles, bins.low, bins.high, color=SERIES[0], alpha=0.22, linewidth=0)
    axes.plot(bins.angles, bins.middle, color=SERIES[0], marker="o", markersize=3)
    reach = 1.15 * max(least, float(np.abs([bins.low, bins.high]).max()))
    axes.set_xlim(0, 90)
    axes.set_ylim(-reach, reach)
    axes.set_xticks([0, 15, 30, 45, 60, 75, 90])
    axes.set_xlabel("exit angle [degrees]: 0 is head-on, 90 is edge-on")
    grazing = float(np.degrees(np.arccos(GRAZING_COSINE)))
    axes.axvline(grazing, color=MUTED, linewidth=0.9, linestyle=(0, (1.5, 2)))
    axes.text(grazing + 1, 0.95 * reach, "grazing →", color=MUTED, va="top")
