"""Real spherical harmonics in any direction, and functions given by their coefficients.

Everything is a rational function of x, y, z without a pole on the sphere, so it is smooth and
accurate everywhere, the poles included, and needs no angles.  Directions must be unit vectors; of
derivatives only the part tangent to the sphere has a meaning.

    Y_lm = p_lm cos(m phi), m >= 0;   Y_lm = p_l|m| sin(|m| phi), m < 0

(p_lm of ``legendre``, no Condon-Shortley sign, T 4.5, ERRATA 2 and 3).  The seeds Y_{m,+-m} are
real and imaginary part of n_0 ... n_m (x + iy)^m; the recurrence over degree then treats all orders
at once, on the upper hemisphere: Y_lm(-w) = (-1)^l Y_lm(w).  Points are taken in chunks whose state
stays in the processor's cache, so that memory does not grow with (points x coefficients), forwards
or backwards.
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics.indexing import band_limit_of, coefficient_count, degrees, orders
from jaxrender.harmonics.legendre import recurrence, sectoral
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Coefficients, Directions, Float, checked

# Measured: two states of (2 F + 1) x 256 float64 fit the second-level cache up to about degree 60.
_POINTS_PER_CHUNK = 256


@stored(partial(jax.jit, static_argnums=1), effort="less")
@checked
def real_basis(directions: Directions, band_limit: int) -> Float[Array, "*batch coefficient"]:
    """Return Y_lm of every direction, flat index l(l+1)+m, for degrees 0 to F.

    Raises ValueError if the band limit is negative.
    """
    count = coefficient_count(band_limit)
    unit = jnp.asarray(directions)

    def flat_basis(columns):
        by_degree = _ascend(columns, band_limit, lambda _, values, parity: values * parity[None, :])
        return by_degree[degrees(band_limit), orders(band_limit) + band_limit].T

    return _in_chunks(flat_basis, unit.reshape(-1, 3)).reshape(*unit.shape[:-1], count)


@checked
def explicit_basis(directions: Directions) -> Float[Array, "*batch 9"]:
    """Return the nine harmonics of degree 0 to 2 as written out in T 4.5, the readable twin."""
    x, y, z = jnp.moveaxis(jnp.asarray(directions), -1, 0)
    c0, c1 = np.sqrt(1.0 / (4.0 * np.pi)), np.sqrt(3.0 / (4.0 * np.pi))
    c2, c20, c22 = np.sqrt(np.array([15.0 / 4.0, 5.0 / 16.0, 15.0 / 16.0]) / np.pi).tolist()
    values = (
        jnp.full_like(x, c0),
        float(c1) * y,
        float(c1) * z,
        float(c1) * x,
        c2 * x * y,
        c2 * y * z,
        c20 * (3.0 * z * z - 1.0),
        c2 * x * z,
        c22 * (x * x - y * y),
    )
    return jnp.stack(values, axis=-1)


@jax.jit
@checked
def evaluate(coefficients: Coefficients, directions: Directions) -> Float[Array, "*batch channel"]:
    """Return f(w) = sum_lm f_lm Y_lm(w).

    Raises ValueError if the number of coefficients is not a square.
    """
    rows, unit = _rows(jnp.asarray(coefficients)), jnp.asarray(directions)
    values = _in_chunks(
        lambda columns: jnp.sum(_by_degree(rows, columns), axis=0).T, unit.reshape(-1, 3)
    )
    return values.reshape(*unit.shape[:-1], *values.shape[1:])


@jax.jit
@checked
def degree_table(
    coefficients: Coefficients, directions: Directions
) -> Float[Array, "*batch degree channel"]:
    """Return s_l(w) = sum_m f_lm Y_lm(w): the part of each degree, which a filter only scales.

    Raises ValueError if the number of coefficients is not a square.
    """
    rows, unit = _rows(jnp.asarray(coefficients)), jnp.asarray(directions)
    values = _in_chunks(
        lambda columns: jnp.transpose(_by_degree(rows, columns), (2, 0, 1)), unit.reshape(-1, 3)
    )
    return values.reshape(*unit.shape[:-1], *values.shape[1:])


def _ascend(
    columns: Float[Array, "3 point"], band_limit: int, visit: Callable, rows: AnyArray | None = None
):
    """Scan over degree, stacking visit(rows[l], values [order -F..F, point], parity [point]).

    Y_lm is values times parity.  Orders |m| > l hold seeds that wait for their degree: the visitor
    or its caller must ignore them.
    """
    # A constant sign: differentiating through the fold is exact at the equator too.
    sign = jnp.where(columns[2] < 0.0, -1.0, 1.0).astype(columns.dtype)
    upper = sign[None, :] * columns
    x, y, z = upper
    # 1 - z, without its rounding near the pole.
    versine = ((x * x + y * y) / (1.0 + z))[None, :]
    seeds = _seeds(x, y, band_limit)
    order = np.abs(np.arange(-band_limit, band_limit + 1))
    factors = tuple(jnp.asarray(t[:, order, None], z.dtype) for t in recurrence(band_limit))

    def step(state, inputs):
        values, difference, parity = state
        (decay, bend, ratio), row = inputs
        difference = decay * difference - bend * versine * values
        values = ratio * values + difference
        return (values, difference, parity * sign), visit(row, values, parity)

    start = (seeds, jnp.zeros_like(seeds), jnp.ones_like(sign))
    return jax.lax.scan(step, start, (factors, rows))[1]


def _seeds(
    x: Float[Array, " point"], y: Float[Array, " point"], band_limit: int
) -> Float[Array, "order point"]:
    """Return Y_{|m|,m} for m = -F ... F: imaginary and real part of n_0 ... n_|m| (x + iy)^|m|."""
    factors = sectoral(band_limit)

    def step(power, factor):
        real, imaginary = power
        power = (factor * (x * real - y * imaginary), factor * (x * imaginary + y * real))
        return power, power

    start = (jnp.full_like(x, factors[0]), jnp.zeros_like(x))
    _, (cosine, sine) = jax.lax.scan(step, start, jnp.asarray(factors[1:], x.dtype))
    return jnp.concatenate([sine[::-1], start[0][None, :], cosine])


def _by_degree(
    rows: Float[Array, "degree order channel"], columns: Float[Array, "3 point"]
) -> Float[Array, "degree channel point"]:
    """Return sum_m rows[l, m] Y_lm for each degree, never holding more than two degrees of Y."""

    def visit(row, values, parity):
        total = jnp.einsum("mc,mp->cp", row, values, precision=jax.lax.Precision.HIGHEST)
        return total * parity[None, :]

    return _ascend(columns, rows.shape[0] - 1, visit, rows)


def _in_chunks(function: Callable, unit: Float[Array, "point 3"]) -> Array:
    """Apply function(columns [3, point]) -> [point, ...] to the points, a chunk at a time."""
    count = unit.shape[0]
    if count <= _POINTS_PER_CHUNK:
        return function(unit.T)
    chunks = -(-count // _POINTS_PER_CHUNK)
    padded = jnp.pad(unit, ((0, chunks * _POINTS_PER_CHUNK - count), (0, 0)))
    # Recomputed in the backward pass, else reverse mode would store every state of every chunk.
    body = jax.checkpoint(lambda points: function(points.T), prevent_cse=False)
    out = jax.lax.map(body, padded.reshape(chunks, _POINTS_PER_CHUNK, 3))
    return out.reshape(chunks * _POINTS_PER_CHUNK, *out.shape[2:])[:count]


def _rows(coefficients: Float[Array, "coefficient channel"]) -> Array:
    """Spread the flat coefficients to [degree, order -F..F, channel], zero where |m| > l."""
    band_limit = band_limit_of(coefficients.shape[0])
    degree = np.arange(band_limit + 1)[:, None]
    order = np.arange(-band_limit, band_limit + 1)[None, :]
    absent = coefficients.shape[0]
    index = np.where(np.abs(order) <= degree, degree * (degree + 1) + order, absent)
    return jnp.pad(coefficients, ((0, 1), (0, 0)))[index]
