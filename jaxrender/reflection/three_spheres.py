"""Two lights compared by what they make of three spheres: the three-sphere protocol.

A diffuse sphere shows the slow light, a matte silver one (facets of width .3) the light to some
twenty degrees, and a mirror all of it.  Weber, Prevost and Lalonde (2018) and later benchmarks of
lighting estimation compare such spheres by three numbers: the rms of the difference, the same after
one scale, and the angle between colours.  Here an orthographic camera looks along -x, and both rms
are relative to the mean of the true sphere.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from jaxrender.brdf import Lambertian, material_named
from jaxrender.geometry import Orthographic, Sphere, SurfaceView, look_at, observe
from jaxrender.harmonics.grids import LatLongGrid
from jaxrender.lighting import Environment, to_latlong
from jaxrender.reflection.lit import render_lit
from jaxrender.shapes import checked

Pixels = Float[np.ndarray, "pixel channel"]
Panorama = Float[np.ndarray, "row column channel"]

# Pixels across a sphere, and rows of the panorama that it is lit by.
_SIDE, _ROWS = 64, 128
_SILVER_WIDTH, _SILVER = 0.3, 0.97
_BALL = Sphere(np.zeros(3), 1.0)


class LightDifference(NamedTuple):
    """How far a sphere is from the true one: two rms by the mean of that, degrees between colours.

    ``scaled_rms`` is that after one scale of all channels.  The ``angle`` counts every pixel alike,
    also those that are almost black, whose colour is hardly known.
    """

    rms: float
    scaled_rms: float
    angle: float


@checked
def three_spheres(
    light: Environment, rows: int = _ROWS, silver_width: float = _SILVER_WIDTH
) -> dict[str, Float[np.ndarray, "side side channel"]]:
    """Render the three spheres under a panorama of at most so many rows; black beside them."""
    radiance = _coarser(np.asarray(light.radiance, float), rows)
    channels = radiance.shape[-1]
    camera, ball, view = _camera(), _BALL, _view()
    lit, white = Environment(radiance), Lambertian(np.full(channels, 1 / np.pi))
    facets = {"kd": [0.0] * channels, "ks": _SILVER, "sigma": silver_width, "mu": "none"}
    mirror = np.zeros((_SIDE, _SIDE, channels))
    mirror[view.hit] = _mirrored(radiance, view.normals[view.hit], view.outgoing[view.hit])
    return {
        "diffuse": np.asarray(render_lit(white, lit, ball, camera)),
        "matte silver": np.asarray(render_lit(material_named("ggx", facets), lit, ball, camera)),
        "mirror": mirror,
    }


@checked
def compare_lights(
    found: Environment,
    true: Environment,
    *,
    scale_channels: bool = False,
    silver_width: float = _SILVER_WIDTH,
) -> dict[str, LightDifference]:
    """Compare the three spheres; ``scale_channels`` first gives each channel a factor of its own.

    That is for a light whose colour is known only together with that of a material.
    Both are as coarse as the coarser: a lamp of one texel is as bright as its texel is small.
    Raises ValueError where the true light is dark.
    """
    rows = min(_ROWS, len(found.radiance), len(true.radiance))
    inside = _view().hit
    ours, theirs = (
        {name: one[inside] for name, one in three_spheres(light, rows, silver_width).items()}
        for light in (found, true)
    )
    if not theirs["diffuse"].any():
        raise ValueError("the true light is dark: there is nothing to compare")
    if scale_channels:
        # One factor for all three spheres: it belongs to the light.
        factor = _factor(ours["diffuse"], theirs["diffuse"], axis=0)
        ours = {name: factor * sphere for name, sphere in ours.items()}
    return {name: _difference(ours[name], theirs[name]) for name in theirs}


def _camera() -> Orthographic:
    pose = look_at(np.array([4.0, 0, 0]), np.zeros(3), np.array([0, 0, 1.0]))
    return Orthographic(_SIDE, _SIDE, pose, scale=2.0 / _SIDE)


def _view() -> SurfaceView:
    return observe(_camera(), _BALL)


def _coarser(radiance: Panorama, rows: int) -> Float[np.ndarray, "_ _ channel"]:
    """Average over blocks of whole texels, so that no lamp becomes wider than the new texels."""
    whole = len(radiance) // rows
    if whole < 2:
        return radiance if len(radiance) <= rows else to_latlong(radiance, "z-up", rows)
    if len(radiance) != whole * rows:
        radiance = to_latlong(radiance, "z-up", whole * rows)
    weights = LatLongGrid(*radiance.shape[:2]).weights()[..., None]
    blocks = (rows, whole, 2 * rows, whole, -1)
    energy = (weights * radiance).reshape(blocks).sum(axis=(1, 3))
    return energy / weights.reshape(blocks).sum(axis=(1, 3))


def _difference(found: Pixels, true: Pixels) -> LightDifference:
    scale, mean = _factor(found, true, axis=None), float(true.mean())
    left = [np.mean((factor * found - true) ** 2) for factor in (1.0, scale)]
    rms, scaled_rms = (float(np.sqrt(one)) / mean for one in left)
    return LightDifference(rms, scaled_rms, _angle(found, true))


def _factor(found: Pixels, true: Pixels, axis: int | None) -> np.ndarray:
    energy = np.sum(found**2, axis=axis)
    return np.where(
        energy > 0, np.sum(found * true, axis=axis) / np.where(energy > 0, energy, 1), 1.0
    )


def _angle(found: Pixels, true: Pixels) -> float:
    """Average the angle between colours, in degrees, over the pixels where neither is black."""
    lengths = np.linalg.norm(found, axis=-1) * np.linalg.norm(true, axis=-1)
    lit = lengths > 0
    cosines = np.sum(found[lit] * true[lit], axis=-1) / lengths[lit]
    angles = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    return float(angles.mean()) if lit.any() else float("nan")


def _mirrored(
    radiance: Panorama,
    normals: Float[np.ndarray, "pixel 3"],
    outgoing: Float[np.ndarray, "pixel 3"],
) -> Pixels:
    """Look up the reflected direction, between the four nearest texels."""
    cosine = np.sum(normals * outgoing, axis=-1, keepdims=True)
    x, y, z = (2 * cosine * normals - outgoing).T
    rows, columns = radiance.shape[:2]
    row = np.arccos(np.clip(z, -1, 1)) * rows / np.pi - 0.5
    column = np.arctan2(y, x) * columns / (2 * np.pi) - 0.5
    # On either side a column of the other one; beyond the poles the outermost row.
    wrapped = np.concatenate([radiance[:, -1:], radiance, radiance[:, :1]], axis=1)
    places = np.stack([row, column % columns + 1])
    channels = [
        ndimage.map_coordinates(channel, places, order=1, mode="nearest")
        for channel in np.moveaxis(wrapped, -1, 0)
    ]
    return np.stack(channels, axis=-1)
