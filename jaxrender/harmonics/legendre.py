"""Legendre polynomials by recurrence over degree, as scans, so that compile time does not grow.

The associated functions are fully normalised and carry no Condon-Shortley sign: with p_lm here,
Y_lm = p_lm(cos t) cos(m phi) for m >= 0 and p_l|m|(cos t) sin(|m| phi) for m < 0 are orthonormal
over the sphere (ERRATA 3: T 4.3 and 4.4 hold with |m| only).  The factor sqrt(2) of the orders
m > 0 is inside p_lm.  They start from p_mm = n_m sin t p_{m-1,m-1} and obey, at fixed order,

    p_lm = a_lm cos t p_{l-1,m} - b_lm p_{l-2,m}.

That form loses digits near the pole, where cos t rounds to 1 (1e-3 at degree 128 in float32).  With
d = 1 - cos t and the ratio k_lm = lim p_lm / p_{l-1,m} for t -> 0 it becomes the pair

    D_l = g_lm D_{l-1} - a_lm d p_{l-1,m},    p_lm = k_lm p_{l-1,m} + D_l,    g_lm = a_lm - k_lm,

accurate for 0 <= t <= pi / 2; the other hemisphere follows by parity, (-1)^(l+m).  p_mm underflows
where sin(t)^m does; up to degree 128 in float32 and 1000 in float64 the functions lost with it are
far below rounding.

``gauss_legendre`` finds the nodes of Gauss's rule as angles, by the same increments: the angle and
the weight have all their digits at the pole as well, which cosines of nodes there cannot give.
"""

from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics.indexing import coefficient_count
from jaxrender.shapes import AnyArray, Array, Float, checked

# From the start below they converge to rounding in three or four, whatever the number of nodes.
_NEWTON_STEPS = 5


@checked
def legendre(cosines: Float[AnyArray, "*batch"], band_limit: int) -> Float[Array, "*batch degree"]:
    """Return P_0 ... P_F: (l+1) P_{l+1} = (2l+1) x P_l - l P_{l-1}, P_l(1) = 1.

    Computed by its increments on 0 <= x <= 1 and by parity below, so that no digits are lost near
    the ends of the interval.  Raises ValueError if the band limit is negative.
    """
    coefficient_count(band_limit)
    x = jnp.asarray(cosines)
    degree = np.arange(1, band_limit + 1)
    decay = jnp.asarray((degree - 1) / degree, x.dtype)
    bend = jnp.asarray((2 * degree - 1) / degree, x.dtype)
    # A constant sign: differentiating through the fold is exact at x = 0 too.
    sign = jnp.where(x < 0.0, -1.0, 1.0).astype(x.dtype)
    versine = 1.0 - sign * x

    def step(state, factors):
        value, difference, parity = state
        decay, bend = factors
        difference = decay * difference - bend * versine * value
        value = value + difference
        return (value, difference, parity * sign), value * parity

    one = jnp.ones_like(x)
    _, rest = jax.lax.scan(step, (one, jnp.zeros_like(x), sign), (decay, bend))
    return jnp.moveaxis(jnp.concatenate([one[None], rest]), 0, -1)


class Recurrence(NamedTuple):
    """Factors of the recurrence over degree, for l and m from 0 to F.

    a_lm = sqrt((4 l^2 - 1) / (l^2 - m^2)), k_lm = sqrt((2l + 1) (l + m) / ((2l - 1) (l - m))) and
    g_lm = a_lm - k_lm = k_lm (l - m - 1) / (l + m) for l > m.  For l <= m they are a = g = 0 and
    k = 1: a recurrence that starts with p_mm and D = 0 keeps them until degree m is reached, so no
    step has to ask which orders have begun.
    """

    decay: Float[np.ndarray, "degree order"]
    """g_lm"""
    bend: Float[np.ndarray, "degree order"]
    """a_lm"""
    ratio: Float[np.ndarray, "degree order"]
    """k_lm"""


@lru_cache(maxsize=32)
def recurrence(band_limit: int) -> Recurrence:
    """Return the factors that lead from degree l - 1 to degree l."""
    degree = np.arange(band_limit + 1.0)[:, None]
    order = np.arange(band_limit + 1.0)[None, :]
    begun = degree > order
    above, below = np.where(begun, degree + order, 1.0), np.where(begun, degree - order, 1.0)
    twice = np.where(begun, 2.0 * degree, 2.0)
    ratio = np.where(begun, np.sqrt((twice + 1.0) * above / ((twice - 1.0) * below)), 1.0)
    bend = np.where(begun, np.sqrt((twice + 1.0) * (twice - 1.0) / (above * below)), 0.0)
    decay = np.where(begun, ratio * (below - 1.0) / above, 0.0)
    return Recurrence(_frozen(decay), _frozen(bend), _frozen(ratio))


@lru_cache(maxsize=32)
def sectoral(band_limit: int) -> Float[np.ndarray, " order"]:
    """Return n_m, m = 0 ... F: the factors that lead from p_{m-1,m-1} to p_mm.

    n_0 = sqrt(1 / (4 pi)), n_1 = sqrt(3), n_m = sqrt((2m + 1) / (2m)) for m > 1.
    """
    order = np.arange(1.0, band_limit + 1.0)
    factors = np.sqrt((2.0 * order + 1.0) / (2.0 * order))
    factors[:1] *= np.sqrt(2.0)
    return _frozen(np.concatenate([[np.sqrt(0.25 / np.pi)], factors]))


@checked
def associated(
    cosines: Float[np.ndarray, " row"], sines: Float[np.ndarray, " row"], band_limit: int
) -> Float[np.ndarray, "degree order row"]:
    """Tabulate p_lm(cos t) on the host in float64 (zero for m > l), given cos t and sin t >= 0."""
    coefficient_count(band_limit)
    factors = recurrence(band_limit)
    order = np.arange(band_limit + 1)[:, None]
    versine = (sines**2 / (1.0 + np.abs(cosines)))[None, :]
    values = np.cumprod(sectoral(band_limit))[:, None] * sines[None, :] ** order
    difference = np.zeros_like(values)
    mirror = np.where(cosines < 0.0, -1.0, 1.0)[None, :]
    table = np.zeros((band_limit + 1, *values.shape))
    for degree, (decay, bend, ratio) in enumerate(zip(*factors)):
        difference = decay[:, None] * difference - bend[:, None] * versine * values
        values = ratio[:, None] * values + difference
        parity = mirror ** (degree + order)
        table[degree, : degree + 1] = (values * parity)[: degree + 1]
    return table


class GaussRule(NamedTuple):
    """Nodes and weights that integrate polynomials in x = cos t over [-1, 1]."""

    angles: Float[np.ndarray, " node"]
    """Polar angles t of the nodes, radians, increasing: the zeros of P_n(cos t)."""
    weights: Float[np.ndarray, " node"]
    """2 / (dP_n / dt)^2; they sum to 2."""


@lru_cache(maxsize=32)
def gauss_legendre(count: int) -> GaussRule:
    """Return Gauss's rule of so many nodes, exact to degree 2 n - 1 of x.

    Newton's method in the angle, from t_k = (k - 1/4) pi / (n + 1/2).  Raises ValueError below 1.
    """
    if count < 1:
        raise ValueError(f"a quadrature rule of {count} nodes; give 1 or more")
    north = (np.arange((count + 1) // 2) + 0.75) * np.pi / (count + 0.5)
    slope = np.ones_like(north)
    for _ in range(_NEWTON_STEPS):
        value, slope = _value_and_slope(north, count)
        north = north - value / slope
    if count % 2:
        north[-1] = np.pi / 2
    weights = 2.0 / slope**2
    half = count // 2
    return GaussRule(
        _frozen(np.concatenate([north, np.pi - north[:half][::-1]])),
        _frozen(np.concatenate([weights, weights[:half][::-1]])),
    )


def _value_and_slope(angles: np.ndarray, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Evaluate P_n(cos t) and its derivative by t, 0 < t <= pi / 2, without loss at the pole."""
    versine = 2.0 * np.sin(angles / 2.0) ** 2
    value, difference = np.ones_like(angles), np.zeros_like(angles)
    for step in range(1, degree + 1):
        decay, bend = (step - 1) / step, (2 * step - 1) / step
        difference = decay * difference - bend * versine * value
        value = value + difference
    # n (cos t P_n - P_{n-1}) / sin t, the difference of the two being known.
    return value, degree * (difference - versine * value) / np.sin(angles)


def _frozen(table: np.ndarray) -> np.ndarray:
    """Return the table read-only: it is cached and shared."""
    table.setflags(write=False)
    return table
