"""Complex spherical harmonics, and coefficients taken between the complex and the real basis.

The thesis's analysis (chapters 2 and 3) is written in them; everything that is measured is real.

    Y_lm = N_lm P_lm(cos t) exp(i m phi)    (T 2.26, with the Condon-Shortley sign: ERRATA 2)

so Y_11 = -sqrt(3 / 8 pi) (x + iy) (T 2.27) and Y_{l,-m} = (-1)^m conj(Y_lm).  With the real
harmonics R_lm of ``basis``, which have no such sign, and for m > 0,

    Y_lm = (-1)^m (R_lm + i R_{l,-m}) / sqrt 2,    Y_{l,-m} = (R_lm - i R_{l,-m}) / sqrt 2

and Y_l0 = R_l0.  Coefficients of both kinds stand at the same flat index l(l+1)+m.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex

from jaxrender.harmonics.basis import real_basis
from jaxrender.harmonics.indexing import band_limit_of, orders
from jaxrender.shapes import AnyArray, Array, Coefficients, Directions, Float, Int, checked

ComplexCoefficients = Complex[AnyArray, "coefficient channel"]


@checked
def complex_basis(directions: Directions, band_limit: int) -> Complex[Array, "*batch coefficient"]:
    """Return Y_lm of every direction, flat index l(l+1)+m, for degrees 0 to F (T 2.26).

    Raises ValueError if the band limit is negative.
    """
    values = real_basis(directions, band_limit)
    partner, sign, scale = _pairs(values.shape[-1], values.dtype)
    cosine = jnp.where(sign < 0.0, values[..., partner], values)
    sine = jnp.where(sign < 0.0, values, values[..., partner])
    return jax.lax.complex(_along(scale[0], cosine), _along(scale[1], sine))


@checked
def complex_from_real(coefficients: Coefficients) -> Complex[Array, "coefficient channel"]:
    """Return the coefficients in Y_lm of a function given in R_lm.

    c_lm = (-1)^m (f_lm - i f_{l,-m}) / sqrt 2 and c_{l,-m} = (f_lm + i f_{l,-m}) / sqrt 2, m > 0.
    Raises ValueError if the number of coefficients is not a square.
    """
    values = jnp.asarray(coefficients)
    partner, sign, scale = _pairs(values.shape[0], values.dtype)
    cosine = jnp.where(sign[:, None] < 0.0, values[partner], values)
    sine = jnp.where(sign[:, None] < 0.0, values, values[partner])
    return jax.lax.complex(scale[0][:, None] * cosine, -scale[1][:, None] * sine)


@checked
def real_from_complex(coefficients: ComplexCoefficients) -> Float[Array, "coefficient channel"]:
    """Return the coefficients in R_lm of the real part of a function given in Y_lm.

    For m > 0, f_lm = Re((-1)^m c_lm + c_{l,-m}) / sqrt 2 and
    f_{l,-m} = Im(c_{l,-m} - (-1)^m c_lm) / sqrt 2: of a real function both terms are equal.
    Raises ValueError if the number of coefficients is not a square.
    """
    values = jnp.asarray(coefficients)
    partner, sign, scale = _pairs(values.shape[0], values.real.dtype)
    factor = scale[0][:, None]
    real, imaginary = factor * values.real, factor * values.imag
    side = sign[:, None]
    cosine = jnp.where(side == 0.0, real, real + real[partner])
    # For m < 0 the own coefficient is c_{l,-|m|}, its partner's c_{l,|m|}.
    return jnp.where(side < 0.0, imaginary - imaginary[partner], cosine)


def _along(scale: Array, values: Array) -> Array:
    return jnp.broadcast_to(scale, values.shape) * values


def _pairs(count: int, dtype) -> tuple[Int[np.ndarray, " coefficient"], Array, Array]:
    """Return for each flat index: that of -m, the sign of m, factors of R_l|m| and i R_l,-|m|."""
    order = orders(band_limit_of(count))
    partner = np.arange(count) - 2 * order
    parity = np.where((order > 0) & (order % 2 == 1), -1.0, 1.0)
    real = np.where(order == 0, 1.0, parity * np.sqrt(0.5))
    imaginary = np.where(order == 0, 0.0, np.sign(order) * parity * np.sqrt(0.5))
    scale = jnp.asarray(np.stack([real, imaginary]), dtype)
    return partner, jnp.asarray(np.sign(order), dtype), scale
