"""Direct light from luminaires and point lights at points of surfaces (L 6.1, 6.2).

    L_r(x, w_r) = int over A of f_r(w_i, w_r) L_e(x', -w_i) g cos t_i cos t_e / r^2 dA

over the luminaire's area, w_i from x towards x'.  L 5.1 leaves out cos t_e g / r^2 and L 6.7 puts a
4 before the integral and leaves out dA = |dx'/du x dx'/dv| du dv (ERRATA 66, 69); there is no 4,
since the integral is over area.  f_r is asked in the frame at x, L_e in the luminaire's own at x'.
Of a point light the same is I(-w_s) f_r cos t_s / r^2 (L 6.4; ERRATA 67, 68).

g is 0 where the luminaire itself or an ``occluder`` stands in between.  Rays are traced on the host
in float64; the rest follows the dtype of the points, and is differentiable in the BRDF, in the
trees' values and in the intensity.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.geometry import NUSSELT, Components, Shape, to_local, world_from_local
from jaxrender.lighting.luminaires.luminaire import Luminaire
from jaxrender.lighting.luminaires.surfaces import SurfacePoints
from jaxrender.lighting.positional import PointLight
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int

# Pairs of a point and a node worked on at once.
_PAIRS_AT_ONCE = 1 << 18
# Rays start above the surface, and end before the light, by this part of the occluder's diagonal.
_OFFSET = 1e-4
# A luminaire hides a place of its own if it is met nearer than this part of the distance.
_BEFORE = 1 - 1e-5
# Batches are padded to powers of two, at least this, so that few sizes are compiled.
_LEAST_BATCH = 64


class ShadedPoints(NamedTuple):
    """Points, their frames (columns: two tangents and the normal), and where they are seen from."""

    points: Float[AnyArray, "point 3"]
    frames: Float[AnyArray, "point 3 3"]
    outgoing: Float[AnyArray, "point 3"]
    """Unit world directions, away from the surface."""

    @classmethod
    def of(
        cls,
        points: Float[AnyArray, "point 3"],
        normals: Float[AnyArray, "point 3"],
        outgoing: Float[AnyArray, "point 3"],
    ) -> "ShadedPoints":
        """Put any frames about the normals: enough for isotropic BRDFs."""
        return cls(points, world_from_local(normals), outgoing)


class ParameterRule(NamedTuple):
    """Places (u, v) and weights, in sum 1, that integrate over the unit square."""

    places: Float[np.ndarray, "node 2"]
    weights: Float[np.ndarray, "node"]


def gauss_rule(count: int) -> ParameterRule:
    """Return Gauss and Legendre's rule of count x count nodes: for smooth light, not too near.

    Raises ``ValueError`` for a count below 1.
    """
    if count < 1:
        raise ValueError(f"{count} nodes along each axis; give at least one")
    nodes, weights = np.polynomial.legendre.leggauss(count)
    line = (nodes + 1) / 2
    places = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    return ParameterRule(places, np.outer(weights, weights).ravel() / 4)


def cell_rule(size: int) -> ParameterRule:
    """Return the midpoints of size x size cells: for a tree of so many samples along each axis.

    Raises ``ValueError`` for a size below 1.
    """
    places = NUSSELT.centres((size, size)).reshape(-1, 2)
    return ParameterRule(places, np.full(len(places), 1 / len(places)))


def direct_light(
    shaded: ShadedPoints,
    brdf: BRDF,
    luminaire: Luminaire,
    rule: ParameterRule,
    occluder: Shape | None = None,
) -> Float[Array, "point channel"]:
    """Integrate a luminaire's light over its area, by a rule for each patch; radiance, as L_e.

    Points on the occluder are allowed: rays start a little above them.
    """
    on = [surface.at(rule.places) for surface in luminaire.patches]
    step = max(_PAIRS_AT_ONCE // len(rule.places), 1)
    found = []
    for first in range(0, max(len(shaded.points), 1), step):
        some = ShadedPoints(*(part[first : first + step] for part in shaded))
        total = jnp.zeros((len(some.points), luminaire.channels), _dtype(shaded))
        for index, patch in enumerate(on):
            pairs = _lit_pairs(some, patch, luminaire, occluder)
            if len(pairs.point):
                total = total + _patch_light(some, brdf, luminaire, index, rule, pairs)
        found.append(total)
    return jnp.concatenate(found)


def from_point_light(
    shaded: ShadedPoints, brdf: BRDF, light: PointLight, occluder: Shape | None = None
) -> Float[Array, "point channel"]:
    """Evaluate I(-w_s) f_r cos t_s / r^2, zero in the occluder's shadow."""
    arrival = light.arriving(jnp.asarray(shaded.points))
    irradiance = arrival.intensity / (arrival.distance**2)[:, None]
    if occluder is not None:
        goal = np.broadcast_to(np.asarray(light.position, float), np.shape(shaded.points))
        seen = unobstructed(occluder, shaded, goal)
        irradiance = jnp.where(jnp.asarray(seen)[:, None], irradiance, 0)
    frames = jnp.asarray(shaded.frames)
    incoming, outgoing = (
        Components.of(to_local(frames, jnp.asarray(d, frames.dtype)))
        for d in (arrival.directions, shaded.outgoing)
    )
    return _transferred(brdf, incoming, outgoing) * irradiance


def unobstructed(
    occluder: Shape, shaded: ShadedPoints, goals: Float[np.ndarray, "point 3"]
) -> Bool[np.ndarray, "point"]:
    """Trace whether each point sees its goal past a shape, on which either of them may lie."""
    normals = np.asarray(shaded.frames, float)[:, :, 2]
    offset = _OFFSET * occluder.diagonal()
    origins = np.asarray(shaded.points, float) + offset * normals
    towards = goals - origins
    distance = np.linalg.norm(towards, axis=1)
    met = np.full(len(goals), np.inf)
    far = np.flatnonzero(distance > offset)
    if len(far):
        met[far] = occluder.first_hits(origins[far], towards[far]).distance
    return met >= distance - offset


class _Pairs(NamedTuple):
    """Points and nodes that see each other's front sides, with the geometry in between."""

    point: np.ndarray
    node: np.ndarray
    directions: np.ndarray
    """From the point to the node."""
    weights: np.ndarray
    """cos t_e / r^2 times the area of a unit of du dv."""


def _lit_pairs(
    shaded: ShadedPoints, on: SurfacePoints, luminaire: Luminaire, occluder: Shape | None
) -> _Pairs:
    points, normals = np.asarray(shaded.points, float), np.asarray(shaded.frames, float)[:, :, 2]
    towards = on.points[None] - points[:, None]
    facing = np.einsum("pni,pi->pn", towards, normals) > 0
    emitted = -np.einsum("pni,ni->pn", towards, on.normals)
    point, node = np.nonzero(facing & (emitted > 0))
    towards = towards[point, node]
    distance = np.linalg.norm(towards, axis=1)
    directions = towards / distance[:, None]
    seen = np.ones(len(point), bool)
    if occluder is not None:
        rows = ShadedPoints(*(np.asarray(part)[point] for part in shaded))
        seen = unobstructed(occluder, rows, on.points[node])
    if not luminaire.convex:
        nearest = luminaire.crossings(points[point], directions).distance
        seen &= nearest >= _BEFORE * distance
    weights = emitted[point, node] * on.area[node] / distance**3
    return _Pairs(point[seen], node[seen], directions[seen], weights[seen])


def _patch_light(
    shaded: ShadedPoints,
    brdf: BRDF,
    luminaire: Luminaire,
    index: int,
    rule: ParameterRule,
    pairs: _Pairs,
) -> Float[Array, "point channel"]:
    """Add up what a patch's lit pairs contribute."""
    patch = np.full(len(pairs.node), index)
    light = luminaire.radiance(rule.places[pairs.node], -pairs.directions, patch)
    weights = pairs.weights * rule.weights[pairs.node]
    wanted = padded_length(len(pairs.point))
    dtype = _dtype(shaded)
    # What is added to make up the length has weight 0.
    arrays = (
        padded(pairs.directions, wanted, dtype),
        padded(weights, wanted, dtype),
        padded(pairs.point, wanted, np.dtype(np.int32)),
    )
    light = jnp.pad(light.astype(dtype), ((0, wanted - len(light)), (0, 0)))
    some = ShadedPoints(*(jnp.asarray(part, dtype) for part in shaded))
    return _summed(brdf, some, light, *arrays)


@eqx.filter_jit
def _summed(
    brdf: BRDF,
    shaded: ShadedPoints,
    light: Float[Array, "pair channel"],
    directions: Float[Array, "pair 3"],
    weights: Float[Array, "pair"],
    point: Int[Array, "pair"],
) -> Float[Array, "point channel"]:
    values = reflected(brdf, shaded, directions, point) * light * weights[:, None]
    return jax.ops.segment_sum(values, point, num_segments=len(shaded.points))


def reflected(
    brdf: BRDF,
    shaded: ShadedPoints,
    directions: Float[Array, "pair 3"],
    point: Int[Array, "pair"],
) -> Float[Array, "pair channel"]:
    """Evaluate f_r cos t_i for pairs of a world direction and the number of a point."""
    frames = jnp.asarray(shaded.frames)[point]
    incoming = to_local(frames, directions)
    outgoing = to_local(frames, jnp.asarray(shaded.outgoing)[point])
    return _transferred(brdf, Components.of(incoming), Components.of(outgoing))


def padded_length(count: int) -> int:
    """Return the next power of two that a batch is padded to."""
    return max(_LEAST_BATCH, 1 << max(count - 1, 0).bit_length())


def padded(rows: np.ndarray, wanted: int, dtype: np.dtype) -> Array:
    """Make up the length with zeros."""
    whole = np.zeros((wanted, *rows.shape[1:]), dtype)
    whole[: len(rows)] = rows
    return jnp.asarray(whole)


def _transferred(
    brdf: BRDF, incoming: Components, outgoing: Components
) -> Float[Array, "pair channel"]:
    lobes = jnp.stack(brdf.transfer(incoming, outgoing), axis=-1)
    amplitudes = jnp.asarray(brdf.amplitudes, lobes.dtype)
    return jnp.einsum("pk,kc->pc", lobes, amplitudes, precision="highest")


def _dtype(shaded: ShadedPoints) -> np.dtype:
    return np.dtype(jax.dtypes.canonicalize_dtype(np.asarray(shaded.points).dtype))
