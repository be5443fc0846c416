"""Interreflections of a concave object, found along with its material (T 6.6).

T 6.6 proposes to iterate, as Yu et al. do.  With the material found so far, compute the light that
bounces between parts of the object; give it to the model as more light, and fit again.  The secant
of two rounds gives the albedo for which the supposed and the found one agree.

Light that has bounced once is sent on by every lobe as it is, gloss included, and light that has
bounced more often as by a matt surface (``reflection.indirect``).  Every lobe reflects both.  Error
bars take the bounced light as known.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.geometry import Mesh, Shape, SurfacePlaces, SurfaceSamples, SurfaceView
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import Columns, ExactModel, Model, Numbers, Rows, columns_under
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.passes import Stop
from jaxrender.inverse.shadowing import hidden_fraction, places_of
from jaxrender.lighting import LightNodes
from jaxrender.programs import stored
from jaxrender.reflection import FrameNodes, interpolated
from jaxrender.reflection.indirect import Exchange, Gathered, Outside, Rays, Sender, is_glossy
from jaxrender.reflection.interreflection import Interreflection
from jaxrender.shapes import AnyArray, Array, Float

# The light from outside is condensed to cells of so many radians, where it bounces.
_CELL = 0.1
# A rough estimate takes wider cells, and fewer rays a vertex.
_WIDE_CELL, _FEW_RAYS = 0.25, 64
# Rays of each sample, spread as a cosine and about the mirror direction; of each pixel as many.
_MATT_RAYS, _GLOSSY_RAYS, _PIXEL_RAYS = 512, 128, 64
# Rounds until no amplitude moves by more than this part of the largest.
_SETTLED, _MOST_ROUNDS = 1e-4, 12
# Pixels whose rays are traced at once.
_PLACES_AT_ONCE = 4096


class WithBounced(eqx.Module):
    """A model under more light than its own: that which comes from the object itself."""

    model: Model
    bounced: ExactModel

    def columns(self, numbers: Numbers) -> Columns:
        """Add up the columns of both lights."""
        own, more = self.model.columns(numbers), self.bounced.columns(numbers)
        return Columns(*(a + b for a, b in zip(own, more, strict=True)), shaped=own.shaped)

    def take(self, index: Rows) -> "WithBounced":
        """Keep the samples of the given indices."""
        return WithBounced(self.model.take(index), self.bounced.take(index))


class Bounced(NamedTuple):
    """The light that bounces: what the mesh sends in each photograph (one where all share it).

    ``part`` is what it adds to the samples' radiance, on average; ``rounds`` says how many fits it
    took, ``settled`` whether that was enough.
    """

    senders: tuple[Sender, ...]
    part: float
    rounds: int
    settled: bool
    kd_without: Float[np.ndarray, "channel"]

    def radiance(
        self, brdf: Parametric, view: SurfaceView, frame: int
    ) -> Float[np.ndarray, "pixel channel"]:
        """Find what bounced light adds at the pixels of photograph ``frame`` that hit the mesh."""
        sender = self.senders[frame if len(self.senders) > 1 else 0]
        at = view.face[view.hit], view.barycentric[view.hit]
        bounced = interpolated(sender.bounced, sender.mesh.faces, *at)
        found = sender._replace(brdf=brdf).base * bounced
        if not is_glossy(sender.brdf):
            return found
        lobes, count = [*brdf.shaped()], len(found)
        amplitudes = np.asarray(brdf.amplitudes)[lobes]
        for first in range(0, count, _PLACES_AT_ONCE):
            # As many each time, for one program.
            rows = np.resize(np.arange(first, min(first + _PLACES_AT_ONCE, count)), _PLACES_AT_ONCE)
            places = SurfacePlaces(
                *(part[view.hit][rows] for part in (view.points, view.geometric_normals))
            )
            samples = SurfaceSamples(
                *(part[view.hit][rows] for part in (view.normals, view.outgoing))
            )
            rays = Rays.of(samples, float(brdf.width), _PIXEL_RAYS, _PIXEL_RAYS)
            gathered = Gathered.along(sender.mesh, places, rays)
            nodes = gathered.nodes((sender,), np.zeros(len(rows), int))
            columns = np.asarray(_columns(brdf, samples, nodes))[:, lobes]
            found[rows] += np.einsum("slc,lc->sc", columns, amplitudes)
        return found


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
    """One round: the amplitudes that bounced, and those that were found with those bounces."""

    supposed: Float[np.ndarray, "lobe channel"]
    found: Float[np.ndarray, "lobe channel"]

    def next(self, before: "_Round | None") -> Float[np.ndarray, "lobe channel"]:
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

    @property
    def moved(self) -> float:
        """How far the amplitudes are from those supposed, as a part of the largest."""
        return float(np.max(np.abs(self.found - self.supposed)) / np.max(np.abs(self.found)))


def fit_with_bounces(
    stop: Stop,
    material: Callable[[Stop], Parametric],
    shape: Shape,
    light: KnownLight,
    refit: Callable[[Stop, ExactModel], Stop],
) -> tuple[Stop, Bounced]:
    """Fit and bounce in turn until the amplitudes settle.

    ``material`` says what a fit has found, and ``refit`` continues one under the bounced light of
    its samples as well.  Raises ``ValueError`` for a concave shape that is no mesh, whose vertices
    are to hold the light.
    """
    if not isinstance(shape, Mesh):
        raise ValueError("interreflections are computed on a mesh's vertices: give a mesh")
    observed, variant = stop.observations, material(stop)
    glossy = is_glossy(variant)
    exchange = Exchange.of(shape, glossy)
    frames = np.asarray(observed.frame) if light.varies else np.zeros(observed.count, int)
    lit = [outside(shape, light.of_frame(k), glossy) for k in range(light.frames)]
    mirrored = _GLOSSY_RAYS if glossy else 0
    rays = Rays.of(observed.samples, float(variant.width), _MATT_RAYS, mirrored)
    gathered = Gathered.along(shape, places_of(observed), rays)
    without = supposed = _amplitudes(stop)
    before: _Round | None = None
    rounds, settled, senders = 0, False, ()
    while not settled and rounds < _MOST_ROUNDS:
        rounds += 1
        sent = material(stop).with_amplitudes(*supposed)
        senders = tuple(Sender.of(exchange, sent, one) for one in lit)
        nodes = gathered.nodes(senders, frames)
        stop = refit(stop, ExactModel(variant, observed.samples, (nodes,)))
        now = _Round(supposed, _amplitudes(stop))
        settled = now.moved <= _SETTLED
        before, supposed = now, now.next(before)
    added = np.asarray(_columns(material(stop), observed.samples, nodes))
    more = float(np.sum(added * _amplitudes(stop)[None]))
    part = more / max(float(np.sum(np.asarray(stop.fit.predicted))) - more, 1e-300)
    return stop, Bounced(senders, part, rounds, settled, without[0])


@stored(effort="less")
def _columns(
    brdf: Parametric, samples: SurfaceSamples, nodes: FrameNodes
) -> Float[Array, "sample lobe channel"]:
    return columns_under(brdf, samples, nodes)


def outside(mesh: Mesh, light: KnownLight, glossy: bool, cell: float = _CELL) -> Outside:
    """Trace the light of one photograph to each vertex, its environment in cells of some radians.

    ``glossy`` keeps which parts of it every vertex sees.
    """
    if light.near is not None:
        raise ValueError("bounced light is not followed from sources that have a place")
    # Of one photograph, so that all of it is in one part.
    (nodes,) = exact_nodes(light, None, 1.0, cell)
    assert isinstance(nodes, LightNodes)
    return Outside.on(mesh, nodes, glossy)


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
        direct = outside(mesh, light.of_frame(int(number)), False, _WIDE_CELL).irradiance
        added[own] = (kd * albedo * (to_samples @ exchange.total(direct, albedo)))[own]
    return added


def _amplitudes(stop: Stop) -> Float[np.ndarray, "lobe channel"]:
    """The amplitudes that the photographs show; an unknown scale of the light is in them."""
    return np.asarray(stop.fit.linear.amplitudes, float)
