"""Rotations and local frames, named ``world_from_local``: columns are the local axes in the world.

A surface point's local frame has its normal as +Z.  T 2.10 writes the rotation that takes local to
global directions as R = Rz(beta) Ry(alpha) Rz(gamma), so that local +Z goes to the normal
(alpha, beta); the prose of T 2.2.3 names the axes in another order (ERRATA 1).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxrender.geometry.directions import Angle, Broadcast
from jaxrender.shapes import AnyArray, Directions, checked

Frames = Float[AnyArray, "*#batch 3 3"]


@checked
def rotation(alpha: Angle, beta: Angle, gamma: Angle) -> Float[Array, "*batch 3 3"]:
    """R = Rz(beta) Ry(alpha) Rz(gamma) (T 2.10), angles in radians, taking local to world."""
    alpha, beta, gamma = jnp.broadcast_arrays(alpha, beta, gamma)
    ca, sa = jnp.cos(alpha), jnp.sin(alpha)
    cb, sb = jnp.cos(beta), jnp.sin(beta)
    cg, sg = jnp.cos(gamma), jnp.sin(gamma)
    return _matrix(
        [
            [cb * ca * cg - sb * sg, -cb * ca * sg - sb * cg, cb * sa],
            [sb * ca * cg + cb * sg, -sb * ca * sg + cb * cg, sb * sa],
            [-sa * cg, sa * sg, ca],
        ]
    )


@checked
def world_from_local(normals: Directions) -> Float[Array, "*batch 3 3"]:
    """A right-handed frame whose third column is the unit normal (x, y, z).

    For z >= 0 it is the smallest rotation that takes +Z to the normal,
    [[1 - x^2/(1+z), -xy/(1+z), x], [-xy/(1+z), 1 - y^2/(1+z), y], [-x, -y, z]]; for z < 0 the
    corresponding one from -Z.  Hence smooth on either half, poles included; the tangents (not the
    normal) jump across z = 0, as on a sphere they must somewhere.
    """
    x, y, z = jnp.moveaxis(jnp.asarray(normals), -1, 0)
    sign = jnp.where(z < 0, -jnp.ones_like(z), jnp.ones_like(z))
    a = -1 / (sign + z)
    b = x * y * a
    return _matrix(
        [
            [1 + sign * x * x * a, b, x],
            [sign * b, sign + y * y * a, y],
            [-sign * x, -y, z],
        ]
    )


@checked
def meridian_frames(normals: Directions) -> Float[Array, "*batch 3 3"]:
    """Rz(beta) Ry(alpha) of normals (alpha, beta): the first column runs along the meridian, south.

    Where an anisotropic surface has its tangent.  At the poles beta counts as 0.  There, and nearer
    to them than the root of a rounding, the derivative is that of the smallest rotation: it lacks
    the turn about the normal, which grows without bound and which isotropic reflection ignores.
    """
    x, y, z = jnp.moveaxis(jnp.asarray(normals), -1, 0)
    squared = x * x + y * y
    pole = squared < jnp.finfo(squared.dtype).tiny
    # The root of zero has no derivative, so there it is not taken.
    sine = jnp.sqrt(jnp.where(pole, 1, squared))
    cb, sb = jnp.where(pole, 1, x / sine), jnp.where(pole, 0, y / sine)
    # Rounding of gradients grows as that turn does.
    near = squared < jnp.finfo(squared.dtype).eps
    cb, sb = (jnp.where(near, jax.lax.stop_gradient(wave), wave) for wave in (cb, sb))
    # Zero, but not its derivative: the axes stay at right angles.
    across = jnp.where(near, (sb * x - cb * y) * z, 0)
    sine = jnp.where(near, cb * x + sb * y, sine)
    return _matrix([[z * cb, -sb, x], [z * sb, cb, y], [-sine, across, z]])


@checked
def to_world(world_from_local: Frames, directions: Broadcast) -> Float[Array, "*batch 3"]:
    """Directions given in local frames, expressed in the world: R d."""
    return jnp.einsum("...ij,...j->...i", world_from_local, directions, precision="highest")


@checked
def to_local(world_from_local: Frames, directions: Broadcast) -> Float[Array, "*batch 3"]:
    """Directions given in the world, expressed in local frames: R^T d."""
    return jnp.einsum("...ij,...i->...j", world_from_local, directions, precision="highest")


def _matrix(rows: list[list[jax.Array]]) -> jax.Array:
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)
