"""Interreflections of a diffuse concave object, found along with its albedo (T 6.6).

T 6.6 proposes to iterate, as Yu et al. do.  With the albedo found so far, compute the light that
bounces between parts of the object; give it to the model as more irradiance, and fit again.  The
secant of two rounds gives the albedo for which the supposed and the found one agree.

The bounced light enters the diffuse part only.  Its specular reflection is left out, and so are
bounces off the specular part.  Error bars take the bounced light as known.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Lambertian, Parametric
from jaxrender.geometry import Mesh, Shape, SurfacePlaces, SurfaceSamples, SurfaceView
from jaxrender.inverse.known_light import KnownLight, exact_nodes
from jaxrender.inverse.models import Columns, Model, Numbers, Rows
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.passes import Stop
from jaxrender.inverse.shadowing import hidden_fraction, places_of
from jaxrender.lighting import LightNodes
from jaxrender.reflection import integral_columns, interpolated, visible_nodes
from jaxrender.reflection.interreflection import Interreflection
from jaxrender.shapes import AnyArray, Float

# The diffuse part shows no finer detail of the environment than this (radians).
_CELL = 0.1
# A rough estimate takes wider cells, and fewer rays a vertex.
_WIDE_CELL, _FEW_RAYS = 0.25, 64
# Rounds until kd moves by less than this part of the largest.
_SETTLED, _MOST_ROUNDS = 1e-4, 12
# Vertices that meet the light at once.
_PLACES_AT_ONCE = 4096


class WithBounced(eqx.Module):
    """A model with more diffuse light than its own: that which comes from the object itself."""

    model: Model
    bounced: Float[AnyArray, "sample channel"]

    def columns(self, numbers: Numbers) -> Columns:
        """Add the bounced irradiance to the diffuse column."""
        diffuse, specular = self.model.columns(numbers)
        return Columns(diffuse + jnp.asarray(self.bounced), specular)

    def take(self, index: Rows) -> "WithBounced":
        """Keep the samples of the given indices."""
        return WithBounced(self.model.take(index), self.bounced[index])


class Bounced(NamedTuple):
    """The light that bounces: at the mesh's vertices for each photograph (one where all share it).

    ``part`` is what it adds to the direct irradiance of the samples, on average; ``rounds`` says
    how many fits it took, ``settled`` whether that was enough.
    """

    at_vertices: Float[np.ndarray, "frame vertex channel"]
    part: float
    rounds: int
    settled: bool
    kd_without: Float[np.ndarray, "channel"]

    def irradiance(
        self, mesh: Mesh, view: SurfaceView, frame: int
    ) -> Float[np.ndarray, "pixel channel"]:
        """Find what bounced light adds at the pixels of photograph ``frame`` that hit the mesh."""
        field = self.at_vertices[frame if len(self.at_vertices) > 1 else 0]
        places = view.face[view.hit], view.barycentric[view.hit]
        return interpolated(field, mesh.faces, *places)


class PossibleBounces(NamedTuple):
    """What may bounce of light whose bounces are not modelled: averages over the samples."""

    albedo: float
    hidden_fraction: float

    @property
    def estimate(self) -> float:
        """What bounces may add to the light, as a part of it."""
        return self.albedo * self.hidden_fraction


def possible_bounces(
    brdf: Parametric, transfer: Float[AnyArray, "sample coefficient"]
) -> PossibleBounces:
    """Estimate how much light bounces between parts of an object.

    What a place does not see of the light it sees of the object, which is about as bright as its
    albedo.  ``transfer`` are the vectors of T 6.10.
    """
    specular = np.asarray(brdf.lobe_amplitude) * float(brdf.energy)
    albedo = float(np.clip(np.mean(np.pi * np.asarray(brdf.base_amplitude) + specular), 0, 1))
    return PossibleBounces(albedo, hidden_fraction(transfer))


class _Round(NamedTuple):
    """One round: the kd that bounced, and the kd that was found with those bounces."""

    supposed: Float[np.ndarray, "channel"]
    found: Float[np.ndarray, "channel"]

    def next(self, before: "_Round | None") -> Float[np.ndarray, "channel"]:
        """Suppose what was found or, after two rounds, where the secant has both agree.

        More bounces make the albedo found darker, and fewer make it brighter.  So plain rounds
        swing about the answer, in a deep bright bowl dozens of times.
        """
        if before is None:
            return self.found
        run = self.supposed - before.supposed
        rise = self.found - before.found
        slope = np.where(run != 0, rise / np.where(run != 0, run, 1), 0)
        return self.supposed + (self.found - self.supposed) / (1 - np.clip(slope, -5, 0.5))


def fit_with_bounces(
    stop: Stop,
    shape: Shape,
    light: KnownLight,
    refit: Callable[[Stop, Float[np.ndarray, "sample channel"]], Stop],
) -> tuple[Stop, Bounced]:
    """Fit and bounce in turn until the albedo settles.

    ``refit`` continues a fit with the bounced irradiance of its samples.  Raises ``ValueError`` for
    a concave shape that is no mesh, whose vertices are to hold the light.
    """
    if not isinstance(shape, Mesh):
        raise ValueError("interreflections are computed on a mesh's vertices: give a mesh")
    exchange = Interreflection.of(shape)
    observed = stop.observations
    frames = np.zeros(observed.count, int)
    if light.varies:
        frames = np.asarray(observed.frame)
    direct = [direct_irradiance(shape, light.of_frame(k)) for k in range(light.frames)]
    to_samples = exchange.gathering(places_of(observed), np.asarray(observed.samples.normals))
    without = supposed = _kd(stop)
    before: _Round | None = None
    rounds, settled = 0, False
    while not settled and rounds < _MOST_ROUNDS:
        rounds += 1
        albedo = np.clip(np.pi * supposed, 0, 1)
        total = np.stack([exchange.total(one, albedo) for one in direct])
        gathered = np.stack([to_samples @ one for one in total])
        bounced = albedo * gathered[frames, np.arange(observed.count)]
        stop = refit(stop, bounced)
        now = _Round(supposed, _kd(stop))
        settled = bool(np.max(np.abs(now.found - supposed)) <= _SETTLED * np.max(now.found))
        before, supposed = now, now.next(before)
    direct_part = np.sum(np.asarray(_diffuse_of(stop)) - bounced)
    part = float(np.sum(bounced) / max(float(direct_part), 1e-300))
    found = Bounced(total - np.stack(direct), part, rounds, settled, without)
    return stop, found


def added_by_bounces(
    mesh: Mesh,
    light: KnownLight,
    observations: Observations,
    kd: Float[np.ndarray, "channel"],
) -> Float[np.ndarray, "sample channel"]:
    """Estimate the radiance that bounces would add to a fit without them, roughly but soon."""
    exchange = Interreflection.of(mesh, _FEW_RAYS)
    normals = np.asarray(observations.samples.normals, float)
    to_samples = exchange.gathering(places_of(observations), normals)
    albedo, frame = np.clip(np.pi * kd, 0, 1), np.asarray(observations.frame)
    added = np.zeros(np.asarray(observations.radiance).shape)
    for number in np.unique(frame) if light.varies else [0]:
        own = frame == number if light.varies else np.ones(len(frame), bool)
        direct = direct_irradiance(mesh, light.of_frame(int(number)), _WIDE_CELL)
        added[own] = (kd * albedo * (to_samples @ exchange.total(direct, albedo)))[own]
    return added


def direct_irradiance(
    mesh: Mesh, light: KnownLight, cell: float = _CELL
) -> Float[np.ndarray, "vertex channel"]:
    """Sum the light that reaches each vertex from outside, shadows traced.

    The environment is condensed to cells of so many radians.
    """
    white = Lambertian(np.ones(light.directional.irradiance.shape[1]))
    everywhere = SurfacePlaces.of_vertices(mesh)
    # Of one photograph, so that all of it is in the first part.
    (nodes,) = exact_nodes(light, np.zeros(0, int), 1.0, cell)
    assert isinstance(nodes, LightNodes)
    found = []
    for first in range(0, len(mesh.vertices), _PLACES_AT_ONCE):
        part = slice(first, first + _PLACES_AT_ONCE)
        places = SurfacePlaces(*(np.asarray(a)[part] for a in everywhere))
        normals = mesh.normals[part]
        samples = SurfaceSamples(normals, normals)
        seen = visible_nodes(mesh, places, nodes)
        found.append(np.asarray(integral_columns(white, samples, nodes, seen))[:, 0])
    return np.concatenate(found)


def _kd(stop: Stop) -> Float[np.ndarray, "channel"]:
    """The diffuse value that the photographs show; an unknown scale of the light is in it."""
    return np.asarray(stop.fit.linear.amplitudes[0], float)


def _diffuse_of(stop: Stop) -> Float[AnyArray, "sample channel"]:
    physical = stop.problem.unknowns.unpack(jnp.asarray(stop.fit.solution.point))
    return stop.model.columns(physical.numbers).diffuse
