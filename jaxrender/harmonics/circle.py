"""Functions on the circle: the flatland of T 2.2.2, in which rotations only shift the angle.

    F_k(t) = exp(i k t) / sqrt(2 pi),    f(t) = sum_k f_k F_k(t),    f_k = int f conj(F_k) dt

(T 2.17).  Orders run k = -F ... F, so a band limit F means 2F + 1 complex coefficients; those of a
real function obey f_{-k} = conj(f_k).  N samples lie at the angles (j + 1/2) 2 pi / N, like the
columns of a latitude-longitude image, and determine every function up to degree (N - 1) // 2.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Inexact

from jaxrender.shapes import AnyArray, Array, Float, checked

CircleCoefficients = Complex[AnyArray, "order channel"]


def circle_angles(count: int) -> Float[np.ndarray, " sample"]:
    """Return the angles (j + 1/2) 2 pi / N of N samples; ValueError unless N is 1 or more."""
    if count < 1:
        raise ValueError(f"{count} samples on the circle; give 1 or more")
    return (np.arange(count) + 0.5) * (2.0 * np.pi / count)


@checked
def circle_basis(
    angles: Float[AnyArray, "*batch"], band_limit: int
) -> Complex[Array, "*batch order"]:
    """Return F_k of every angle, radians, k = -F ... F (T 2.17); ValueError if F is negative."""
    return phases(angles, band_limit) * (1.0 / math.sqrt(2.0 * math.pi))


def phases(angles: Float[AnyArray, "*batch"], band_limit: int) -> Complex[Array, "*batch order"]:
    """Return exp(i k t) of every angle, radians, k = -F ... F; ValueError if F is negative."""
    if band_limit < 0:
        raise ValueError(f"band_limit is {band_limit}; it is a degree, so give 0 or more")
    angle = jnp.asarray(angles)[..., None]
    order = jnp.asarray(np.arange(-band_limit, band_limit + 1), angle.dtype)
    turns = angle * order.reshape((1,) * (angle.ndim - 1) + (-1,))
    return jax.lax.complex(jnp.cos(turns), jnp.sin(turns))


@checked
def analyse_circle(
    samples: Inexact[AnyArray, "sample channel"], band_limit: int
) -> Complex[Array, "order channel"]:
    """Return f_k = (2 pi / N) sum_j f(t_j) conj(F_k(t_j)), exact up to degree (N - 1) // 2.

    Raises ValueError if F is negative or exceeds that limit.
    """
    values = jnp.asarray(samples)
    count = values.shape[0]
    if band_limit > (count - 1) // 2:
        raise ValueError(
            f"degree {band_limit} cannot be determined from {count} samples on the circle; "
            f"ask for {(count - 1) // 2} or less, or give more samples"
        )
    basis = circle_basis(jnp.asarray(circle_angles(count), values.real.dtype), band_limit)
    return (2.0 * np.pi / count) * jnp.conj(basis).T @ values.astype(basis.dtype)


@checked
def synthesise_circle(
    coefficients: CircleCoefficients, count: int
) -> Complex[Array, "sample channel"]:
    """Return the samples of a function at ``circle_angles(count)``, at any band limit.

    Raises ValueError if the number of coefficients is even or the count below 1.
    """
    values = jnp.asarray(coefficients)
    angles = jnp.asarray(circle_angles(count), values.real.dtype)
    return circle_basis(angles, _band_limit(values)) @ values


@checked
def rotate_circle(
    coefficients: CircleCoefficients, angle: Float[AnyArray, "*batch"]
) -> Complex[Array, "*batch order channel"]:
    """Return the coefficients of f(angle + t) as a function of t: times exp(i k angle) (T 2.19).

    This is light seen from the local frame of a surface whose normal stands at ``angle``.
    Raises ValueError if the number of coefficients is even.
    """
    values = jnp.asarray(coefficients)
    return jnp.einsum("...k,kc->...kc", phases(angle, _band_limit(values)), values)


@checked
def reflect_circle(
    light: Complex[AnyArray, "order #channel"], transfer: Complex[AnyArray, "transfer #channel"]
) -> Complex[Array, "order channel"]:
    """Return B_l = sqrt(2 pi) L_l rho_l (T 2.24, 2.25): the reflection equation in flatland.

    B(alpha) = int L(alpha + t) rho(t) dt for rho = sum_l rho_l conj(F_l) (T 2.20); the channels of
    ``transfer`` may be outgoing angles or the orders p of T 2.24, of light given in one channel.
    Raises ValueError if the band limits differ or the number of coefficients is even.
    """
    own, filtering = jnp.asarray(light), jnp.asarray(transfer)
    if _band_limit(own) != _band_limit(filtering):
        raise ValueError(
            f"light of {own.shape[0]} coefficients and a transfer of {filtering.shape[0]}; "
            "cut or extend one of them to the other's band limit"
        )
    return math.sqrt(2.0 * math.pi) * own * filtering


def _band_limit(coefficients: Array) -> int:
    count = coefficients.shape[0]
    if count % 2 == 0:
        raise ValueError(f"{count} coefficients fit no band limit; give 2 F + 1 of them")
    return count // 2
