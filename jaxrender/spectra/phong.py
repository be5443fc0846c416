"""The transfer of the Phong lobe (s + 1) / (2 pi) (R.L)^s, s any real number (T 3.34 to 3.40).

A_l = Lambda_l rho_l = (s + 1) int_0^1 u^s P_l(u) du.  It is 1 for l = 0, and a larger s means a
*narrower* lobe and a wider spectrum (the caption of T fig. 3.3 has it the other way: ERRATA 23).
``PHONG_TRANSFERS`` names the exact transfer, its closed form and two approximations:

========== ========================== ==============================================
gaussian   exp(-l^2 / 2s)             T 3.40; off by .052 (s = 8) to .012 (512)
matched    exp(-l(l+1) / 2(s+1))      four to sixty times nearer (ERRATA 22)
========== ========================== ==============================================
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.scipy.special import gammaln

from jaxrender.shapes import AnyArray, Array, Float, checked

Exponent = Float[AnyArray, ""] | float

# Stirling's series to 1 / x^7 is exact to rounding from here on.
_STIRLING_FROM = 16.0


@checked
def phong_transfer(exponent: Exponent, band_limit: int) -> Float[Array, "degree"]:
    """Compute T 3.37 for real s > -1: A_0 = 1, A_1 = (s+1)/(s+2), A_l+2 = A_l (s-l) / (s+l+3).

    Products alone: exact to rounding at any degree and exponent, differentiable in s also at the
    integers, where the closed form has poles, and zero there beyond l = s by itself.

    Raises ``ValueError`` for an exponent of -1 or less, or a negative band limit.
    """
    s = _checked(exponent, band_limit)

    def step(pair, degree):
        lower, upper = pair
        return (upper, lower * (s - degree) / (s + degree + 3)), lower

    start = (jnp.ones_like(s), (s + 1) / (s + 2))
    degrees = jnp.arange(band_limit + 1, dtype=s.dtype)
    return jax.lax.scan(step, start, degrees)[1]


@checked
def phong_transfer_by_gamma(exponent: Exponent, band_limit: int) -> Float[Array, "degree"]:
    """Compute the closed form, the readable twin (ERRATA 20; T 3.38 is its limit for large s).

    A_l = G(s/2 + 1) G(s/2 + 3/2) / (G((s-l)/2 + 1) G((s+l)/2 + 3/2))

    Exact for all l, through log-gamma; where s is far above l, through Stirling's series, in which
    large terms cancel before they are evaluated.  It has no derivative at integers.
    """
    s = _checked(exponent, band_limit)
    degrees = jnp.arange(band_limit + 1, dtype=s.dtype)
    large = (s - degrees) / 2 + 1 > _STIRLING_FROM
    # What is not taken overflows for large s, and its derivative would be NaN.
    near = _by_log_gamma(jnp.where(large, 0, s), degrees)
    return jnp.where(large, _by_stirling(s, degrees), near)


def _by_log_gamma(
    s: Float[Array, "degree"], degrees: Float[Array, "degree"]
) -> Float[Array, "degree"]:
    """Evaluate the closed form where its terms are not large."""
    logarithm = gammaln(s / 2 + 1) + gammaln(s / 2 + 1.5) - gammaln((s + degrees) / 2 + 1.5)
    below = (s - degrees) / 2 + 1
    # 1 / G(x) is zero at 0, -1, -2, ...; for negative x by reflection.
    reflected = jnp.exp(logarithm + gammaln(jnp.where(below > 0, 1, 1 - below)))
    direct = jnp.exp(logarithm - gammaln(jnp.where(below > 0, below, 1)))
    return jnp.where(below > 0, direct, reflected * jnp.sin(np.pi * below) / np.pi)


def _by_stirling(s: Float[Array, ""], degrees: Float[Array, "degree"]) -> Float[Array, "degree"]:
    """Evaluate the same from log G(x) = (x - 1/2) log x - x + 1 / 12 x - ... of large x."""
    x, y, half = s / 2 + 1, s / 2 + 1.5, jnp.minimum(degrees / 2, s / 2 + 1 - _STIRLING_FROM)
    half = jnp.maximum(half, 0)
    powers = -(x - 0.5) * jnp.log1p(-half / x) - (y - 0.5) * jnp.log1p(half / y)
    powers = powers + half * jnp.log1p(-(2 * half + 0.5) / (y + half))
    rest = _stirling_rest(x) - _stirling_rest(x - half)
    return jnp.exp(powers + rest + _stirling_rest(y) - _stirling_rest(y + half))


def _stirling_rest(x: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    inverse = 1 / jnp.maximum(x, 1)
    squared = inverse * inverse
    return inverse * (1 / 12 - squared * (1 / 360 - squared * (1 / 1260 - squared / 1680)))


@checked
def gaussian_phong_transfer(exponent: Exponent, band_limit: int) -> Float[Array, "degree"]:
    """Compute the thesis's exp(-l^2 / 2s) (T 3.40, 5.27)."""
    s = _checked(exponent, band_limit)
    degrees = jnp.arange(band_limit + 1, dtype=s.dtype)
    return jnp.exp(-(degrees**2) / (2 * s))


@checked
def matched_phong_transfer(exponent: Exponent, band_limit: int) -> Float[Array, "degree"]:
    """Compute exp(-l(l+1) / (2(s+1))), a diffusion on the sphere of the lobe's width."""
    s = _checked(exponent, band_limit)
    degrees = jnp.arange(band_limit + 1, dtype=s.dtype)
    return jnp.exp(-degrees * (degrees + 1) / (2 * (s + 1)))


PHONG_TRANSFERS = {
    "exact": phong_transfer,
    "closed-form": phong_transfer_by_gamma,
    "gaussian": gaussian_phong_transfer,
    "matched": matched_phong_transfer,
}


@checked
def power_transfer(exponent: Exponent, band_limit: int) -> Float[Array, "degree"]:
    """Compute 2 pi int_0^1 u^s P_l(u) du, the lobe (R.L)^s unnormalised.

    s = 1 is the clamped cosine (T 3.28), s = 0 the hemisphere.
    """
    transfer = phong_transfer(exponent, band_limit)
    return transfer * (2 * jnp.pi / (jnp.asarray(exponent, transfer.dtype) + 1))


def _checked(exponent: Exponent, band_limit: int) -> Float[Array, ""]:
    if band_limit < 0:
        raise ValueError(f"band_limit={band_limit}: the band limit must not be negative")
    if not isinstance(exponent, Tracer) and not float(exponent) > -1:
        raise ValueError(f"exponent={exponent}: the lobe has a finite integral only above -1")
    return jnp.asarray(exponent, jnp.result_type(exponent, float))
