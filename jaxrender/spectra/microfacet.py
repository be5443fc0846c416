"""The transfer h_l of a glossy lobe: how much of each degree of the light it lets through.

Seen from the reflected direction R, the lobe F D G / (4 cos t_o) (T 3.42, 6.2) of a sample with
exit angle t_o is averaged over the azimuth about R, horizon included, which leaves the q = 0 part
of T 3.43:

h_l(t_o) = 2 pi int_0^pi h(t) P_l(cos t) sin t dt,    h(t) = (1 / 2 pi) int lobe(t, phi) dphi

so that slow light comes back as sum_l h_l(t_o) sum_m L_lm Y_lm(R).  ``exit_cosine_transfer`` is the
real thing, of whichever glossy model it is; the twins are its value at normal exitance for every
sample, and the thesis's Gaussian exp(-(sigma l)^2) (T 3.51, 6.7), for the thesis's own
distribution 4 to 23 % off for sigma of .1 to .5 (ERRATA 27).
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike

from jaxrender.brdf import Glossy, Parametric, normalised_fresnel
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Float, checked
from jaxrender.spectra.mirror_frame import azimuthal_transfer, mean_transfer

# The transfer is tabulated at this many exit cosines when it is wanted for many samples, at equal
# steps of the square root: it rises as steeply as 1 / cosine towards grazing exit.  High degrees
# see finer structure and ask for two knots each.
_EXIT_COSINE_KNOTS = 64
_KNOTS_PER_DEGREE = 2
_LOWEST_COSINE = 0.02


class Extent(NamedTuple):
    """How far a lobe reaches from R (radians), and the tangent of half its width if it has a tail.

    Both as ``mirror_frame.mean_transfer`` takes them.
    """

    reach: Float[Array, ""]
    tail: Float[Array, ""] | None


def extent_of(brdf: Glossy, dtype: DTypeLike) -> Extent:
    """Tell the quadrature about R how far the specular lobe goes: one with a tail everywhere."""
    reach = brdf.reach
    if reach is None:
        sigma = jnp.asarray(brdf.sigma, dtype)
        return Extent(jnp.full_like(sigma, jnp.pi), sigma)
    return Extent(jnp.asarray(reach, dtype), None)


@eqx.filter_jit
@checked
def exit_cosine_transfer(
    brdf: Glossy, exit_cosines: Float[AnyArray, "bin"], band_limit: int
) -> Float[Array, "bin degree"]:
    """Compute h_l(sigma, mu, exit cosine) by quadrature; differentiable in sigma and mu."""
    cosines = jnp.asarray(exit_cosines)
    extent = extent_of(brdf, cosines.dtype)
    return mean_transfer(brdf.specular_transfer, cosines, band_limit, *extent)


@eqx.filter_jit
@checked
def normal_exitance_transfer(
    brdf: Glossy, exit_cosines: Float[AnyArray, "bin"], band_limit: int
) -> Float[Array, "bin degree"]:
    """Compute the transfer at normal exitance (T 3.44), times each sample's Fresnel ratio."""
    cosines = jnp.asarray(exit_cosines)
    head_on = exit_cosine_transfer(brdf, jnp.ones_like(cosines[:1]), band_limit)
    return head_on * normalised_fresnel(brdf.mu, cosines)[:, None]


@eqx.filter_jit
def head_on_transfer(brdf: Parametric, band_limit: int) -> Float[Array, "degree"]:
    """Compute the transfer of any parametric BRDF at normal exitance, where N is R (T 3.44).

    The mean over the azimuth is that of anisotropic lobes, too.
    """
    one = jnp.ones(1, jnp.asarray(brdf.amplitudes).dtype)
    extent = jnp.asarray(jnp.pi / 2, one.dtype)
    return mean_transfer(lambda i, o: brdf.transfer(i, o)[1], one, band_limit, extent)[0]


@checked
def gaussian_transfer(
    brdf: Glossy, exit_cosines: Float[AnyArray, "bin"], band_limit: int
) -> Float[Array, "bin degree"]:
    """Compute the thesis's F exp(-(sigma l)^2) (T 3.51, 6.6, 6.7), whatever the distribution.

    Where ks is not the lobe's albedo, times the lobe's own (``Glossy.energy``).
    """
    cosines = jnp.asarray(exit_cosines)
    degrees = jnp.arange(band_limit + 1, dtype=cosines.dtype)
    gaussian = jnp.asarray(brdf.energy, cosines.dtype) * jnp.exp(-((brdf.sigma * degrees) ** 2))
    return gaussian[None, :] * normalised_fresnel(brdf.mu, cosines)[:, None]


TRANSFERS = {
    "exit-cosine": exit_cosine_transfer,
    "normal-exitance": normal_exitance_transfer,
    "gaussian": gaussian_transfer,
}


@stored(effort="less")
@checked
def transfer_of_samples(
    brdf: Glossy,
    exit_cosines: Float[AnyArray, "sample"],
    band_limit: int,
    transfer: str = "exit-cosine",
) -> Float[Array, "sample degree"]:
    """Look up the named transfer for many samples, by cubic interpolation in the exit cosine.

    Raises ``ValueError`` for a name that is not in ``TRANSFERS``.
    """
    cosines = jnp.asarray(exit_cosines)
    return transfer_at(transfer_table(brdf, band_limit, cosines.dtype, transfer), cosines)


def transfer_table(
    brdf: Glossy, band_limit: int, dtype: np.dtype, transfer: str = "exit-cosine"
) -> Float[Array, "knot degree"]:
    """Tabulate the named transfer over exit cosines, for ``transfer_at``.

    Raises ``ValueError`` for a name that is not in ``TRANSFERS``.
    """
    if transfer not in TRANSFERS:
        raise ValueError(f"transfer={transfer!r}: choose one of {', '.join(TRANSFERS)}")
    return TRANSFERS[transfer](brdf, _knots(_knot_count(band_limit), dtype), band_limit)


@eqx.filter_jit
@checked
def azimuthal_transfer_of_samples(
    brdf: Glossy,
    exit_cosines: Float[AnyArray, "sample"],
    band_limit: int,
    order_limit: int | None = None,
) -> Float[Array, "sample degree order"]:
    """Look up h_lq of T 3.43 for many samples, all orders 0 ... F or to a limit; order 0 is h_l.

    With them slow light is reflected exactly: see ``reflection.reflect_slow_light``.  Fewer samples
    than the table would have knots are integrated each by itself, which is quicker.
    """
    cosines = jnp.asarray(exit_cosines)

    def table(knots: Float[Array, "knot"]) -> Float[Array, "knot degree order"]:
        limits = (band_limit, band_limit if order_limit is None else min(order_limit, band_limit))
        extent = extent_of(brdf, knots.dtype)
        return azimuthal_transfer(brdf.specular_transfer, knots, limits, *extent)

    if len(cosines) <= _knot_count(band_limit):
        return table(jnp.clip(cosines, _LOWEST_COSINE, 1))
    return transfer_at(table(_knots(_knot_count(band_limit), cosines.dtype)), cosines)


def _knot_count(band_limit: int) -> int:
    """Say at how many exit cosines the transfer is tabulated."""
    return max(_EXIT_COSINE_KNOTS, _KNOTS_PER_DEGREE * band_limit)


def _knots(count: int, dtype: np.dtype) -> Float[Array, "knot"]:
    """Space exit cosines evenly in their roots."""
    return jnp.linspace(_LOWEST_COSINE**0.5, 1, count, dtype=dtype) ** 2


@checked
def transfer_at(
    table: Float[Array, "knot *rest"], exit_cosines: Float[AnyArray, "sample"]
) -> Float[Array, "sample *rest"]:
    """Look a function of the exit cosine up in its table (``transfer_table``), by cubics."""
    cosines = jnp.clip(jnp.asarray(exit_cosines), _LOWEST_COSINE, 1)
    lowest, count = _LOWEST_COSINE**0.5, len(table)
    position = (jnp.sqrt(cosines) - lowest) / (1 - lowest) * (count - 1)
    first = jnp.clip(jnp.floor(position).astype(int) - 1, 0, count - 4)
    weights = _cubic_lagrange(position - first.astype(cosines.dtype))
    shape = (-1,) + (1,) * (table.ndim - 1)
    terms = (weights[k].reshape(shape) * table[first + k] for k in range(4))
    return sum(terms, start=jnp.zeros((), table.dtype))


def _cubic_lagrange(x: Float[Array, "sample"]) -> list[Float[Array, "sample"]]:
    """Weigh the values at 0, 1, 2, 3 for the cubic through them at ``x``."""
    a, b, c, d = x, x - 1, x - 2, x - 3
    return [-b * c * d / 6, a * c * d / 2, -a * b * d / 2, a * b * c / 6]
