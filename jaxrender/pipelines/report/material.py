"""The recovered material on a sphere: under the given light, and under a single source."""

from typing import NamedTuple

import jax
import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.geometry import SurfaceSamples
from jaxrender.imaging.display import exposed, exposure_for
from jaxrender.inverse import KnownLight
from jaxrender.inverse.observations import Observations
from jaxrender.lighting import LightNodes, condensed
from jaxrender.pipelines.report.contents import MaterialContents, is_diffuse
from jaxrender.pipelines.report.display import data_uri, with_alpha
from jaxrender.programs import stored
from jaxrender.reflection import integral_columns
from jaxrender.shapes import Float

_PIXELS = 128
# Cells of an environment no wider than sigma leave no ripple in a lobe whose radius is 2 sigma;
# below the narrowest a picture of this size takes too long, and it shows no difference.
_NARROWEST_CELL, _WIDEST_CELL = 0.055, 0.2
# The single source, in the camera's own axes (right, up, towards the camera).
_SOURCE = np.array([-0.45, 0.55, 0.70])
# Beyond this cosine the model without masking exceeds 1, and a picture shows its rim anyway.
_SMALLEST_COSINE = 0.05
# Node counts are filled up to a power of two, so that few shapes are ever compiled.
_FEWEST_NODES = 256


class Spheres(NamedTuple):
    """Pictures of the sphere as data URIs; the parts are None where there is only one."""

    given: str
    diffuse: str | None
    specular: str | None
    source: str


class _View(NamedTuple):
    """A sphere seen from far away: one sample per pixel, and how much of the pixel it covers."""

    samples: SurfaceSamples
    opacity: Float[np.ndarray, "row column"]
    source: Float[np.ndarray, "3"]


def spheres(contents: MaterialContents) -> Spheres:
    """Render the sphere with the exact integral, seen as the first photograph sees the object."""
    brdf, view = contents.fit.brdf, _view(contents.fit.final.observations)
    columns = _columns(brdf, view, contents.light.of_frame(0))
    channels = columns.shape[-1] - 1
    parts = columns[..., :channels] * np.asarray(brdf.amplitudes, float)
    given = parts.sum(axis=1)
    source = np.sum(columns[..., channels:] * np.asarray(brdf.amplitudes, float), axis=1)
    inside = view.opacity.ravel() > 0
    exposure = exposure_for(given[inside])
    glossy = not is_diffuse(contents)
    return Spheres(
        _picture(given, view, exposure),
        _picture(parts[:, 0], view, exposure) if glossy else None,
        _picture(parts[:, 1], view, exposure) if glossy else None,
        _picture(source, view, exposure_for(source[inside])),
    )


def with_arrays(brdf: Parametric, dtype=np.float32) -> Parametric:
    """Hold all numbers as arrays, so that a compiled function serves every material."""
    return jax.tree.map(lambda number: np.asarray(number, dtype), brdf)


def _columns(
    brdf: Parametric, view: _View, light: KnownLight
) -> Float[np.ndarray, "sample lobe channel"]:
    """Evaluate both lights at once: the single source is one more channel."""
    given = _nodes(light, float(brdf.width))
    count, channels = given.irradiance.shape
    size = max(_FEWEST_NODES, 2 ** int(np.ceil(np.log2(count + 1))))
    directions = np.tile([0.0, 0.0, 1.0], (size, 1))
    irradiance = np.zeros((size, channels + 1))
    directions[:count], directions[count] = given.directions, view.source
    irradiance[:count, :channels], irradiance[count, channels] = given.irradiance, np.pi
    samples, nodes = jax.tree.map(
        lambda array: np.asarray(array, np.float32),
        (view.samples, LightNodes(directions, irradiance)),
    )
    return np.asarray(_integrate(with_arrays(brdf), samples, nodes), float)


@stored(effort="less")
def _integrate(brdf: Parametric, samples: SurfaceSamples, nodes: LightNodes):
    return integral_columns(brdf, samples, nodes)


def _nodes(light: KnownLight, sigma: float) -> LightNodes:
    shared = light.directional.nodes()
    directions, irradiance = np.asarray(shared.directions), np.asarray(shared.irradiance)
    if light.environment is None:
        return LightNodes(directions, irradiance)
    cells = condensed(light.environment, float(np.clip(sigma, _NARROWEST_CELL, _WIDEST_CELL)))
    return LightNodes(
        np.concatenate([cells.directions, directions]),
        np.concatenate([cells.irradiance, irradiance]),
    )


def _view(observations: Observations) -> _View:
    frame = np.asarray(observations.frame)
    outgoing = np.asarray(observations.samples.outgoing, float)[frame == frame.min()]
    towards = outgoing.mean(axis=0)
    length = np.linalg.norm(towards)
    towards = towards / length if length > 0.1 else np.array([1.0, 0.0, 0.0])
    up = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(towards, right), towards])
    rows, columns = np.mgrid[:_PIXELS, :_PIXELS]
    across, upward = ((2 * k + 1) / _PIXELS - 1 for k in (columns, _PIXELS - 1 - rows))
    radius = np.hypot(across, upward)
    cosine = np.sqrt(np.maximum(1 - radius**2, _SMALLEST_COSINE**2))
    local = np.stack([across, upward, cosine], axis=-1).reshape(-1, 3)
    rim = np.sqrt(1 - np.minimum(cosine.ravel(), 1) ** 2) / np.maximum(radius.ravel(), 1e-9)
    local[:, :2] *= rim[:, None]
    normals = local @ axes
    samples = SurfaceSamples(normals, np.broadcast_to(towards, normals.shape))
    source = _SOURCE / np.linalg.norm(_SOURCE) @ axes
    return _View(samples, np.clip((1 - radius) * _PIXELS / 2, 0, 1), source)


def _picture(radiance: Float[np.ndarray, "sample channel"], view: _View, exposure: float) -> str:
    picture = radiance.reshape(_PIXELS, _PIXELS, -1)
    return data_uri(with_alpha(exposed(picture, exposure), view.opacity))
