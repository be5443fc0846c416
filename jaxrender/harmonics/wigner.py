"""How the harmonics of one degree turn into each other: the matrices d^l and D^l of T 2.29 - 2.35.

    Y_lm(R w) = sum_m' D^l_mm'(alpha, beta, gamma) Y_lm'(w),    R = Rz(beta) Ry(alpha) Rz(gamma)
    D^l_mm' = d^l_mm'(alpha) exp(i m beta) exp(i m' gamma)                        (T 2.29, 2.31)

Rows m and columns m' increase from -l; d is the standard one (d^1_10 = -sin(alpha) / sqrt 2) and
D the conjugate of Wigner's D(beta, alpha, gamma) (ERRATA 1, 4).  Hence D(R1 R2) = D(R1) D(R2).

All degrees stand in one array [degree, order -F..F, order -F..F], zero where an order exceeds the
degree.  Every d^l(alpha) comes from d^l(pi / 2), tabulated once: rotating about y is rotating about
z between two quarter turns,

    d_mm'(alpha) = sum_k d_mk(pi/2) d_m'k(pi/2) cos(k alpha + (m - m') pi / 2),

without the cancellation of T 2.33 and analytic in alpha, so derivatives exist at every angle.
"""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex

from jaxrender.harmonics.circle import phases
from jaxrender.harmonics.indexing import coefficient_count
from jaxrender.shapes import AnyArray, Array, Float, checked

Angles = Float[AnyArray, "*batch"]

_einsum = partial(jnp.einsum, precision=jax.lax.Precision.HIGHEST)


@checked
def small_d(angles: Angles, band_limit: int) -> Float[Array, "*batch degree order order"]:
    """Return d^l(alpha) of every angle, radians, l = 0 ... F (T 2.32, the values of 2.34).

    Raises ValueError if the band limit is negative.
    """
    alpha = jnp.asarray(angles)
    return _small_d(jnp.asarray(quarter_turn(band_limit), alpha.dtype), alpha)


@checked
def representation(
    alpha: Angles, beta: Angles, gamma: Angles, band_limit: int
) -> Complex[Array, "*batch degree order order"]:
    """Return D^l(alpha, beta, gamma), l = 0 ... F (T 2.31); raises like ``small_d``."""
    turned = small_d(alpha, band_limit)
    left = phases(beta, band_limit)[..., None, :, None]
    right = phases(gamma, band_limit)[..., None, None, :]
    return left * turned.astype(left.dtype) * right


@jax.jit
def _small_d(table: Array, alpha: Array) -> Array:
    band_limit = table.shape[0] - 1
    order = np.arange(-band_limit, band_limit + 1)
    waves = phases(alpha.reshape(-1), band_limit)
    even, odd = (
        _einsum("ak,lmk,lnk->almn", wave, table, table) for wave in (waves.real, waves.imag)
    )
    # cos and -sin of (m - m') pi / 2.
    turn = np.subtract.outer(order, order) % 4
    share = jnp.asarray(np.array([1.0, -1.0, -1.0, 1.0])[turn], alpha.dtype)[None, None]
    result = jnp.where((turn % 2 == 0)[None, None], even, odd) * share
    return result.reshape(*alpha.shape, *table.shape)


@lru_cache(maxsize=8)
def quarter_turn(band_limit: int) -> Float[np.ndarray, "degree order order"]:
    """Return d^l(pi / 2) on the host in float64, l = 0 ... F.

    Column m' is the eigenvector of J_x with eigenvalue m': (J_+ + J_-) v = 2 m' v.  Solved downward
    from m = l to 0, where it grows or oscillates, so it is stable at any degree; the rest
    follows from v_-m = (-1)^(l - m') v_m and d_m,-m' = (-1)^(l + m) d_mm'.
    Raises ValueError if the band limit is negative.
    """
    coefficient_count(band_limit)
    quarter = _quarter(band_limit)
    degree, m, n = np.ogrid[: band_limit + 1, : band_limit + 1, : band_limit + 1]
    upper = np.concatenate([(quarter * _sign(degree + m))[..., :0:-1], quarter], axis=2)
    columns = np.concatenate([n[..., :0:-1], n], axis=2)
    signs = _sign(degree + columns)
    # (-1)^(l + m'), with m' = -|m'| giving the same sign as |m'|.
    table = np.concatenate([(upper * signs)[:, :0:-1], upper], axis=1)
    table.setflags(write=False)
    return table


def _quarter(band_limit: int) -> Float[np.ndarray, "degree order order"]:
    """Return d^l_mm'(pi / 2) for m, m' >= 0."""
    table = np.zeros((band_limit + 1,) * 3)
    degree = np.arange(band_limit + 1.0)[:, None]
    column = np.arange(band_limit + 1.0)[None, :]
    current = above = np.zeros((band_limit + 1, band_limit + 1))
    for m in range(band_limit, -1, -1):
        # v_m from v_{m+1} and v_{m+2}; degrees below m stay zero.
        down = np.sqrt(np.maximum((degree + m + 1.0) * (degree - m), 1.0))
        up = np.sqrt(np.maximum((degree - m - 1.0) * (degree + m + 2.0), 0.0))
        current, above = (2.0 * column * current - up * above) / down, current
        current = np.where(degree > m, current, 0.0)
        current[m] = _top_row(m, band_limit)
        table[:, m] = np.where(column <= degree, current, 0.0)
    return table


def _top_row(degree: int, band_limit: int) -> Float[np.ndarray, " order"]:
    """Return d^l_{l m'}(pi / 2) = (-1)^(l - m') 2^-l sqrt(binomial(2l, l - m')), m' = 0 ... F."""
    falling = np.arange(degree, 0, -1)
    ratios = -np.sqrt((degree + falling) / (degree - falling + 1.0))
    row = np.zeros(band_limit + 1)
    row[: degree + 1] = np.cumprod(np.concatenate([[2.0**-degree], ratios]))[::-1]
    return row


def _sign(power: np.ndarray) -> np.ndarray:
    return np.where(power % 2 == 0, 1.0, -1.0)
