"""A quick fit of a material under light that may be meant in many ways.

The material is a Lambertian base and lobes of a few widths, all at once: whatever the light, their
amplitudes follow by least squares that are not negative.  What the samples would see of light
from each of a set of directions is evaluated once, so that each further light costs a product of
matrices.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.optimize import nnls

from jaxrender.brdf import Glossy, Microfacet, Parametric
from jaxrender.geometry import (
    Components,
    Shape,
    SurfaceSamples,
    to_local,
    visible,
    world_from_local,
)
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.shadowing import concave, nodes_seen, places_of
from jaxrender.lighting import LightNodes
from jaxrender.programs import stored
from jaxrender.shapes import Array, Float

_WIDTHS = (0.05, 0.12, 0.25, 0.5)
_INDEX = 1.5
# Directions whose transfer is evaluated at once.
_AT_ONCE = 2**18


class Responses(NamedTuple):
    """What each lobe makes samples see of light from each direction, visibility included.

    ``directions`` stand for even parts of the sphere.  ``fixed`` is what other lights, which are
    as they are told, add to the columns.
    """

    observations: Observations
    directions: Float[np.ndarray, "direction 3"]
    values: Float[np.ndarray, "lobe sample direction"]
    fixed: Float[np.ndarray, "lobe sample channel"] | None = None

    @classmethod
    def of(
        cls,
        observations: Observations,
        shape: Shape | None,
        directions: Float[np.ndarray, "direction 3"],
        others: KnownLight | None = None,
        lobe: Parametric | None = None,
    ) -> "Responses":
        """Evaluate the lobes, and trace what a concave shape hides."""
        lobes = lobes_like(lobe)
        values = transfers(lobes, observations.samples, directions)
        if concave(shape) is not None:
            assert shape is not None
            values = values * visible(shape, places_of(observations), directions)
        fixed = None
        if others is not None:
            fixed = _under(observations, shape, others, lobes)
        values = np.asarray(values * (4 * np.pi / len(directions)), np.float32)
        return cls(observations, directions, values, fixed)

    def fits(self, radiances: Sequence[Float[np.ndarray, "direction channel"]]) -> list["QuickFit"]:
        """Find the amplitudes under each of several lights."""
        measured = np.asarray(self.observations.radiance, float)
        lobes, samples, directions = self.values.shape
        # One product for all: the responses are many, and read but once.
        every = self.values.reshape(-1, directions) @ np.concatenate(
            radiances, axis=1, dtype=np.float32
        )
        columns = every.reshape(lobes, samples, len(radiances), -1).astype(float)
        fixed = 0.0 if self.fixed is None else self.fixed
        return [quick_fit(columns[:, :, k] + fixed, measured) for k in range(len(radiances))]


class QuickFit(NamedTuple):
    """What a material explains of samples, and what it leaves: squares by sample, weighted."""

    predicted: Float[np.ndarray, "sample channel"]
    squares: Float[np.ndarray, "sample"]
    total: float

    @property
    def unexplained(self) -> float:
        """What part of the samples is left, as root mean square."""
        return float(np.sqrt(self.squares.sum() / self.total))


def quick_fit(
    columns: Float[np.ndarray, "lobe sample channel"],
    measured: Float[np.ndarray, "sample channel"],
) -> QuickFit:
    """Solve for amplitudes of each channel that are not negative.

    Samples are weighted down as they are brighter than the mean: a highlight is one thing among
    others.
    """
    level = np.abs(measured).mean(axis=1)
    weights = 1 / np.sqrt(level + max(float(level.mean()), 1e-300))
    predicted = np.empty_like(measured)
    for channel, values in enumerate(measured.T):
        some = columns[:, :, channel].T
        # By the triangular factor: as many rows as there are lobes.
        q, r = np.linalg.qr(some * weights[:, None])
        found = nnls(r, q.T @ (values * weights))[0]
        predicted[:, channel] = some @ found
    left = (weights[:, None] * (measured - predicted)) ** 2
    total = float(np.sum((weights[:, None] * measured) ** 2))
    return QuickFit(predicted, left.sum(axis=1), max(total, 1e-300))


def lobes_like(lobe: Parametric | None) -> tuple[Parametric, ...]:
    """List lobes of a few widths: those of usual paint, and of the model that is asked for."""
    one = np.ones(1)
    usual = [Microfacet(one, one, w, _INDEX, "half", "smith", "ggx") for w in _WIDTHS]
    if not (isinstance(lobe, Glossy) and lobe.has_frequency_view):
        return tuple(usual)
    lobe = lobe.with_amplitudes(*(one for _ in lobe.amplitude_names))
    index = None if lobe.mu is None else _INDEX
    return (*usual, *(lobe.with_roughness(w, index) for w in _WIDTHS))


def transfers(
    lobes: tuple[Parametric, ...],
    samples: SurfaceSamples,
    directions: Float[np.ndarray, "*sample direction 3"],
) -> Float[np.ndarray, "lobe sample direction"]:
    """Evaluate a base and each lobe, times the cosine.

    The directions are those that all samples share, or each has its own.
    """
    normals, outgoing = (np.asarray(part, float) for part in samples)
    count = min(len(normals), max(1, _AT_ONCE // max(1, directions.shape[-2])))
    parts = []
    for first in range(0, len(normals), count):
        # The last portion is as large as the others, so that one program serves them all.
        at = np.minimum(np.arange(first, first + count), len(normals) - 1)
        own = directions if directions.ndim == 2 else directions[at]
        found = np.asarray(_transfers(lobes, *map(jnp.asarray, (normals[at], outgoing[at], own))))
        parts.append(found[:, : len(normals) - first])
    return np.concatenate(parts, axis=1)


@stored(effort="less")
def _transfers(
    lobes: tuple[Parametric, ...],
    normals: Float[Array, "sample 3"],
    outgoing: Float[Array, "sample 3"],
    directions: Float[Array, "*sample direction 3"],
) -> Float[Array, "lobe sample direction"]:
    frames = world_from_local(normals)
    shared = jnp.broadcast_to(directions, (len(normals), *directions.shape[-2:]))
    local = Components.of(to_local(frames[:, None], shared))
    away = Components.of(to_local(frames, outgoing)[:, None])
    each = [lobe.transfer(local, away) for lobe in lobes]
    return jnp.stack([each[0][0], *(specular for _, specular in each)])


def _under(
    observations: Observations,
    shape: Shape | None,
    light: KnownLight,
    lobes: tuple[Parametric, ...],
) -> Float[np.ndarray, "lobe sample channel"]:
    found = np.zeros((1 + len(lobes), *observations.radiance.shape))
    for nodes in exact_nodes(light, observations, min(_WIDTHS), 0.5):
        directions, irradiance = np.asarray(nodes.directions), np.asarray(nodes.irradiance)
        if not isinstance(nodes, LightNodes):
            own = np.asarray(nodes.frame_of_sample)
            directions, irradiance = directions[own], irradiance[own]
        values = transfers(lobes, observations.samples, directions)
        seen = nodes_seen(concave(shape), observations, (nodes,))
        if seen is not None:
            values = values * seen[0]
        pattern = "lsn,nc->lsc" if irradiance.ndim == 2 else "lsn,snc->lsc"
        found += np.einsum(pattern, values, irradiance)
    return found
