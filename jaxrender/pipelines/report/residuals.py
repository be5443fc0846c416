"""Residuals against exit angle, half angle and normal: where a wrong model shows.

At grazing exit the specular model, the geometry or the shadows are wrong; at small half angles the
shape of the lobe is; over the normals the light is.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes

from jaxrender.inverse import KnownLight
from jaxrender.inverse.conditioning import GRAZING_COSINE
from jaxrender.inverse.intervals import NORMAL_90
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.passes import Stop
from jaxrender.lighting import DirectionalSources
from jaxrender.pipelines.report.contents import MaterialContents
from jaxrender.pipelines.report.plots import INK, MUTED, SERIES, plot
from jaxrender.shapes import Float

_BINS = 14
# Fewer residuals than this have no 5th percentile to speak of.
_FEWEST = 40
_PERCENTILES = (5, 50, 95)
# Cells of the sphere of normals, all of one area, and the fewest residuals that one shows.
_ROWS, _COLUMNS, _FEWEST_IN_CELL = 12, 24, 5
# Beyond this half angle (degrees) no lobe is left.
_WIDEST_HALF = 60.0


class Bins(NamedTuple):
    """Bins of an angle in degrees, with three percentiles of the values in each."""

    angles: Float[np.ndarray, "bin"]
    low: Float[np.ndarray, "bin"]
    middle: Float[np.ndarray, "bin"]
    high: Float[np.ndarray, "bin"]


class ResidualPlots(NamedTuple):
    """Residuals in noise standard deviations, relative to the prediction, by angle and normal.

    ``by_half_angle`` is None where no source has a direction.
    """

    in_noise: Markup
    relative: Markup
    by_half_angle: Markup | None
    by_normal: Markup


class _Left(NamedTuple):
    """What the final fit leaves of the samples that it counts, and the prediction."""

    observations: Observations
    predicted: Float[np.ndarray, "sample channel"]
    residual: Float[np.ndarray, "sample channel"]
    in_noise: Float[np.ndarray, "sample channel"]


def residual_plots(contents: MaterialContents) -> ResidualPlots | None:
    """Plot photograph - prediction of the samples of the final fit, all channels together."""
    left = _left(contents.fit.final)
    normals, outgoing = (np.asarray(array, float) for array in left.observations.samples)
    exit_angles = _degrees(np.sum(normals * outgoing, axis=1))
    in_noise = binned(exit_angles, left.in_noise)
    if not len(in_noise.angles):
        return None
    scale = float(np.abs(left.predicted).mean())
    least = np.maximum(left.predicted, 1e-2 * max(scale, 1e-300))
    relative = binned(exit_angles, 100 * left.residual / least)
    worst, percent = (float(np.max(np.abs(bins.middle))) for bins in (in_noise, relative))
    split = contents.fit.light.split
    half = half_angles(left.observations, contents.light, split and split.sources)
    return ResidualPlots(
        plot(
            "residual-noise",
            f"Residual against exit angle: medians within {worst:.2g} noise standard deviations.",
            lambda axes: _paint_noise(axes, in_noise, _paint_exit),
        ),
        plot(
            "residual-relative",
            f"Relative residual against exit angle: medians within {percent:.2g} per cent.",
            lambda axes: _paint_relative(axes, relative),
        ),
        None if half is None else _half_angle_plot(half, left.in_noise),
        _normal_plot(normals, left.in_noise),
    )


def half_angles(
    observations: Observations, light: KnownLight, taken: DirectionalSources | None = None
) -> Float[np.ndarray, "sample"] | None:
    """Compute each sample's least angle, in degrees, between normal and a half vector.

    Sources are those of the light and those ``taken`` out of its environment.  NaN: the sample
    faces none.  None: there is none at all.
    """
    normals, outgoing = (np.asarray(array, float) for array in observations.samples)
    found, frames = np.full(len(normals), np.nan), np.asarray(observations.frame)
    for frame in np.unique(frames):
        own = np.asarray(light.sources_of(int(frame)).directions, float).reshape(-1, 3)
        also = np.zeros((0, 3)) if taken is None else np.asarray(taken.directions, float)
        here, sources = frames == frame, np.concatenate([own, also])
        if not len(sources):
            continue
        half = outgoing[here][:, None] + sources
        half /= np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-12)
        cosines = np.einsum("sj,skj->sk", normals[here], half)
        cosines = np.where(normals[here] @ sources.T > 0, cosines, -np.inf).max(axis=1)
        found[here] = np.where(np.isfinite(cosines), _degrees(cosines), np.nan)
    return found if np.isfinite(found).any() else None


def _left(stop: Stop) -> _Left:
    # Samples that a mended camera does not see stand for no pixel.
    seen = stop.observations.pixels > 0
    predicted = np.asarray(stop.fit.predicted, float)[seen]
    residual = np.asarray(stop.data.radiance, float)[seen] - predicted
    least = 1e-9 * max(float(np.abs(predicted).mean()), 1e-300)
    noise = np.asarray(stop.noise.standard_deviation(np.maximum(predicted, 0)), float)
    in_noise = residual / np.maximum(noise, least)
    return _Left(stop.observations.take(np.flatnonzero(seen)), predicted, residual, in_noise)


def _degrees(cosines: Float[np.ndarray, "sample"]) -> Float[np.ndarray, "sample"]:
    return np.degrees(np.arccos(np.clip(cosines, -1, 1)))


def _half_angle_plot(
    angles: Float[np.ndarray, "sample"], in_noise: Float[np.ndarray, "sample channel"]
) -> Markup | None:
    """Plot residuals by half angle; None where too few samples are near enough to a source."""
    near = angles < _WIDEST_HALF
    if np.count_nonzero(near) * in_noise.shape[1] < _FEWEST:
        return None
    bins = binned(angles[near], in_noise[near])
    if not len(bins.angles):
        return None
    worst = float(np.max(np.abs(bins.middle)))
    return plot(
        "residual-half-angle",
        f"Residual against half angle: medians within {worst:.2g} noise standard deviations.",
        lambda axes: _paint_noise(axes, bins, _paint_half),
    )


def _normal_plot(
    normals: Float[np.ndarray, "sample 3"], in_noise: Float[np.ndarray, "sample channel"]
) -> Markup:
    """Plot the mean residual over the sphere of normals."""
    cells = normal_cells(normals, in_noise)
    limit = max(1.0, float(np.nanpercentile(np.abs(cells), 98)) if np.isfinite(cells).any() else 0)

    def paint(axes: Axes) -> None:
        shown = axes.imshow(
            cells,
            cmap="RdBu_r",
            vmin=-limit,
            vmax=limit,
            extent=(0, 360, -1, 1),
            aspect="auto",
            interpolation="nearest",
        )
        axes.grid(visible=False)
        axes.set_xticks([0, 90, 180, 270, 360])
        axes.set_xlabel("azimuth of the normal [degrees]")
        axes.set_ylabel("height of the normal (z)")
        figure = axes.figure
        bar = figure.colorbar(shown, ax=axes, pad=0.02)
        bar.outline.set_visible(False)

    return plot(
        "residual-normal",
        f"Mean residual over the sphere of normals: within {limit:.2g} noise standard deviations "
        "in nearly all cells.",
        paint,
    )


def normal_cells(
    normals: Float[np.ndarray, "sample 3"], values: Float[np.ndarray, "sample channel"]
) -> Float[np.ndarray, "row column"]:
    """Average values over cells of one area of the sphere; NaN where a cell has too few.

    The first row is at the zenith, the first column begins at azimuth 0.
    """
    rows = np.minimum((_ROWS * (1 - normals[:, 2]) / 2).astype(int), _ROWS - 1)
    azimuth = np.arctan2(normals[:, 1], normals[:, 0]) % (2 * np.pi)
    columns = np.minimum((_COLUMNS * azimuth / (2 * np.pi)).astype(int), _COLUMNS - 1)
    cell = rows.clip(0) * _COLUMNS + columns
    count = np.bincount(cell, minlength=_ROWS * _COLUMNS)
    total = np.bincount(cell, values.mean(axis=1), minlength=_ROWS * _COLUMNS)
    mean = np.where(count < _FEWEST_IN_CELL, np.nan, total / np.maximum(count, 1))
    return mean.reshape(_ROWS, _COLUMNS)


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


def _paint_noise(axes: Axes, bins: Bins, paint_angles: Callable[[Axes, float], None]) -> None:
    for level in (-NORMAL_90, NORMAL_90):
        axes.axhline(level, color=INK, linewidth=0.9, linestyle=(0, (4, 3)))
    paint_angles(axes, _paint(axes, bins, 2 * NORMAL_90))
    axes.set_ylabel("residual [noise standard deviations]")


def _paint_relative(axes: Axes, bins: Bins) -> None:
    _paint_exit(axes, _paint(axes, bins, 0.1))
    axes.set_ylabel("residual [% of the prediction]")


def _paint(axes: Axes, bins: Bins, least: float) -> float:
    """Paint the band and its median; return how far the axis reaches."""
    axes.axhline(0, color=INK, linewidth=0.8)
    axes.fill_between(bins.angles, bins.low, bins.high, color=SERIES[0], alpha=0.22, linewidth=0)
    axes.plot(bins.angles, bins.middle, color=SERIES[0], marker="o", markersize=3)
    reach = 1.15 * max(least, float(np.abs([bins.low, bins.high]).max()))
    axes.set_ylim(-reach, reach)
    return reach


def _paint_exit(axes: Axes, reach: float) -> None:
    axes.set_xlim(0, 90)
    axes.set_xticks([0, 15, 30, 45, 60, 75, 90])
    axes.set_xlabel("exit angle [degrees]: 0 is head-on, 90 is edge-on")
    grazing = float(np.degrees(np.arccos(GRAZING_COSINE)))
    axes.axvline(grazing, color=MUTED, linewidth=0.9, linestyle=(0, (1.5, 2)))
    axes.text(grazing + 1, 0.95 * reach, "grazing →", color=MUTED, va="top")


def _paint_half(axes: Axes, _: float) -> None:
    axes.set_xlim(0, _WIDEST_HALF)
    axes.set_xlabel("half angle to the nearest highlight [degrees]: 0 is its centre")
