"""Light that parts of a concave object send to one another, by any material.

From where a ray of place x meets the object, x gets

    L(y, w) = sum_l a_l int S_l(y; w_i, w) L_0(w_i) V(y, w_i) dw_i + albedo / pi E_b(y)

The first part is how every lobe of y, gloss included, reflects the light from outside.  In the
second, E_b is the irradiance by light that has bounced before; a matt surface of the same albedo
stands for y there.  At vertices

    E_b = E_1 + albedo G E_b

with G of ``interreflection`` and E_1 what arrives after one bounce.  The directions and radiances
are nodes of a light: each place has its own.  So every lobe of x reflects them as it does other
light.  Some rays are spread as a cosine, others as GGX facets would mirror them.  Each counts by
how densely both kinds lie there (Veach's balance heuristic).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Lambertian, Parametric
from jaxrender.geometry import Mesh, SurfacePlaces, SurfaceSamples, world_from_local
from jaxrender.lighting import LightNodes
from jaxrender.programs import stored
from jaxrender.reflection.integral import FrameNodes, integral_columns, visible_nodes
from jaxrender.reflection.interreflection import Interreflection, Met, cosine_rays, met_along
from jaxrender.reflection.transfer import interpolated
from jaxrender.shapes import Array, Bool, Float, Int, as_jax

# Places that meet the light from outside at once; as many each time, for one program.
_AT_ONCE = 4096
# Rays of every vertex by which gloss sends it light.
_VERTEX_RAYS = 64
# Rays that bring something are counted in steps of so many.
_SLOTS = 16
_GOLDEN = np.pi * (3 - np.sqrt(5))


class Rays(NamedTuple):
    """Directions of every place, and the solid angle that each stands for."""

    directions: Float[np.ndarray, "place ray 3"]
    solid_angles: Float[np.ndarray, "place ray"]

    @classmethod
    def of(
        cls, samples: SurfaceSamples, width: float, matt: int, glossy: int, seed: int = 0
    ) -> "Rays":
        """Spread ``matt`` rays as a cosine and ``glossy`` ones as facets of a width mirror them."""
        normals, outgoing = (np.asarray(part, float) for part in samples)
        turns = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(normals))
        around, mirrored = cosine_rays(normals, turns, matt), np.empty((len(normals), 0, 3))
        if glossy:
            facets = _facets(normals, turns, width, glossy)
            towards = np.einsum("pri,pi->pr", facets, outgoing)[..., None]
            mirrored = 2 * towards * facets - outgoing[:, None]
        directions = np.concatenate([around, mirrored], axis=1)
        cosines = np.einsum("pri,pi->pr", directions, normals)
        density = matt * np.maximum(cosines, 0) / np.pi
        if glossy:
            density = density + glossy * _mirrored_density(directions, normals, outgoing, width)
        above = cosines > 0
        return cls(directions, np.where(above, 1 / np.where(above, density, 1), 0))


class Gathered(NamedTuple):
    """Rays of places, and where they meet the object: traced once, lit again and again."""

    rays: Rays
    met: Met

    @classmethod
    def along(cls, mesh: Mesh, places: SurfacePlaces, rays: Rays) -> "Gathered":
        """Trace the rays of places."""
        return cls(rays, met_along(mesh, places, rays.directions))

    def nodes(self, senders: Sequence["Sender"], sender: Int[np.ndarray, "place"]) -> FrameNodes:
        """Make a light for every place of what it is sent; ``sender`` says by which of all."""
        place, ray = self.met.place, self.met.ray
        directions = self.rays.directions[place, ray]
        radiance = np.zeros((len(place), senders[0].outside.irradiance.shape[1]))
        for number, one in enumerate(senders):
            own = sender[place] == number
            met = Met(*(part[own] for part in self.met))
            radiance[own] = one.radiance(met, directions[own])
        # Rays come place by place: those that meet something are put one after the other.
        places = len(sender)
        counts = np.bincount(place, minlength=places)
        slot = np.arange(len(place)) - np.repeat(np.cumsum(counts) - counts, counts)
        # Few shapes, so that few programs are compiled.
        most = -(-max(int(counts.max(initial=0)), 1) // _SLOTS) * _SLOTS
        towards = np.tile([0.0, 0.0, 1.0], (places, most, 1))
        towards[place, slot] = directions
        irradiance = np.zeros((places, most, radiance.shape[1]))
        irradiance[place, slot] = self.rays.solid_angles[place, ray, None] * radiance
        return FrameNodes(towards, irradiance, np.arange(places))


class Outside(NamedTuple):
    """A light on a mesh: its nodes, the irradiance of every vertex, and which nodes it sees.

    The last is packed, 8 nodes a byte, and there where somebody asks for gloss.
    """

    nodes: LightNodes
    irradiance: Float[np.ndarray, "vertex channel"]
    seen: np.ndarray | None = None

    @classmethod
    def on(cls, mesh: Mesh, nodes: LightNodes, glossy: bool) -> "Outside":
        """Trace the shadows on the vertices, so many at once."""
        white = Lambertian(np.ones(nodes.irradiance.shape[1]))
        everywhere = SurfacePlaces.of_vertices(mesh)
        irradiance, packed = [], []
        for first in range(0, len(mesh.vertices), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            places = SurfacePlaces(*(np.asarray(a)[part] for a in everywhere))
            samples = SurfaceSamples(mesh.normals[part], mesh.normals[part])
            seen = visible_nodes(mesh, places, nodes)
            irradiance.append(np.asarray(integral_columns(white, samples, nodes, seen))[:, 0])
            if glossy:
                packed.append(np.packbits(seen, axis=1))
        return cls(nodes, np.concatenate(irradiance), np.concatenate(packed) if glossy else None)

    def seen_by(self, vertices: Int[np.ndarray, "place"]) -> Bool[np.ndarray, "place node"]:
        """Tell which nodes some vertices see."""
        assert self.seen is not None
        count = self.nodes.directions.shape[0]
        return np.unpackbits(self.seen[vertices], axis=1, count=count).astype(bool)


class Exchange(NamedTuple):
    """What the vertices of a mesh see of each other: all of it, and along a few rays for gloss."""

    diffuse: Interreflection
    around: Gathered | None

    @classmethod
    def of(cls, mesh: Mesh, glossy: bool) -> "Exchange":
        """Trace from every vertex."""
        exchange = Interreflection.of(mesh)
        if not glossy:
            return cls(exchange, None)
        rays = Rays.of(SurfaceSamples(mesh.normals, mesh.normals), 1.0, _VERTEX_RAYS, 0)
        return cls(exchange, Gathered.along(mesh, SurfacePlaces.of_vertices(mesh), rays))


class Sender(NamedTuple):
    """A lit object that sends light on: ``bounced`` is the irradiance E_b of its vertices."""

    mesh: Mesh
    brdf: Parametric
    outside: Outside
    bounced: Float[np.ndarray, "vertex channel"]

    @classmethod
    def of(cls, exchange: Exchange, brdf: Parametric, outside: Outside) -> "Sender":
        """Follow all bounces."""
        mesh, direct = exchange.diffuse.mesh, outside.irradiance
        sender = cls(mesh, brdf, outside, np.zeros_like(direct))
        once = np.pi * sender.base * (exchange.diffuse.among_vertices @ direct)
        if exchange.around is not None and is_glossy(brdf):
            rays, met = exchange.around
            arrived = np.zeros_like(direct)
            sent = sender.by_gloss(met, rays.directions[met.place, met.ray])
            np.add.at(arrived, met.place, np.pi / _VERTEX_RAYS * sent)
            once = once + arrived
        return sender._replace(bounced=exchange.diffuse.total(once, sender.albedo))

    @property
    def base(self) -> Float[np.ndarray, "channel"]:
        """What the Lambertian bases have together, in 1/sr."""
        brdf = self.brdf
        parts = [np.asarray(getattr(brdf, name), float) for name in brdf.bases]
        return np.sum([np.zeros(self.outside.irradiance.shape[1]), *parts], axis=0)

    @property
    def albedo(self) -> Float[np.ndarray, "channel"]:
        """About how much is sent on of light from everywhere, at most all."""
        brdf = self.brdf
        gloss = np.asarray(brdf.lobe_amplitude) * float(brdf.energy)
        return np.clip(np.pi * np.asarray(brdf.base_amplitude) + gloss, 0, 1)

    def radiance(
        self, met: Met, directions: Float[np.ndarray, "met 3"]
    ) -> Float[np.ndarray, "met channel"]:
        """Evaluate what is sent against rays, from where they meet the object."""
        field = self.base * self.outside.irradiance + self.albedo / np.pi * self.bounced
        matt = interpolated(field, self.mesh.faces, met.face, met.barycentric)
        return matt + self.by_gloss(met, directions) if is_glossy(self.brdf) else matt

    def by_gloss(
        self, met: Met, directions: Float[np.ndarray, "met 3"]
    ) -> Float[np.ndarray, "met channel"]:
        """Evaluate what all lobes but the bases send of the light from outside."""
        mesh, at = self.mesh, self.brdf.shaped()
        normals = interpolated(mesh.normals, mesh.faces, met.face, met.barycentric)
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        corner = np.argmax(met.barycentric, axis=1)
        nearest = mesh.faces[met.face][np.arange(len(corner)), corner]
        amplitudes = np.asarray(self.brdf.amplitudes)[list(at)]
        sent = np.zeros((len(normals), amplitudes.shape[1]))
        for first in range(0, len(normals), _AT_ONCE):
            rows = np.arange(first, min(first + _AT_ONCE, len(normals)))
            filled = np.resize(rows, _AT_ONCE)
            samples = SurfaceSamples(normals[filled], -directions[filled])
            seen = as_jax(self.outside.seen_by(nearest[filled]))
            columns = np.asarray(_columns(self.brdf, samples, self.outside.nodes, seen))
            sent[rows] = np.einsum("slc,lc->sc", columns[: len(rows), list(at)], amplitudes)
        return sent


def is_glossy(brdf: Parametric) -> bool:
    """Whether a material has more than Lambertian bases."""
    return bool(np.any(np.asarray(brdf.amplitudes)[list(brdf.shaped())]))


@stored(effort="less")
def _columns(
    brdf: Parametric, samples: SurfaceSamples, nodes: LightNodes, seen: Bool[Array, "sample node"]
) -> Float[Array, "sample lobe channel"]:
    return integral_columns(brdf, samples, nodes, seen)


def _facets(
    normals: Float[np.ndarray, "place 3"],
    turns: Float[np.ndarray, "place"],
    width: float,
    count: int,
) -> Float[np.ndarray, "place facet 3"]:
    """Spread the normals of GGX facets by how much of the surface they cover."""
    index = np.arange(count)
    covered = (index + 0.5) / count
    tangent = width * np.sqrt(covered / (1 - covered))
    azimuth = index * _GOLDEN + turns[:, None]
    local = np.stack(
        [tangent * np.cos(azimuth), tangent * np.sin(azimuth), np.ones_like(azimuth)], axis=-1
    )
    local = local / np.sqrt(1 + tangent**2)[:, None]
    return np.einsum("pij,prj->pri", np.asarray(world_from_local(normals)), local)


def _mirrored_density(
    directions: Float[np.ndarray, "place ray 3"],
    normals: Float[np.ndarray, "place 3"],
    outgoing: Float[np.ndarray, "place 3"],
    width: float,
) -> Float[np.ndarray, "place ray"]:
    """Evaluate D(h) cos t_h / (4 w_o . h): how densely mirrored rays lie, per steradian."""
    half = directions + outgoing[:, None]
    half = half / np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-12)
    cosine = np.maximum(np.einsum("pri,pi->pr", half, normals), 1e-6)
    towards = np.maximum(np.einsum("pri,pi->pr", half, outgoing), 1e-6)
    stretched = 1 - cosine**2 + (width * cosine) ** 2
    return width**2 * cosine / (np.pi * stretched**2) / (4 * towards)
