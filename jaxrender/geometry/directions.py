"""Directions as unit vectors: the device-side vocabulary of the whole package.

World: right-handed, +Z up.  A direction with polar angle t (from +Z) and azimuth p (from +X towards
+Y) is (sin t cos p, sin t sin p, cos t).  All directions point *away* from the surface, incoming
ones too.  Functions here are jit-able, keep the dtype of their input, act on the last axis and
broadcast over the others.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxrender.shapes import AnyArray, Directions, as_jax, checked

# Directions that are combined with others of the same rank: lengths 1 are stretched.
Broadcast = Float[AnyArray, "*#batch 3"]
Angle = Float[AnyArray, "*#batch"] | float

# Degrees at which the interpolant of squared_angle reaches rounding on cosines 0..1: its error
# falls by 3 + sqrt(8) = 5.8 a degree, because the nearest singularity is at cosine -1.
_ANGLE_DEGREE_DOUBLE = 18
_ANGLE_DEGREE_SINGLE = 8


# Called eagerly each is one small program; within another it leaves no trace.
_as_one = partial(jax.jit, inline=True)


@_as_one
@checked
def dot(
    a: Float[AnyArray, "*#batch axis"], b: Float[AnyArray, "*#batch axis"]
) -> Float[Array, "*batch"]:
    """Inner product over the last axis."""
    # A sum of products, not a matrix product: accelerators would round the latter to TF32.
    return jnp.sum(jnp.asarray(a) * jnp.asarray(b), axis=-1)


@_as_one
@checked
def normalise(vectors: Directions) -> Float[Array, "*batch 3"]:
    """Vectors scaled to unit length; a zero vector gives NaN, so refuse it before."""
    vectors = jnp.asarray(vectors)
    return vectors / jnp.sqrt(dot(vectors, vectors))[..., None]


@checked
def direction_from_angles(polar: Angle, azimuth: Angle) -> Float[Array, "*batch 3"]:
    """(sin t cos p, sin t sin p, cos t) for polar angle t and azimuth p in radians."""
    polar, azimuth = jnp.broadcast_arrays(polar, azimuth)
    sine = jnp.sin(polar)
    return jnp.stack([sine * jnp.cos(azimuth), sine * jnp.sin(azimuth), jnp.cos(polar)], axis=-1)


class SphericalAngles(NamedTuple):
    """Polar angle in [0, pi] and azimuth in [0, 2 pi)."""

    polar: Float[Array, "*batch"]
    azimuth: Float[Array, "*batch"]


@checked
def angles_from_direction(directions: Directions) -> SphericalAngles:
    """Find polar angle and azimuth of directions of any length.

    Accurate at the poles (arc tangent, not arc cosine), where the azimuth is 0 by convention and
    neither angle has a derivative.
    """
    # Of host arrays only the arc tangents are left to JAX: every other step is a program, too.
    on_host = isinstance(directions, np.ndarray)
    numbers: Any = np if on_host else jnp
    dtype = jax.dtypes.canonicalize_dtype(directions.dtype)
    x, y, z = numbers.moveaxis(numbers.asarray(directions, dtype), -1, 0)
    polar = jnp.arctan2(numbers.sqrt(x * x + y * y), z)
    azimuth = numbers.asarray(jnp.arctan2(y, x))
    azimuth = numbers.where(azimuth < 0, azimuth + 2 * np.pi, azimuth)
    # A tiny negative azimuth rounds up to 2 pi itself; -0 at a pole gives pi without this.
    outside = (azimuth >= 2 * np.pi) | ((x == 0) & (y == 0))
    azimuth = numbers.where(outside, 0, azimuth)
    return SphericalAngles(polar, as_jax(azimuth) if on_host else azimuth)


@_as_one
@checked
def reflect(outgoing: Broadcast, normals: Broadcast) -> Float[Array, "*batch 3"]:
    """Mirror direction R = 2 (N.V) N - V of a unit direction about a unit normal."""
    outgoing, normals = jnp.asarray(outgoing), jnp.asarray(normals)
    return 2 * dot(normals, outgoing)[..., None] * normals - outgoing


@checked
def half_vectors(incoming: Broadcast, outgoing: Broadcast) -> Float[Array, "*batch 3"]:
    """Unit vector half way between two directions; NaN where they are exactly opposite."""
    return normalise(jnp.asarray(incoming) + jnp.asarray(outgoing))


@checked
def squared_angle(cosines: Float[AnyArray, "*batch"]) -> Float[Array, "*batch"]:
    """arccos(c)^2 as a function that is analytic at c = 1, where arccos itself is not.

    With u = 1 - c, arccos(c)^2 = 2 u + u^2/3 + ... = u Q(u), Q a polynomial, for c >= 0; and
    (pi - arccos(-c))^2 beyond.  In double precision the relative error is below 1e-14 up to
    pi/2.  Cosines a rounding above 1 are continued, those below -1 count as -1, and no derivative
    is NaN anywhere.
    """
    cosines = jnp.asarray(cosines)
    beyond = cosines < 0
    folded = squared_acute_angle(jnp.abs(cosines))
    # The floor keeps the square root's derivative finite: at c = -1, a true branch point, and at
    # c = 1, where `where` below multiplies it by 0.
    floor = float(jnp.finfo(cosines.dtype).eps) ** 2
    supplement = np.pi - jnp.sqrt(jnp.maximum(folded, floor))
    return jnp.where(beyond, supplement * supplement, folded)


@checked
def squared_acute_angle(cosines: Float[AnyArray, "*batch"]) -> Float[Array, "*batch"]:
    """arccos(c)^2 for 0 <= c <= 1 only: :func:`squared_angle` without its branch, twice as fast."""
    return squared_angle_of_versine(1 - jnp.asarray(cosines))


@checked
def squared_angle_of_versine(versines: Float[AnyArray, "*batch"]) -> Float[Array, "*batch"]:
    """t^2 from the versine 1 - cos t of an acute angle t.

    A small angle has no digits left in its cosine in single precision (t = .01 keeps two), but all
    of them in a versine that is formed as sin^2 t / (1 + cos t).
    """
    versines = jnp.asarray(versines)
    return versines * _horner(_angle_polynomial(versines.dtype), versines)


def _angle_polynomial(dtype: np.dtype) -> tuple[float, ...]:
    return _DOUBLE if jnp.finfo(dtype).bits > 32 else _SINGLE


def _interpolate_angle(degree: int) -> tuple[float, ...]:
    """Monomial coefficients, lowest first, of Q(u) = arccos(1 - u)^2 / u on 0 <= u <= 1."""

    def quotient(u: np.ndarray) -> np.ndarray:
        # The half-angle form loses nothing for small u; Chebyshev nodes avoid u = 0 itself.
        return 4 * np.arcsin(np.sqrt(u / 2)) ** 2 / u

    chebyshev = np.polynomial.Chebyshev.interpolate(quotient, degree, domain=[0, 1])
    polynomial = chebyshev.convert(kind=np.polynomial.Polynomial)
    return tuple(float(c) for c in polynomial.coef)


def _horner(coefficients: tuple[float, ...], x: jax.Array) -> jax.Array:
    total = jnp.full_like(x, coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        total = total * x + coefficient
    return total


_DOUBLE = _interpolate_angle(_ANGLE_DEGREE_DOUBLE)
_SINGLE = _interpolate_angle(_ANGLE_DEGREE_SINGLE)
