"""Surfaces whose faces have BRDFs of their own, and what happens where a ray meets one.

A face reflects in the frame of its *geometric* normal, which smooth normals would only approximate:
what is measured is the mesh itself.  The frame's x axis is the face's tangent if the scene has
tangents, else that of ``world_from_local``.  A face seen from behind is black, unless the scene is
two-sided.

Rays and hits are NumPy on the host; BRDFs are evaluated by JAX in batches padded to powers of two,
so that few shapes are ever compiled.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.brdf.samplers import COSINE, DirectionSampler
from jaxrender.geometry import Components, Shape
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int

# Distance of a new ray's origin from the surface, as part of the shape's diagonal.
_OFFSET = 1e-4
# Batches are padded to at least this.
_LEAST_BATCH = 64
# Closer to the normal than this a tangent does not tell an x axis.
_UPRIGHT = 1e-9


class Scene(NamedTuple):
    """A shape and its materials; ``Scene.of`` makes a checked one."""

    shape: Shape
    brdfs: tuple[BRDF, ...]
    material: Int[np.ndarray, "face"] | None
    """An index into ``brdfs`` for each face; None: the first is everywhere."""
    tangents: Float[np.ndarray, "face 3"] | None
    samplers: tuple[DirectionSampler, ...]
    """One for each BRDF."""
    two_sided: bool

    @classmethod
    def of(
        cls,
        shape: Shape,
        brdfs: Sequence[BRDF],
        material: Int[AnyArray, "face"] | None = None,
        *,
        tangents: Float[AnyArray, "face 3"] | None = None,
        samplers: Sequence[DirectionSampler] | None = None,
        two_sided: bool = False,
    ) -> "Scene":
        """Put a scene together.

        Raises ``ValueError`` for no BRDF, BRDFs of different channels, materials without a BRDF,
        and samplers that are not one for each.
        """
        channels = {np.shape(brdf.amplitudes)[1] for brdf in brdfs}
        if len(channels) != 1:
            raise ValueError(f"BRDFs of {sorted(channels)} channels: give one or more, all alike")
        chosen = None if material is None else np.asarray(material, int)
        if chosen is not None and not (chosen.min() >= 0 and chosen.max() < len(brdfs)):
            raise ValueError(
                f"faces have materials {chosen.min()} to {chosen.max()}, and there are "
                f"{len(brdfs)} BRDFs: give one for each material"
            )
        drawn = tuple(samplers) if samplers is not None else (COSINE,) * len(brdfs)
        if len(drawn) != len(brdfs):
            raise ValueError(f"{len(drawn)} samplers for {len(brdfs)} BRDFs: give one for each")
        along = None if tangents is None else np.asarray(tangents, float)
        return cls(shape, tuple(brdfs), chosen, along, drawn, two_sided)

    @property
    def channels(self) -> int:
        """How many colour channels the BRDFs have."""
        return int(np.shape(self.brdfs[0].amplitudes)[1])


class Vertices(NamedTuple):
    """Where paths met the surface from the front."""

    ray: Int[np.ndarray, "vertex"]
    """The row of the ray that came here."""
    points: Float[np.ndarray, "vertex 3"]
    """Moved off the surface: where new rays start."""
    frames: Float[np.ndarray, "vertex 3 3"]
    outgoing: Float[np.ndarray, "vertex 3"]
    """The way back along the ray, in the local frame."""
    material: Int[np.ndarray, "vertex"]

    def take(self, rows: Bool[np.ndarray, "vertex"] | Int[np.ndarray, "taken"]) -> "Vertices":
        """Select some."""
        return Vertices(*(field[rows] for field in self))

    def to_local(self, directions: Float[np.ndarray, "vertex 3"]) -> Float[np.ndarray, "vertex 3"]:
        """Turn a world direction for each vertex into its frame."""
        return np.einsum("vij,vi->vj", self.frames, directions)

    def to_world(self, directions: Float[np.ndarray, "vertex 3"]) -> Float[np.ndarray, "vertex 3"]:
        """Turn a local direction of each vertex into the world."""
        return np.einsum("vij,vj->vi", self.frames, directions)


class TracedRays(NamedTuple):
    """Where rays met a surface from the front, and how far each ray went (inf: past everything)."""

    vertices: Vertices
    distance: Float[np.ndarray, "ray"]


class DrawnDirections(NamedTuple):
    """Local incoming directions, and the density per steradian with which they were drawn."""

    incoming: Float[np.ndarray, "vertex 3"]
    density: Float[np.ndarray, "vertex"]


def trace(
    scene: Scene, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
) -> TracedRays:
    """Follow rays to the first surface; vertices are where it faces them."""
    hits = scene.shape.first_hits(origins, directions)
    normals = hits.geometric_normals
    facing = -np.einsum("ri,ri->r", normals, directions)
    if scene.two_sided:
        normals = np.where(facing[:, None] < 0, -normals, normals)
        facing = np.abs(facing)
    row = np.flatnonzero(hits.hit & (facing > 0))
    face, upwards = hits.face[row], normals[row]
    points = hits.points[row] + _OFFSET * scene.shape.diagonal() * upwards
    along = None if scene.tangents is None else scene.tangents[face]
    frames = _frames(upwards, along)
    outgoing = np.einsum("vij,vi->vj", frames, -directions[row])
    material = np.zeros(len(row), int) if scene.material is None else scene.material[face]
    return TracedRays(Vertices(row, points, frames, outgoing, material), hits.distance)


def reflected(
    scene: Scene, vertices: Vertices, incoming: Float[np.ndarray, "vertex 3"]
) -> Float[np.ndarray, "vertex channel"]:
    """Evaluate rho cos t_i for a local incoming direction of each vertex."""
    values = np.zeros((len(vertices.ray), scene.channels))
    for index, rows in _by_material(scene, vertices):
        own = _padded(incoming[rows]), _padded(vertices.outgoing[rows])
        values[rows] = np.asarray(_transfer(scene.brdfs[index], *own))[: len(rows)]
    return values


def reflected_pairs(
    scene: Scene, vertices: Vertices, directions: Float[np.ndarray, "direction 3"]
) -> Float[np.ndarray, "vertex direction channel"]:
    """Evaluate rho cos t_i for all pairs of a vertex and a world direction; shadows left out."""
    values = np.zeros((len(vertices.ray), len(directions), scene.channels))
    for index, rows in _by_material(scene, vertices):
        frames, outgoing = _padded(vertices.frames[rows]), _padded(vertices.outgoing[rows])
        found = _pair_transfer(scene.brdfs[index], frames, outgoing, directions)
        values[rows] = np.asarray(found)[: len(rows)]
    return values


def continued(
    scene: Scene, vertices: Vertices, uniforms: Float[np.ndarray, "vertex 2"]
) -> DrawnDirections:
    """Draw local incoming directions by the materials' samplers.

    Where nothing can be drawn the density is zero.
    """
    incoming, density = np.zeros_like(vertices.outgoing), np.zeros(len(vertices.ray))
    for index, rows in _by_material(scene, vertices):
        sampler, outgoing = scene.samplers[index], vertices.outgoing[rows]
        drawn = np.asarray(sampler.draw(outgoing, uniforms[rows]), float)
        incoming[rows] = drawn
        density[rows] = np.asarray(sampler.density(outgoing, drawn), float)
    return DrawnDirections(incoming, density)


def density_of(
    scene: Scene, vertices: Vertices, incoming: Float[np.ndarray, "vertex 3"]
) -> Float[np.ndarray, "vertex"]:
    """Evaluate the density with which ``continued`` draws these directions."""
    density = np.zeros(len(vertices.ray))
    for index, rows in _by_material(scene, vertices):
        own = vertices.outgoing[rows], incoming[rows]
        density[rows] = np.asarray(scene.samplers[index].density(*own), float)
    return density


@eqx.filter_jit
def _transfer(
    brdf: BRDF, incoming: Float[Array, "pair 3"], outgoing: Float[Array, "pair 3"]
) -> Float[Array, "pair channel"]:
    return _summed(brdf, Components.of(incoming), Components.of(outgoing))


@eqx.filter_jit
def _pair_transfer(
    brdf: BRDF,
    frames: Float[Array, "vertex 3 3"],
    outgoing: Float[Array, "vertex 3"],
    directions: Float[AnyArray, "direction 3"],
) -> Float[Array, "vertex direction channel"]:
    local = jnp.einsum("vij,di->vdj", frames, directions, precision="highest")
    there = jnp.broadcast_to(outgoing[:, None, :], local.shape)
    return _summed(brdf, Components.of(local), Components.of(there))


def _summed(brdf: BRDF, incoming: Components, outgoing: Components) -> Array:
    lobes = jnp.stack(brdf.transfer(incoming, outgoing), axis=-1)
    amplitudes = jnp.asarray(brdf.amplitudes, lobes.dtype)
    return jnp.einsum("...k,kc->...c", lobes, amplitudes, precision="highest")


def _by_material(scene: Scene, vertices: Vertices) -> list[tuple[int, np.ndarray]]:
    """The rows of each material that there is."""
    rows = [np.flatnonzero(vertices.material == index) for index in range(len(scene.brdfs))]
    return [(index, own) for index, own in enumerate(rows) if len(own)]


def _padded(rows: np.ndarray) -> Array:
    """To the next power of two, by repeating the first row, which is a valid one."""
    wanted = max(_LEAST_BATCH, 1 << (len(rows) - 1).bit_length())
    return jnp.asarray(np.concatenate([rows, np.repeat(rows[:1], wanted - len(rows), axis=0)]))


def _frames(normals: np.ndarray, tangents: np.ndarray | None) -> np.ndarray:
    """Frames about unit normals, as ``geometry.world_from_local`` but on the host."""
    x, y, z = normals.T
    sign = np.where(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    first = np.stack([1 + sign * x * x * a, sign * x * y * a, -sign * x], axis=-1)
    if tangents is not None:
        flat = tangents - np.einsum("vi,vi->v", tangents, normals)[:, None] * normals
        length = np.linalg.norm(flat, axis=1, keepdims=True)
        first = np.where(length > _UPRIGHT, flat / np.maximum(length, _UPRIGHT), first)
    return np.stack([first, np.cross(normals, first), normals], axis=-1)
