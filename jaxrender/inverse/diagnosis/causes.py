"""What can be wrong with a fit: for each cause the columns that it would add to the prediction.

A cause that the photographs or the light leave no room for has none (None).  Lengths are in units
of the object's size, angles in radians.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Glossy, Microfacet, Parametric, lobe_named
from jaxrender.harmonics import coefficient_count, real_basis
from jaxrender.inverse.diagnosis.grounds import Grounds, Movement, shifted_rays, turned_rays
from jaxrender.inverse.diagnosis.turning import tangents
from jaxrender.shapes import Float

# Smooth displacements have harmonics up to this degree, smooth changes of paint up to that.
_BUMPS, _PAINTS = 4, 3
# Other widths that a lobe is tried with, relative to its own: tails and cores of other models.
_WIDTHS = (0.6, 1.6)
# Models of other tails, of the same numbers.
_OTHERS = ("ggx", "microfacet")
# Derivatives of harmonics are taken over this step (radians).
_STEP = 1e-4

Columns = Float[np.ndarray, "sample channel column"]


class Cause(NamedTuple):
    """One thing that may be wrong: its name, in words, and its columns.

    ``of_light`` says that these differentiate the material under the light, which takes a while.
    """

    name: str
    sentence: str
    columns: Callable[[Grounds], Columns | None]
    of_light: bool = True


def _exposure(grounds: Grounds) -> Columns:
    return grounds.predicted[:, :, None] * _by_photograph(grounds)


def _gain(grounds: Grounds) -> Columns:
    return grounds.predicted[:, :, None] * np.eye(grounds.predicted.shape[1])


def _camera(grounds: Grounds) -> Columns | None:
    """Turn each camera about three axes."""
    eyes = grounds.eyes
    if eyes is None:
        return None
    rays = grounds.rays
    turned = [grounds.seen_along(turned_rays(rays, eyes, axis)) for axis in np.eye(3)]
    return np.concatenate([one[:, :, None] * _by_photograph(grounds) for one in turned], axis=2)


def _object(grounds: Grounds) -> Columns | None:
    """Shift the object along three axes: the rays go the other way."""
    if not grounds.placed:
        return None
    rays, size = grounds.rays, grounds.size
    shifted = [grounds.seen_along(shifted_rays(rays, -size * axis)) for axis in np.eye(3)]
    return np.stack(shifted, axis=2)


def _scale(grounds: Grounds) -> Columns | None:
    """Make the object larger: the cameras come nearer, relative to its size."""
    if grounds.eyes is None:
        return None
    rays = grounds.rays
    return grounds.seen_along(shifted_rays(rays, grounds.center - rays.origins))[:, :, None]


def _environment(grounds: Grounds) -> Columns | None:
    if grounds.environment is None:
        return None
    turning = grounds.environment.turning
    return grounds.gain[:, :, None] * np.stack([turning.turned(axis) for axis in np.eye(3)], 2)


def _lamps(grounds: Grounds) -> Columns | None:
    """Move every source aside, and make it brighter."""
    if not grounds.sources:
        return None
    found = []
    for source in grounds.sources:
        axes = np.eye(3)[:, None, :]
        if source.direction is not None:
            axes = np.moveaxis(tangents(source.direction), -1, 0)
        found += [source.turning.turned(axis) for axis in axes] + [source.turning.value]
    return grounds.gain[:, :, None] * np.stack(found, axis=2)


def _nearness(grounds: Grounds) -> Columns | None:
    """Bring every source from infinity to a distance."""
    if not grounds.placed:
        return None
    found = []
    for source in grounds.sources:
        if source.direction is None:
            continue
        points, towards = grounds.points, source.direction
        height = np.sum(points * towards, axis=1, keepdims=True)
        # From a point off the axis the source is seen aside, and from a nearer one brighter.
        axes = np.cross(towards, height * towards - points)
        found.append(source.turning.turned(axes) + 2 * height * source.turning.value)
    return grounds.gain[:, :, None] * np.stack(found, axis=2) if found else None


def _black(grounds: Grounds) -> Columns:
    count, channels = grounds.predicted.shape
    return np.tile(np.eye(channels), (count, 1, 1))


def _response(grounds: Grounds) -> Columns:
    scale = np.sqrt(np.mean(grounds.predicted**2))
    relative = np.maximum(grounds.predicted / scale, 1e-9)
    return (grounds.predicted * np.log(relative))[:, :, None]


def _normals(grounds: Grounds) -> Columns:
    """Displace the surface smoothly: normals turn by minus the gradient of the height."""
    normals = grounds.normals
    still = np.zeros_like(normals)
    slopes = _gradients(normals, _BUMPS)
    return np.stack([grounds.moved(Movement(-slope, still)) for slope in slopes], axis=2)


def _lobe(grounds: Grounds) -> Columns | None:
    """Add lobes of other widths and of other models."""
    material = grounds.material
    if not (isinstance(material, Glossy) and material.has_frequency_view):
        return None
    width, mu = float(material.width), material.mu
    others: list[Parametric] = [material.with_roughness(f * width, mu) for f in _WIDTHS]
    for name in _OTHERS:
        kind = lobe_named(name, metal=mu is None)
        assert isinstance(kind, Glossy)
        if kind.distribution != getattr(material, "distribution", None):
            others.append(kind.with_roughness(width, mu))
    if isinstance(material, Microfacet):
        others.append(material.with_variant("half", "smith"))
    return grounds.gain[:, :, None] * np.stack([grounds.lobe_of(other) for other in others], 2)


def _sites(grounds: Grounds) -> Columns | None:
    """Let the reflectance change smoothly over the object."""
    if not grounds.placed:
        return None
    basis = np.asarray(real_basis(_unit(grounds.points), _PAINTS))[:, 1:]
    return grounds.predicted[:, :, None] * basis[:, None, :]


CAUSES = (
    Cause("exposure", "the photographs' exposures differ", _exposure, of_light=False),
    Cause("gain", "the channels' gains differ", _gain, of_light=False),
    Cause("camera", "cameras are turned", _camera),
    Cause("object", "the object lies elsewhere", _object),
    Cause("scale", "the object is larger or smaller", _scale),
    Cause("environment", "the environment is turned", _environment),
    Cause("lamps", "sources lie elsewhere, or are brighter or darker", _lamps),
    Cause("nearness", "sources are near", _nearness),
    Cause("black", "the pixels have a black level", _black, of_light=False),
    Cause("response", "the response is not linear", _response, of_light=False),
    Cause("normals", "the surface is not quite that of the shape", _normals),
    Cause("lobe", "the lobe has another shape", _lobe),
    Cause("sites", "the material is not the same everywhere", _sites, of_light=False),
)


def _by_photograph(grounds: Grounds) -> Float[np.ndarray, "sample 1 photograph"]:
    """Mark the samples of each photograph."""
    return (grounds.frame[:, None] == np.unique(grounds.frame))[:, None, :].astype(float)


def _gradients(
    directions: Float[np.ndarray, "sample 3"], degree: int
) -> Float[np.ndarray, "harmonic sample 3"]:
    """Differentiate all harmonics but the constant along the sphere, by central differences."""
    found = np.zeros((coefficient_count(degree) - 1, len(directions), 3))
    for along in np.moveaxis(tangents(directions), -1, 0):
        ahead, behind = (
            np.asarray(real_basis(_unit(directions + sign * _STEP * along), degree))[:, 1:]
            for sign in (1, -1)
        )
        found += ((ahead - behind) / (2 * _STEP)).T[:, :, None] * along
    return found


def _unit(vectors: Float[np.ndarray, "sample 3"]) -> Float[np.ndarray, "sample 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
