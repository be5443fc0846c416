"""Plots of what the library hands out: lights, BRDFs, estimates (``jaxrender.plot``).

It is a function and no method of theirs, because those classes live below the level where plots may
be made: a light knows nothing of matplotlib, and whoever has no use for plots never loads it.
``notebook`` shows the same pictures without being asked.
"""

import io
from functools import singledispatch
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from jaxrender.brdf import BRDF
from jaxrender.harmonics import LatLongGrid
from jaxrender.imaging.display import as_rgb, exposed, exposure_for
from jaxrender.inverse import Estimate
from jaxrender.lighting import DirectionalSources, Environment, Light
from jaxrender.lighting.function import FunctionLight
from jaxrender.pipelines.report.display import tone_key, tone_mapped
from jaxrender.shapes import Float

# Rows of the picture of a light, and of the slice of a BRDF.
_ROWS, _CELLS = 128, 90
# The exposure of a slice is that of angles up to this, in degrees.
_RIM = 80.0
# Darkness below this part of the mean does not brighten the rest of a picture.
_DARKEST = 0.3
# More point masses than this are drawn as radiance of the cells that they fall into.
_FEW = 256
# Degrees of incidence of the curves of a lobe.
_INCIDENT = (10.0, 45.0, 70.0)
# The curves' scale spans so many powers of ten below the largest value.
_DECADES = 4


def plot(thing: Any, axes: Axes | None = None) -> Axes:
    """Draw a light, a BRDF or an estimate, and return its matplotlib axes.

    A light is a panorama with its sources as circles.  A BRDF is its lobe in the plane of incidence
    [1/sr]; in a figure of its own the slice of half and difference angles stands beside it.  An
    estimate is its numbers with their 90 % intervals, relative to their values.  Without ``axes`` a
    new figure is made (``axes.figure``).  Raises ``TypeError`` for anything else.
    """
    if isinstance(thing, BRDF) and axes is None:
        figure = Figure(figsize=(9.0, 3.6), layout="constrained")
        lobe, beside = figure.subplots(1, 2)
        plot_slice(thing, beside)
        return _drawn(thing, lobe)
    return _drawn(thing, _new_axes() if axes is None else axes)


def png_of_plot(thing: Any) -> bytes:
    """Draw it in a figure of its own, as the bytes of a PNG file."""
    stream = io.BytesIO()
    figure = plot(thing).figure
    assert isinstance(figure, Figure)
    figure.savefig(stream, format="png", dpi=100)
    return stream.getvalue()


def plot_slice(brdf: BRDF, axes: Axes) -> Axes:
    """Draw the slice of half angles (across) and difference angles (up), at a quarter turn.

    It shows the colours of rho in sRGB, one exposure for all.
    """
    degrees = (np.arange(_CELLS) + 0.5) * 90 / _CELLS
    half, difference = np.radians(np.meshgrid(degrees, degrees[::-1]))
    about = np.stack([np.sin(half), 0 * half, np.cos(half)], axis=-1)
    # A difference vector a quarter turn aside lies across the plane of normal and half vector.
    across = np.stack([0 * half, np.ones_like(half), 0 * half], axis=-1)
    part = np.sin(difference)[..., None] * across
    incoming, outgoing = (np.cos(difference)[..., None] * about + sign * part for sign in (1, -1))
    rho = np.asarray(brdf.evaluate(incoming.reshape(-1, 3), outgoing.reshape(-1, 3)), float)
    rho = rho.reshape(_CELLS, _CELLS, -1)
    # Models without masking grow without bound towards the rim, which would darken all the rest.
    inside = np.maximum(half, difference) < np.radians(_RIM)
    colours = exposed(as_rgb(np.maximum(rho, 0)), exposure_for(rho[inside])) / 255.0
    axes.imshow(colours, extent=(0, 90, 0, 90))
    axes.set(
        title="slice at a quarter turn",
        xlabel="half angle [degrees]",
        ylabel="difference angle [degrees]",
    )
    return axes


@singledispatch
def _drawn(thing: Any, axes: Axes) -> Axes:
    """Draw what has a picture of its own."""
    as_png = getattr(thing, "_repr_png_", None)
    if as_png is None:
        raise TypeError(
            f"a {type(thing).__name__} has no plot; give a light, a BRDF, or what a fit returns"
        )
    axes.imshow(np.asarray(Image.open(io.BytesIO(as_png()))))
    axes.set_axis_off()
    return axes


@_drawn.register
def _light(light: Light, axes: Axes) -> Axes:
    """Draw a panorama: azimuth to the right, the zenith at the top."""
    image = np.zeros((_ROWS, 2 * _ROWS, 3))
    directions, energies = [np.zeros((0, 3))], [np.zeros(0)]
    for part in light.parts:
        few = _few_sources(part)
        if few is None:
            image = image + as_rgb(_radiance(part))
        else:
            directions.append(few[0])
            energies.append(few[1])
    lit = np.maximum(image, 0)
    axes.imshow(tone_mapped(lit, tone_key(lit, _DARKEST)), extent=(0, 360, -90, 90))
    towards, energy = np.concatenate(directions), np.concatenate(energies)
    if len(energy):
        azimuth = np.degrees(np.arctan2(towards[:, 1], towards[:, 0])) % 360
        elevation = np.degrees(np.arcsin(np.clip(towards[:, 2], -1, 1)))
        size = 20 + 200 * np.abs(energy) / max(float(np.abs(energy).max()), 1e-30)
        axes.scatter(
            azimuth, elevation, s=size, facecolors="none", edgecolors="tab:orange", clip_on=False
        )
    axes.set(xlabel="azimuth [degrees]", ylabel="elevation [degrees]")
    axes.set_xticks(range(0, 361, 90))
    axes.set_yticks(range(-90, 91, 45))
    return axes


def _few_sources(
    light: Light,
) -> tuple[Float[np.ndarray, "source 3"], Float[np.ndarray, "source"]] | None:
    """Directions and mean irradiance of a few sources; None for light that fills the sphere."""
    if isinstance(light, Environment | FunctionLight):
        return None
    directions, irradiance = (np.asarray(part, float) for part in light.nodes())
    if len(directions) > _FEW and not isinstance(light, DirectionalSources):
        return None
    return directions, irradiance.mean(axis=1)


def _radiance(light: Light) -> Float[np.ndarray, "row column channel"]:
    """The radiance of the picture's texels."""
    grid = LatLongGrid(_ROWS, 2 * _ROWS)
    directions = grid.directions().reshape(-1, 3)
    if isinstance(light, FunctionLight):
        return np.asarray(light.radiance(directions), float).reshape(_ROWS, 2 * _ROWS, -1)
    if isinstance(light, Environment):
        own = np.asarray(light.radiance, float)
        rows = ((np.arange(_ROWS) + 0.5) * own.shape[0] / _ROWS).astype(int)
        columns = ((np.arange(2 * _ROWS) + 0.5) * own.shape[1] / (2 * _ROWS)).astype(int)
        return own[rows][:, columns]
    towards, irradiance = (np.asarray(part, float) for part in light.nodes())
    row = np.arccos(np.clip(towards[:, 2], -1, 1)) / np.pi * _ROWS
    column = (np.arctan2(towards[:, 1], towards[:, 0]) / np.pi % 2) * _ROWS
    cell = np.minimum(row.astype(int), _ROWS - 1) * 2 * _ROWS
    cell += np.minimum(column.astype(int), 2 * _ROWS - 1)
    total = np.zeros((2 * _ROWS**2, irradiance.shape[1]))
    np.add.at(total, cell, irradiance)
    edges = np.cos(np.linspace(0, np.pi, _ROWS + 1))
    angle = np.repeat((edges[:-1] - edges[1:]) * np.pi / _ROWS, 2 * _ROWS)
    return (total / angle[:, None]).reshape(_ROWS, 2 * _ROWS, -1)


@_drawn.register
def _lobe(brdf: BRDF, axes: Axes) -> Axes:
    """Draw rho in the plane of incidence, the mean of the channels."""
    degrees = np.linspace(-89.5, 89.5, 359)
    exits = np.radians(degrees)
    outgoing = np.stack([np.sin(exits), 0 * exits, np.cos(exits)], axis=-1)
    largest = 0.0
    for incident in _INCIDENT:
        angle = np.radians(incident)
        incoming = np.broadcast_to([-np.sin(angle), 0.0, np.cos(angle)], outgoing.shape)
        rho = np.asarray(brdf.evaluate(incoming, outgoing), float).mean(axis=-1)
        largest = max(largest, float(rho.max(initial=0.0)))
        axes.semilogy(degrees, np.where(rho > 0, rho, np.nan), label=f"from {incident:g}°")
    if largest > 0:
        axes.set_ylim(bottom=largest * 10.0**-_DECADES, top=2 * largest)
    axes.set(
        title="lobe in the plane of incidence",
        xlabel="exit angle [degrees], the mirror direction is positive",
        ylabel="BRDF [1/sr]",
    )
    axes.legend(title="light")
    return axes


@_drawn.register
def _estimate(estimate: Estimate, axes: Axes) -> Axes:
    """Draw each number's 90 % interval, relative to its value."""
    names, low, high = [], [], []
    for name, value in estimate.values.items():
        interval = np.reshape(np.asarray(estimate.interval90[name], float), (-1, 2))
        for channel, (number, (lowest, highest)) in enumerate(zip(np.ravel(value), interval)):
            if not (np.isfinite([number, lowest, highest]).all() and number):
                continue
            names.append(f"{name}[{channel}]" if len(interval) > 1 else name)
            low.append(100 * (number - lowest) / abs(number))
            high.append(100 * (highest - number) / abs(number))
    axes.errorbar(np.zeros(len(names)), range(len(names)), xerr=(low, high), fmt="o", capsize=3)
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.axvline(0, color="grey", linewidth=0.8)
    axes.set(title=estimate.title, xlabel="90 % interval, relative to the value [%]")
    return axes


def _new_axes() -> Axes:
    return Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
