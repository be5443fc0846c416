"""Functions on the rotation group: grid, Fourier transform and convolution (T 2.3.3).

    f_l = int f(R) D^l(R) dR,    f(R) = sum_l (2l + 1) / (8 pi^2) tr(f_l D^l(R)^dagger)

(T 2.45 with the D^l of ``wigner``; the inverse is T 2.41).  The measure is sin(alpha) dalpha dbeta
dgamma, of total 8 pi^2; R = Rz(beta) Ry(alpha) Rz(gamma).  The transform of a function is a matrix
for each degree; all stand in one array [degree, order m, order m'], orders -F ... F, zero where an
order exceeds the degree.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Inexact

from jaxrender.harmonics.circle import phases
from jaxrender.harmonics.indexing import coefficient_count
from jaxrender.harmonics.legendre import gauss_legendre
from jaxrender.harmonics.wigner import small_d
from jaxrender.shapes import AnyArray, Array, Float, checked

GroupSamples = Inexact[AnyArray, "alpha beta gamma"]
GroupCoefficients = Complex[AnyArray, "degree order order"]

_einsum = partial(jnp.einsum, precision=jax.lax.Precision.HIGHEST)


class RotationGrid(eqx.Module):
    """Rotations that integrate products of two functions up to ``band_limit`` exactly.

    F + 1 Gauss-Legendre nodes in cos(alpha), 2F + 1 equal angles beta and as many gamma; hashable,
    all static.  Raises ValueError if the band limit is negative.
    """

    band_limit: int = eqx.field(static=True)

    def __check_init__(self):
        coefficient_count(self.band_limit)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of angles alpha, beta, gamma."""
        return (self.band_limit + 1, 2 * self.band_limit + 1, 2 * self.band_limit + 1)

    def alphas(self) -> Float[np.ndarray, " alpha"]:
        """Angles about y, radians, increasing."""
        return gauss_legendre(self.band_limit + 1).angles

    def betas(self) -> Float[np.ndarray, " beta"]:
        """Angles of the last turn about z, radians; also those of the first, gamma."""
        return np.arange(2 * self.band_limit + 1) * (2.0 * np.pi / (2 * self.band_limit + 1))

    def weights(self) -> Float[np.ndarray, " alpha"]:
        """Measure of one rotation of each alpha; sums to 8 pi^2 over the grid."""
        nodes = gauss_legendre(self.band_limit + 1).weights
        return nodes * (2.0 * np.pi / (2 * self.band_limit + 1)) ** 2


@checked
def analyse_rotations(
    grid: RotationGrid, samples: GroupSamples, band_limit: int
) -> Complex[Array, "degree order order"]:
    """Return f_l, l = 0 ... F, of a function sampled on the grid (T 2.45).

    Raises ValueError if the samples are not the grid's or if F exceeds the grid's band limit.
    """
    coefficient_count(band_limit)
    if samples.shape != grid.shape:
        raise ValueError(
            f"{samples.shape} samples on a grid of {grid.shape} rotations; sample f at its angles"
        )
    if band_limit > grid.band_limit:
        raise ValueError(
            f"degree {band_limit} cannot be determined from a grid of band limit "
            f"{grid.band_limit}; ask for {grid.band_limit} or less, or take a finer grid"
        )
    return _analyse(grid, band_limit, jnp.asarray(samples))


@checked
def synthesise_rotations(
    grid: RotationGrid, coefficients: GroupCoefficients
) -> Complex[Array, "alpha beta gamma"]:
    """Return the samples of a function given by its f_l, at any band limit."""
    return _synthesise(grid, jnp.asarray(coefficients))


@checked
def correlate_rotations(
    first: GroupCoefficients, second: GroupCoefficients
) -> Complex[Array, "degree order order"]:
    """Return f_l g_l^dagger, the transform of h(s) = int f(s t) conj(g(t)) dt.

    That is T 2.16 for real g; T 2.46 prints f_l g_l, which misses the dagger (ERRATA 8).
    """
    return _einsum("lmk,lnk->lmn", jnp.asarray(first), jnp.conj(jnp.asarray(second)))


@checked
def convolve_rotations(
    first: GroupCoefficients, second: GroupCoefficients
) -> Complex[Array, "degree order order"]:
    """Return f_l g_l, the transform of h(s) = int f(s t^-1) g(t) dt."""
    return _einsum("lmk,lkn->lmn", jnp.asarray(first), jnp.asarray(second))


@partial(jax.jit, static_argnums=(0, 1))
def _analyse(grid: RotationGrid, band_limit: int, samples: Array) -> Array:
    turned, waves = _tables(grid, band_limit, samples.real.dtype)
    weights = jnp.asarray(grid.weights(), turned.dtype)
    values = samples.astype(waves.dtype)
    by_order = _einsum("abg,bm,gn->amn", values, waves, waves)
    weighted = (turned * weights[:, None, None, None]).astype(waves.dtype)
    return _einsum("almn,amn->lmn", weighted, by_order)


@partial(jax.jit, static_argnums=0)
def _synthesise(grid: RotationGrid, coefficients: Array) -> Array:
    band_limit = coefficients.shape[0] - 1
    turned, waves = _tables(grid, band_limit, coefficients.real.dtype)
    share = jnp.asarray((2 * np.arange(band_limit + 1) + 1) / (8.0 * np.pi**2), turned.dtype)
    scaled = (turned * share[None, :, None, None]).astype(waves.dtype)
    by_order = _einsum("almn,lmn->amn", scaled, coefficients)
    return _einsum("amn,bm,gn->abg", by_order, jnp.conj(waves), jnp.conj(waves))


def _tables(grid: RotationGrid, band_limit: int, dtype) -> tuple[Array, Array]:
    """Return d^l(alpha) and exp(i m beta) of the grid's angles."""
    turned = small_d(jnp.asarray(grid.alphas(), dtype), band_limit)
    return turned, phases(jnp.asarray(grid.betas(), dtype), band_limit)
