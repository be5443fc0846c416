"""What can be wrong with a fit: for each cause the columns that it would add to the prediction.

A cause that the photographs or the light leave no room for has none (None).  Lengths are in units
of the object's size, angles in radians.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import WIDTH_BOUNDS, Bank, Glossy, Microfacet, Parametric, lobe_named
from jaxrender.geometry import Mesh
from jaxrender.harmonics import real_basis
from jaxrender.inverse.diagnosis.blurring import softening
from jaxrender.inverse.diagnosis.grounds import STEP, Grounds, Movement
from jaxrender.inverse.interreflection import added_by_bounces
from jaxrender.inverse.nuisances import NUISANCES, bumps, rotation
from jaxrender.inverse.rays import center_of, size_of
from jaxrender.inverse.shadowing import concave
from jaxrender.shapes import Float

# Smooth changes of paint have harmonics up to this degree.
_PAINTS = 3
# Gains and paints change by about this part, and a lobe that is hardly there by this much.
_TYPICAL = 0.1
# Other widths that a lobe is tried with, relative to its own: tails and cores of other models, and
# wide lobes beside it, which real materials have.
_WIDTHS = (0.6, 1.6, 3.0, 8.0)
# Indices of the lobes that a bank has none of.
_MUS = (1.3, 2.0)
# Models of other tails, of the same numbers.
_OTHERS = ("ggx", "microfacet")
# One without facets, which has no masking and no Fresnel reflectance.
_PLAIN = "phong"

Columns = Float[np.ndarray, "sample channel column"]


class Cause(NamedTuple):
    """One thing that may be wrong: its name, in words, and its columns.

    ``of_light`` says that these differentiate the material under the light, which takes a while.
    ``general`` is the simpler cause of which this one is the general case.
    """

    name: str
    sentence: str
    columns: Callable[[Grounds], Columns | None]
    of_light: bool = True
    general: str | None = None


def _exposure(grounds: Grounds) -> Columns:
    return grounds.predicted[:, :, None] * _by_photograph(grounds)


def _gain(grounds: Grounds) -> Columns:
    return grounds.predicted[:, :, None] * np.eye(grounds.predicted.shape[1])


def _camera(grounds: Grounds) -> Columns | None:
    """Turn each camera about three axes; the columns go photograph by photograph."""
    if not grounds.placed or grounds.rays.eyes is None:
        return None
    rays = grounds.rays
    turned = [grounds.seen_along(rays.turned(rotation(STEP * axis))) for axis in np.eye(3)]
    every = np.stack(turned, axis=2)[:, :, None, :] * _by_photograph(grounds)[..., None]
    return every.reshape(*every.shape[:2], -1)


def _object(grounds: Grounds) -> Columns | None:
    """Shift the object along three axes: the rays go the other way."""
    if not grounds.placed:
        return None
    assert grounds.shape is not None
    step = STEP * size_of(grounds.shape)
    shifted = [grounds.seen_along(grounds.rays.shifted(-step * axis)) for axis in np.eye(3)]
    return np.stack(shifted, axis=2)


def _scale(grounds: Grounds) -> Columns | None:
    """Make the object larger: the cameras come nearer, relative to its size."""
    if not grounds.placed or grounds.rays.eyes is None or grounds.rays.parallel:
        return None
    assert grounds.shape is not None
    nearer = STEP * (center_of(grounds.shape) - grounds.rays.eyes)
    return grounds.seen_along(grounds.rays.shifted(nearer))[:, :, None]


def _environment(grounds: Grounds) -> Columns | None:
    if grounds.environment is None:
        return None
    part = grounds.environment
    turns = grounds.gain[:, :, None] * np.stack([part.turned(axis) for axis in np.eye(3)], 2)
    light = grounds.light.told
    if light is None or light.environments is None:
        return turns
    # Each environment turns by itself.
    own = light.image_of_frame[grounds.frame]
    return np.concatenate(
        [np.where((own == at)[:, None, None], turns, 0) for at in range(len(light.images))], axis=2
    )


def _lamps(grounds: Grounds) -> Columns | None:
    """Turn every source about three axes, and make it brighter."""
    if not grounds.sources:
        return None
    found = []
    for part in grounds.sources:
        found += [*(part.turned(axis) for axis in np.eye(3)), part.turning.value]
    return grounds.gain[:, :, None] * np.stack(found, axis=2)


def _nearness(grounds: Grounds) -> Columns | None:
    """Bring every source from infinity to a distance, unless it is known where they are."""
    told = grounds.light.told
    if told is not None and told.near is not None and told.near.stated:
        return None
    found = [part.nearer() for part in grounds.sources]
    if not any(column is not None for column in found):
        return None
    still = np.zeros_like(grounds.predicted)
    columns = [still if column is None else column for column in found]
    return grounds.gain[:, :, None] * np.stack(columns, axis=2)


def _black(grounds: Grounds) -> Columns:
    count, channels = grounds.predicted.shape
    level = np.sqrt(np.mean(grounds.predicted**2))
    return np.tile(level * np.eye(channels), (count, 1, 1))


def _response(grounds: Grounds) -> Columns:
    """Raise values to a power, which leaves 1 as it is."""
    value = np.maximum(grounds.predicted, 1e-9)
    return (value * np.log(value))[:, :, None]


def _normals(grounds: Grounds) -> Columns:
    """Displace the surface smoothly: normals turn by minus the gradient of the height."""
    still = np.zeros_like(grounds.normals)
    slopes = bumps(grounds.normals)
    return np.stack([grounds.moved(Movement(-slope, still)) for slope in slopes], axis=2)


def _lobe(grounds: Grounds) -> Columns | None:
    """Add lobes of other widths and of other models."""
    material = grounds.material
    if isinstance(material, Bank):
        # It has its own lobes at every width, but none that grows without masking.
        widths = (lobe.width for lobe in material.lobes if lobe.about_mirror)
        kind = lobe_named("microfacet")
        lobes = [kind.with_roughness(width, mu) for width in dict.fromkeys(widths) for mu in _MUS]
        return grounds.gain[:, :, None] * np.stack([grounds.lobe_of(one) for one in lobes], 2)
    width, mu = float(material.width), material.mu
    # Some models know no width beyond the bounds that they are searched in.
    widths = np.unique(np.clip(width * np.array(_WIDTHS), *WIDTH_BOUNDS))
    if not (isinstance(material, Glossy) and material.has_frequency_view):
        kinds = [lobe_named(name, metal=metal) for name in _OTHERS for metal in (False, True)]
        lobes = [kind.with_roughness(float(w), kind.mu) for kind in kinds for w in widths]
        return grounds.gain[:, :, None] * np.stack([grounds.lobe_of(one) for one in lobes], 2)
    others: list[Parametric] = [material.with_roughness(float(w), mu) for w in widths]
    for name in (*_OTHERS, _PLAIN):
        kind = lobe_named(name, metal=mu is None)
        if _kind_of(kind) != _kind_of(material):
            others.append(kind.with_roughness(width, mu))
    if isinstance(material, Microfacet):
        others.append(material.with_variant("half", "smith"))
    return grounds.gain[:, :, None] * np.stack([grounds.lobe_of(other) for other in others], 2)


def _kind_of(material: Parametric) -> tuple[type, str | None]:
    return type(material), getattr(material, "distribution", None)


def _blur(grounds: Grounds) -> Columns | None:
    found = softening(grounds)
    return None if found is None else found.added[:, :, None]


def _defocus(grounds: Grounds) -> Columns | None:
    """Blur by a variance that is quadratic in the distance: cameras are focused somewhere else."""
    found = _blur(grounds)
    if found is None or grounds.rays.eyes is None or grounds.rays.parallel:
        return None
    assert grounds.shape is not None
    assert grounds.observations.places is not None
    away = np.asarray(grounds.observations.places.points, float) - grounds.rays.eyes
    distance = np.linalg.norm(away, axis=1) / size_of(grounds.shape)
    nearer = (distance - distance.mean())[:, None, None]
    return np.concatenate([found, nearer * found, nearer**2 * found], axis=2)


def _moved_light(grounds: Grounds) -> Columns:
    """Turn the whole light about three axes, in each photograph its own way."""
    turned = [sum(part.turned(axis) for part in grounds.parts) for axis in np.eye(3)]
    turns = grounds.gain[:, :, None] * np.stack(turned, axis=2)
    every = turns[:, :, None, :] * _by_photograph(grounds)[..., None]
    return every.reshape(*every.shape[:2], -1)


def _interreflection(grounds: Grounds) -> Columns | None:
    """Add what the diffuse parts of a concave object send each other, all of it at once."""
    mesh, light = concave(grounds.shape), grounds.light.told
    if not isinstance(mesh, Mesh) or light is None or light.near is not None or grounds.painted:
        return None
    if not grounds.placed or not grounds.material.bases:
        return None
    kd = np.asarray(grounds.material.base_amplitude, float)
    return (
        grounds.gain[:, :, None]
        * added_by_bounces(mesh, light, grounds.observations, kd)[..., None]
    )


def _sites(grounds: Grounds) -> Columns | None:
    """Let the reflectance change smoothly over the object."""
    if not grounds.placed:
        return None
    basis = np.asarray(real_basis(_unit(grounds.points), _PAINTS))[:, 1:]
    return grounds.predicted[:, :, None] * basis[:, None, :]


_ALL = (
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
    Cause("interreflection", "parts of the object light each other", _interreflection),
    Cause("moved_light", "the light moved between photographs", _moved_light),
    Cause("blur", "the photographs are blurred", _blur),
    Cause(
        "defocus",
        "the photographs are out of focus, here more and there less",
        _defocus,
        general="blur",
    ),
    Cause("sites", "the material is not the same everywhere", _sites, of_light=False),
)
CAUSES = {cause.name: cause for cause in _ALL}


def typical_amounts(name: str, grounds: Grounds, count: int) -> Float[np.ndarray, "column"]:
    """Say how much of a cause's columns may be expected: of a nuisance, what its prior says."""
    if name in NUISANCES:
        return NUISANCES[name].deviations(count)
    if name == "lobe":
        lobe = float(np.mean(np.asarray(grounds.material.lobe_amplitude)))
        return np.full(count, max(lobe, _TYPICAL))
    if name == "defocus":
        return NUISANCES["blur"].deviations(count)
    if name == "moved_light":
        return NUISANCES["environment"].deviations(count)
    return np.full(count, 1.0 if name == "interreflection" else _TYPICAL)


def _by_photograph(grounds: Grounds) -> Float[np.ndarray, "sample 1 photograph"]:
    """Mark the samples of each photograph."""
    every = np.arange(grounds.observations.frames)
    return (grounds.frame[:, None] == every)[:, None, :].astype(float)


def _unit(vectors: Float[np.ndarray, "sample 3"]) -> Float[np.ndarray, "sample 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
