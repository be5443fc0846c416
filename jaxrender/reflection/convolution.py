"""Reflection as multiplication: the convolution theorem of T 2.3.2 and 2.3.4, any BRDF.

A convex surface of one material, whose local frames are the R of T 2.10, sends the radiance
B(R, o) = int L(R i) rho^(i, o) di to the *local* direction o.  In coefficients

    isotropic     B_lmpq   = Lambda_l L_lm rho_lpq                       (T 2.55)
    fixed exit    B_lmq    = Lambda_l L_lm rho_lq(t_o)                   (T 2.57)
    anisotropic   B_lmnpq  = sqrt(8 pi^2 / (2l + 1)) L_lm rho_{ln,pq}    (T 2.43)
    at an exit    B_lmn(o) = sqrt(8 pi^2 / (2l + 1)) L_lm rho_ln(o)      (T 2.44)
    one direction B_lm     = Lambda_l rho_l L_lm                         (T 2.62)

**B_lmpq has one meaning here**: the coefficient of B in the *orthonormal* functions C_lmpq =
Lambda_l^-1 D^l_mq Y_pq (T 2.54), hence with Lambda_l.  T 5.23 and P appendix A write
the same symbol for L_lm rho_lpq without it (ERRATA 37): divide by Lambda_l to get theirs.

The reciprocal form (T 2.58, 2.59) is the same functions with rho~ = rho cos t_i cos t_o; what they
return is then B~ = B cos t_o.  Lights are in complex harmonics (``harmonics.complex_from_real``),
except for the last form, which scales real and complex ones alike.  A ``Light`` instead of its
coefficients is expanded to the transfer's degree.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Inexact

from jaxrender.harmonics import (
    apply_transfer,
    band_limit_of,
    complex_basis,
    complex_from_real,
    degrees,
    orders,
    representation,
    rotate,
)
from jaxrender.lighting import Light
from jaxrender.shapes import AnyArray, Array, Coefficients, Float, Int, checked
from jaxrender.spectra.light import coefficients_of, light_coefficients

ComplexLight = Complex[AnyArray, "coefficient #channel"]
# Orders run from -F to F of the highest degree; entries of orders beyond their degree are zero.
IsotropicField = Complex[AnyArray, "degree order outgoing_degree outgoing_order channel"]
ExitField = Complex[AnyArray, "exit degree order outgoing_order channel"]
DirectionField = Complex[AnyArray, "exit degree order tangent_order channel"]
AnisotropicField = Complex[
    AnyArray, "degree order tangent_order outgoing_degree outgoing_order channel"
]


_ROOT_OF_TURN = float(np.sqrt(2 * np.pi))


class SurfacePoints(NamedTuple):
    """Where the surface is and where it is seen from: T's (alpha, beta, gamma) and w'_o.

    Normal (alpha, beta); ``gamma`` turns the tangents about it; ``outgoing`` in the local frame.
    """

    alpha: Float[AnyArray, "point"]
    beta: Float[AnyArray, "point"]
    gamma: Float[AnyArray, "point"]
    outgoing: Float[AnyArray, "point 3"]


@jax.jit
@checked
def convolve_isotropic(
    light: ComplexLight | Light,
    transfer: Inexact[AnyArray, "degree outgoing_degree absolute_order #channel"],
) -> IsotropicField:
    """Compute B_lmpq = Lambda_l L_lm rho_lpq (T 2.55, and 2.59 of rho~).

    ``transfer`` holds q = 0 ... Q and serves -q too (T 2.47).
    Raises ``ValueError`` unless light and transfer have the same degrees.
    """
    spread = _spread(_complex(light, np.shape(transfer)[0]))
    filter_ = jnp.asarray(transfer).astype(spread.dtype)
    _check_degrees(spread, filter_.shape[0])
    most = filter_.shape[2] - 1
    every = filter_[:, :, np.abs(np.arange(-most, most + 1))]
    scale = _wavelengths(spread)[:, None, None]
    return (scale * spread)[:, :, None, None, :] * every[:, None]


@jax.jit
@checked
def evaluate_isotropic(
    field: IsotropicField, points: SurfacePoints
) -> Complex[Array, "point channel"]:
    """Sum B = sum B_lmpq Lambda_l^-1 D^l_mq(alpha, beta) Y_pq(o) (T 2.54, 2.63); gamma is unused.

    For isotropic surfaces gamma is only the origin of the outgoing azimuth: 0 here (T 2.48).
    """
    field = jnp.asarray(field)
    outgoing_limit, most = field.shape[2] - 1, (field.shape[3] - 1) // 2
    turned = _representation(points, field, with_gamma=False)
    around = _harmonics_by_order(points.outgoing, outgoing_limit, most)
    unscaled = field / _wavelengths(field)[:, None, None, None, None]
    # D has the orders to the light's degree, the field those that both degrees have.
    turned = _middle(turned, most)
    return jnp.einsum("xlmq,lmpqc,xpq->xc", turned, unscaled, around, precision="highest")


@jax.jit
@checked
def convolve_at_exit(
    light: ComplexLight | Light, transfer: Inexact[AnyArray, "exit degree absolute_order #channel"]
) -> ExitField:
    """Compute B_lmq(t_o) = Lambda_l L_lm rho_lq(t_o) for each exit angle (T 2.57).

    ``transfer`` holds q = 0 ... Q; rho_l,-q = (-1)^q rho_lq.
    Raises ``ValueError`` unless light and transfer have the same degrees.
    """
    spread = _spread(_complex(light, np.shape(transfer)[1]))
    filter_ = jnp.asarray(transfer).astype(spread.dtype)
    _check_degrees(spread, filter_.shape[1])
    most = filter_.shape[2] - 1
    order = np.arange(-most, most + 1)
    sign = jnp.asarray(np.where(order < 0, (-1.0) ** order, 1.0), spread.dtype)
    every = filter_[:, :, np.abs(order)] * sign[None, None, :, None]
    scale = _wavelengths(spread)[:, None, None]
    return (scale * spread)[None, :, :, None, :] * every[:, :, None]


@jax.jit
@checked
def evaluate_at_exit(
    field: ExitField, exits: Int[AnyArray, "point"], points: SurfacePoints
) -> Complex[Array, "point channel"]:
    """Sum B_lmq(t_o) Lambda_l^-1 D^l_mq e^(i q phi_o) / sqrt(2 pi) (T 2.56).

    ``exits`` is the index of each point's exit angle in the field; of ``outgoing`` only the azimuth
    counts.
    """
    field = jnp.asarray(field)
    most = (field.shape[3] - 1) // 2
    chosen = field[jnp.asarray(exits)]
    turned = _middle(_representation(points, field[0], with_gamma=False), most)
    outgoing = jnp.asarray(points.outgoing)
    azimuth = jnp.arctan2(outgoing[:, 1], outgoing[:, 0])
    order = jnp.arange(-most, most + 1, dtype=azimuth.dtype)
    turns = azimuth[:, None] * order[None, :]
    wave = jax.lax.complex(jnp.cos(turns), jnp.sin(turns)) / _ROOT_OF_TURN
    unscaled = chosen / _wavelengths(field[0])[None, :, None, None, None]
    return jnp.einsum("xlmq,xlmqc,xq->xc", turned, unscaled, wave, precision="highest")


@jax.jit
@checked
def convolve_anisotropic(
    light: ComplexLight | Light,
    transfer: Complex[AnyArray, "incoming_coefficient outgoing_coefficient #channel"],
) -> AnisotropicField:
    """Compute B_lmnpq = sqrt(8 pi^2 / (2l + 1)) L_lm rho_{ln,pq} (T 2.43).

    The sum behind it runs over n = -l' ... l' (T 2.39; to l as printed: ERRATA 6).
    Raises ``ValueError`` unless light and transfer have the same degrees.
    """
    rho = jnp.asarray(transfer)
    spread = _spread(_complex(light, band_limit_of(rho.shape[0]) + 1))
    _check_degrees(spread, band_limit_of(rho.shape[0]) + 1)
    outgoing_count, channels = rho.shape[1:]
    by_incoming = _spread(rho.reshape(rho.shape[0], -1))
    by_incoming = by_incoming.reshape(*by_incoming.shape[:2], outgoing_count, channels)
    flat = jnp.moveaxis(by_incoming, 2, 0).reshape(outgoing_count, -1)
    both = _spread(flat)
    both = both.reshape(*both.shape[:2], *by_incoming.shape[:2], channels)
    scale = (_ROOT_OF_TURN * _wavelengths(spread))[:, None, None]
    return jnp.einsum("lmc,pqlnc->lmnpqc", *_same_channels(scale * spread, both))


@jax.jit
@checked
def evaluate_anisotropic(
    field: AnisotropicField, points: SurfacePoints
) -> Complex[Array, "point channel"]:
    """Sum B_lmnpq sqrt((2l + 1) / 8 pi^2) D^l_mn(alpha, beta, gamma) Y_pq(o) (T 2.40, 2.42)."""
    field = jnp.asarray(field)
    turned = _representation(points, field, with_gamma=True)
    outgoing_limit = field.shape[3] - 1
    around = _harmonics_by_order(points.outgoing, outgoing_limit, outgoing_limit)
    scale = (_ROOT_OF_TURN * _wavelengths(field)).reshape(-1, 1, 1, 1, 1, 1)
    return jnp.einsum("xlmn,lmnpqc,xpq->xc", turned, field / scale, around, precision="highest")


@jax.jit
@checked
def convolve_at_direction(
    light: ComplexLight | Light, transfer: Complex[AnyArray, "exit incoming_coefficient #channel"]
) -> DirectionField:
    """Compute B_lmn(o) = sqrt(8 pi^2 / (2l + 1)) L_lm rho_ln(o) at local exits o (T 2.44).

    ``transfer`` is ``spectra.anisotropic_outgoing_coefficients``, its lobes summed.  A fixed local
    exit is a slice of the light field, not an image, whose local exits differ.
    Raises ``ValueError`` unless light and transfer have the same degrees.
    """
    rho = jnp.asarray(transfer)
    spread = _spread(_complex(light, band_limit_of(rho.shape[1]) + 1))
    _check_degrees(spread, band_limit_of(rho.shape[1]) + 1)
    by_order = jax.vmap(_spread)(rho)
    scale = (_ROOT_OF_TURN * _wavelengths(spread))[:, None, None]
    return jnp.einsum("lmc,olnc->olmnc", *_same_channels(scale * spread, by_order))


@jax.jit
@checked
def evaluate_at_direction(
    field: DirectionField, exits: Int[AnyArray, "point"], points: SurfacePoints
) -> Complex[Array, "point channel"]:
    """Sum B = sum B_lmn(o) sqrt((2l + 1) / 8 pi^2) D^l_mn(alpha, beta, gamma) (T 2.40, 2.44).

    ``exits`` is the index of each point's exit in the field; ``points.outgoing`` is unused.
    """
    field = jnp.asarray(field)
    turned = _representation(points, field[0], with_gamma=True)
    scale = (_ROOT_OF_TURN * _wavelengths(field[0])).reshape(1, -1, 1, 1, 1)
    chosen = (field / scale)[jnp.asarray(exits)]
    return jnp.einsum("xlmn,xlmnc->xc", turned, chosen, precision="highest")


@checked
def convolve_radial(
    light: Coefficients | Light, transfer: Float[AnyArray, "degree"]
) -> Float[Array, "coefficient channel"]:
    """Compute B_lm = Lambda_l rho_l L_lm of a lobe u(C.L), ``transfer`` = Lambda_l rho_l (T 2.62).

    The result is a function of the central direction C alone (T 2.61): the normal for a Lambertian
    lobe, the reflected direction for Phong's.  Raises as ``harmonics.apply_transfer``.
    """
    return apply_transfer(coefficients_of(light, len(transfer) - 1), transfer)


@jax.jit
@checked
def reflect_about_mirror(
    light: Coefficients | Light,
    terms: Float[AnyArray, "point degree absolute_order"],
    world_from_mirror: Float[AnyArray, "point 3 3"],
) -> Float[Array, "point channel"]:
    """Sum Lambda_l^-1 h_lq L_lq about the reflected direction, for lobes of no symmetry about it.

    The reparameterisation at the end of T 2.3.4: ``world_from_mirror`` has R as third column and N
    in the half plane of the first; ``terms`` are ``spectra.facet_azimuthal_transfer``'s, one row
    for each point's exit cosine.
    """
    values = jnp.asarray(coefficients_of(light, jnp.shape(terms)[1] - 1))
    band_limit = band_limit_of(values.shape[0])
    if jnp.shape(terms)[1] != band_limit + 1:
        raise ValueError(
            f"terms of {jnp.shape(terms)[1]} degrees for light of {band_limit + 1}: "
            "cut or extend one of them to the other's band limit"
        )
    local = rotate(values, jnp.swapaxes(jnp.asarray(world_from_mirror), -1, -2))
    degree, order = np.arange(band_limit + 1)[:, None], np.arange(jnp.shape(terms)[2])[None, :]
    exists = order <= degree
    index = np.where(exists, degree * (degree + 1) + order, 0)
    wavelength = np.sqrt(4 * np.pi / (2 * degree + 1))
    scale = jnp.asarray(np.where(exists, 1 / wavelength, 0), values.dtype)
    weighted = jnp.asarray(terms) * scale[None]
    return jnp.einsum("xlq,xlqc->xc", weighted, local[:, index], precision="highest")


def _complex(light: ComplexLight | Light, degree_count: int) -> ComplexLight:
    if isinstance(light, Light):
        return complex_from_real(light_coefficients(light, degree_count - 1))
    return light


def _check_degrees(spread: Array, count: int) -> None:
    if spread.shape[0] != count:
        raise ValueError(
            f"light to degree {spread.shape[0] - 1} and a transfer to degree {count - 1}: cut or "
            "extend one of them to the other's band limit.  Coefficients with a lobe axis are "
            "weighed by spectra.sum_lobes first"
        )


def _spread(coefficients: Inexact[AnyArray, "coefficient k"]) -> Inexact[Array, "degree order k"]:
    """Spread flat coefficients to [degree, order -F..F], zero where an order exceeds its degree."""
    values = jnp.asarray(coefficients)
    band_limit = band_limit_of(values.shape[0])
    rows = jnp.zeros((band_limit + 1, 2 * band_limit + 1, values.shape[1]), values.dtype)
    return rows.at[degrees(band_limit), orders(band_limit) + band_limit].set(values)


def _wavelengths(field: Array) -> Inexact[Array, "degree"]:
    """Lambda_l = sqrt(4 pi / (2l + 1)) of the degrees on the first axis (T 2.51)."""
    degree = np.arange(field.shape[0])
    return jnp.asarray(np.sqrt(4 * np.pi / (2 * degree + 1)), field.dtype)


def _middle(turned: Array, most: int) -> Array:
    """Take, or fill with zeros, the last axis so that it has the orders -most ... most."""
    band_limit = (turned.shape[-1] - 1) // 2
    if most <= band_limit:
        return turned[..., band_limit - most : band_limit + most + 1]
    missing = most - band_limit
    return jnp.pad(turned, ((0, 0), (0, 0), (0, 0), (missing, missing)))


def _representation(points: SurfacePoints, field: Array, with_gamma: bool) -> Array:
    alpha, beta, gamma = (jnp.asarray(angle) for angle in points[:3])
    gamma = gamma if with_gamma else jnp.zeros_like(gamma)
    return representation(alpha, beta, gamma, field.shape[0] - 1)


def _harmonics_by_order(
    outgoing: Float[AnyArray, "point 3"], band_limit: int, most: int
) -> Complex[Array, "point degree order"]:
    """Y_pq(o) as [point, p, q = -most ... most]."""
    flat = complex_basis(jnp.asarray(outgoing), band_limit)
    return _middle(jnp.moveaxis(_spread(flat.T), -1, 0)[..., None, :], most)[..., 0, :]


def _same_channels(light: Array, both: Array) -> tuple[Array, Array]:
    channels = max(light.shape[-1], both.shape[-1])
    return (
        jnp.broadcast_to(light, (*light.shape[:-1], channels)),
        jnp.broadcast_to(both, (*both.shape[:-1], channels)),
    )
