"""Rotating a function given by its real coefficients, differentiably and for many rotations.

``rotate(coefficients, world_from_local)`` takes the coefficients of a function of local directions
to those of the same function of world directions,

    g(R w') = f(w'),    g_l = M^l(R) f_l,    Y_l(R w') = M^l(R) Y_l(w')

(T 2.29 in real harmonics); the transposed matrix leads back, which is how a surface sees the light
(T 2.37).  M is real, orthogonal and a homomorphism: M(R1 R2) = M(R1) M(R2).

R = Rz(beta) Ry(alpha) Rz(gamma) (T 2.10, ERRATA 1).  Turning about z mixes only m and -m; turning
about y is turning about z with y and z exchanged, Ry(alpha) = S Rz(-alpha) S.  The harmonics of
exchanged axes are a fixed table, so a rotation costs two products with it and no compilation that
grows with the degree.
"""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.harmonics.indexing import band_limit_of, coefficient_count, degrees, orders
from jaxrender.harmonics.wigner import quarter_turn
from jaxrender.shapes import AnyArray, Array, Coefficients, Float, checked

Rotations = Float[AnyArray, "*batch 3 3"]
Angles = Float[AnyArray, "*batch"]

# How far from orthogonal a matrix may be: poses are often written with four digits.
_ORTHOGONAL = 1e-3

_einsum = partial(jnp.einsum, precision=jax.lax.Precision.HIGHEST)


@checked
def rotate(
    coefficients: Coefficients, world_from_local: Rotations
) -> Float[Array, "*batch coefficient channel"]:
    """Return the coefficients of g(w) = f(R^T w) for every rotation matrix R.

    Differentiable in R at every rotation, where Euler angles lock too; of the derivative only the
    part tangent to the rotations has a meaning.
    Raises ValueError if the number of coefficients is not a square, and for matrices that are no
    rotations where their values are known: a traced matrix passes unseen.
    """
    values = jnp.asarray(coefficients)
    band_limit = band_limit_of(values.shape[0])
    matrices = _orthogonal(world_from_local, 1)
    turned = _rotate(_exchange(band_limit), _spread(values), matrices.reshape(-1, 3, 3))
    return _gather(turned, band_limit).reshape(*matrices.shape[:-2], *values.shape)


@checked
def reflect(
    coefficients: Coefficients, world_from_local: Rotations
) -> Float[Array, "*batch coefficient channel"]:
    """Return the coefficients of g(w) = f(Q^T w) for every improper rotation Q, determinant -1.

    Mirrors, such as diag(1, 1, -1), and mirrors followed by rotations.  Q = -R with a rotation R,
    and f(-w) has the coefficients (-1)^l f_lm.  Differentiable, and raises, as ``rotate``.
    """
    values = jnp.asarray(coefficients)
    parity = (-1.0) ** degrees(band_limit_of(values.shape[0]))
    matrices = _orthogonal(world_from_local, -1)
    return rotate(values * jnp.asarray(parity, values.dtype)[:, None], -matrices)


@checked
def rotate_by_angles(
    coefficients: Coefficients, alpha: Angles, beta: Angles, gamma: Angles
) -> Float[Array, "*batch coefficient channel"]:
    """Return the same for R = Rz(beta) Ry(alpha) Rz(gamma), radians; raises the same."""
    values = jnp.asarray(coefficients)
    band_limit = band_limit_of(values.shape[0])
    angles = (jnp.asarray(angle).reshape(-1) for angle in (alpha, beta, gamma))
    turned = _turn(_exchange(band_limit), _spread(values), *angles)
    return _gather(turned, band_limit).reshape(*jnp.shape(alpha), *values.shape)


@checked
def rotation_matrices(
    world_from_local: Rotations, band_limit: int
) -> Float[Array, "*batch degree order order"]:
    """Return M^l(R), l = 0 ... F, orders -F ... F, zero where an order exceeds the degree.

    Raises ValueError if the band limit is negative, and for matrices as ``rotate``.
    """
    coefficient_count(band_limit)
    matrices = _orthogonal(world_from_local, 1)
    order = np.arange(-band_limit, band_limit + 1)
    inside = np.abs(order)[None, :] <= np.arange(band_limit + 1)[:, None]
    units = jnp.asarray(inside[:, :, None] * np.eye(len(order))[None], matrices.dtype)
    turned = _rotate(_exchange(band_limit), units[:, :, None], matrices.reshape(-1, 3, 3))
    return jnp.moveaxis(turned, 2, 0).reshape(*matrices.shape[:-2], *units.shape)


def _orthogonal(matrices: Rotations, determinant: int) -> Float[Array, "*batch 3 3"]:
    """Raise ``ValueError`` unless all are orthogonal with this determinant, as far as is known."""
    if isinstance(matrices, Tracer):
        return matrices
    values = np.asarray(matrices, float)
    with np.errstate(invalid="ignore"):
        found = np.linalg.det(values)
        gram = values @ np.swapaxes(values, -1, -2)
    right = np.abs(gram - np.eye(3)).max(axis=(-1, -2), initial=0) < _ORTHOGONAL
    wrong = np.argwhere(~(right & (found * determinant > 0)))
    if not len(wrong):
        return jnp.asarray(matrices)
    place = tuple(wrong[0].tolist())
    which = f"world_from_local{list(place) if place else ''} has determinant {found[place]:.6g}"
    if right[place]:
        other = "reflect takes improper rotations" if determinant > 0 else "rotate takes rotations"
        raise ValueError(f"{which}, wanted {determinant}: {other}")
    raise ValueError(
        f"{which} and is not orthogonal, wanted determinant {determinant} and columns of length 1 "
        "at right angles: take scale and shear off"
    )


@jax.jit
def _rotate(
    exchange: AnyArray, rows: Float[Array, "degree order 1 channel"], matrices: Array
) -> Float[Array, "degree order batch channel"]:
    """Rotate by matrices [batch, 3, 3]."""
    table = jnp.asarray(exchange, rows.dtype)
    # R = (R Q) Q^T with a quarter turn Q about y wherever alpha of R is nearer 0 or pi than that
    # of R Q: the angles taken below are then far from lock.
    locked = jnp.abs(matrices[:, 2, 2]) > jnp.abs(matrices[:, 2, 0])
    quarter = jnp.stack([-matrices[:, :, 2], matrices[:, :, 1], matrices[:, :, 0]], axis=-1)
    free = jnp.where(locked[:, None, None], quarter, matrices)
    back = jnp.full((1,), 0.5 * np.pi, rows.dtype)
    start = jnp.where(locked[None, None, :, None], _tilt(table, rows, -back), rows)
    alpha = jnp.arctan2(jnp.sqrt(free[:, 0, 2] ** 2 + free[:, 1, 2] ** 2), free[:, 2, 2])
    beta = jnp.arctan2(free[:, 1, 2], free[:, 0, 2])
    gamma = jnp.arctan2(free[:, 2, 1], -free[:, 2, 0])
    return _turn(table, start, alpha, beta, gamma)


@jax.jit
def _turn(exchange: AnyArray, rows: Array, alpha: Array, beta: Array, gamma: Array) -> Array:
    """Rotate rows [degree, order, batch or 1, channel] by Rz(beta) Ry(alpha) Rz(gamma)."""
    table = jnp.asarray(exchange, rows.dtype)
    return _spin(_tilt(table, _spin(rows, gamma), alpha), beta)


def _tilt(table: Array, rows: Array, angle: Array) -> Array:
    """Rotate about y: Ry(alpha) = S Rz(-alpha) S."""
    product = partial(_einsum, "lmn,lnbc->lmbc", table)
    return product(_spin(product(rows), -angle))


def _spin(rows: Array, angle: Array) -> Array:
    """Rotate about z: g_m = cos(m angle) f_m - sin(m angle) f_-m."""
    band_limit = rows.shape[0] - 1
    order = jnp.asarray(np.arange(-band_limit, band_limit + 1), rows.dtype)
    turns = order[:, None] * angle[None, :]
    cosine, sine = (wave(turns)[None, :, :, None] for wave in (jnp.cos, jnp.sin))
    return cosine * rows - sine * rows[:, ::-1]


def _spread(coefficients: Array) -> Float[Array, "degree order 1 channel"]:
    """Spread the flat coefficients over all orders, zero where an order exceeds the degree."""
    band_limit = band_limit_of(coefficients.shape[0])
    rows = jnp.zeros(
        (band_limit + 1, 2 * band_limit + 1, coefficients.shape[1]), coefficients.dtype
    )
    place = (degrees(band_limit), orders(band_limit) + band_limit)
    return rows.at[place].set(coefficients, unique_indices=True)[:, :, None]


def _gather(rows: Array, band_limit: int) -> Float[Array, "batch coefficient channel"]:
    flat = rows[degrees(band_limit), orders(band_limit) + band_limit]
    return jnp.moveaxis(flat, 1, 0)


@lru_cache(maxsize=8)
def _exchange(band_limit: int) -> Float[np.ndarray, "degree order order"]:
    """Return K^l with Y_l(x, z, y) = K^l Y_l(x, y, z) in real harmonics, orders -F ... F.

    The exchange S is Rx(pi/2) after z -> -z, and Rx(pi/2) = Rz(-pi/2) Ry(pi/2) Rz(pi/2): in complex
    harmonics K_mm' = i^(m' - m) (-1)^(l + m') d_mm'(pi/2); in real ones it is symmetric.
    """
    turned = quarter_turn(band_limit)[:, band_limit:]
    order = np.arange(-band_limit, band_limit + 1)
    degree, m = np.arange(band_limit + 1)[:, None, None], order[None, band_limit:, None]
    powers = np.array([1.0, 1.0j, -1.0, -1.0j])
    mixed = turned * powers[(order - m + 2 * (degree + order)) % 4]
    # Columns: Y_m' = (-1)^m' (R_m' + i R_-m') / sqrt 2, Y_-m' = (R_m' - i R_-m') / sqrt 2.
    signed = mixed[..., band_limit:] * powers[2 * m[:, :, 0] % 4][:, None, :]
    mirrored = mixed[..., band_limit::-1]
    cosine, sine = signed + mirrored, 1.0j * (signed - mirrored)
    # Rows: R_m = sqrt 2 (-1)^m Re Y_m, R_-m = sqrt 2 (-1)^m Im Y_m.
    columns = np.concatenate([sine[..., :0:-1], cosine], axis=-1) * powers[2 * m % 4]
    table = np.concatenate([columns.imag[:, :0:-1], columns.real], axis=1)
    half = np.where(order == 0, np.sqrt(0.5), 1.0)
    table *= half[:, None] * half[None, :]
    table.setflags(write=False)
    return table
