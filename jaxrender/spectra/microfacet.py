"""The transfer h_l of a microfacet lobe: how much of each degree of the light it lets through.

Seen from the reflected direction R, the lobe F S G / (4 cos t_o) (T 3.42, 6.2) of a sample with
exit angle t_o is averaged over the azimuth about R, horizon included, which leaves the q = 0 part
of T 3.43:

h_l(t_o) = 2 pi int_0^pi h(t) P_l(cos t) sin t dt,    h(t) = (1 / 2 pi) int lobe(t, phi) dphi

so that slow light comes back as sum_l h_l(t_o) sum_m L_lm Y_lm(R).  ``exit_cosine_transfer`` is the
real thing; the twins are its value at normal exitance for every sample, and the thesis's Gaussian
exp(-(sigma l)^2) (T 3.51, 6.7), 4 to 23 % off for sigma of .1 to .5 (ERRATA 27).
"""

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Microfacet, normalised_fresnel
from jaxrender.geometry import Components
from jaxrender.harmonics import legendre
from jaxrender.shapes import AnyArray, Array, Float

# Gauss-Legendre nodes in the angle from R, on each side of the horizon's first touch, and in
# azimuth up to the horizon: the transfer is then good to 1e-6 of its largest value for sigma from
# .02 to 1 and exit cosines from .15 (1e-4 at cosine .02).
_POLAR_NODES = 64
_AZIMUTH_NODES = 32
# The lobe is below exp(-25) of its peak beyond this many sigmas from R.
_LOBE_RADIUS_PER_SIGMA = 10.0
# The transfer is tabulated at this many exit cosines when it is wanted for many samples, at equal
# steps of the square root: it rises as steeply as 1 / cosine towards grazing exit.
_EXIT_COSINE_KNOTS = 64
_LOWEST_COSINE = 0.02


def exit_cosine_transfer(
    brdf: Microfacet, exit_cosines: Float[AnyArray, "bin"], band_limit: int
) -> Float[Array, "bin degree"]:
    """Compute h_l(sigma, mu, exit cosine) by quadrature; differentiable in sigma and mu."""
    # N.V of unit vectors may round to just above 1.
    exit_angles = jnp.arccos(jnp.clip(jnp.asarray(exit_cosines), 0, 1))[:, None]
    polar, weights = _polar_nodes(exit_angles, jnp.asarray(brdf.sigma, exit_angles.dtype))
    mean = _azimuthal_mean(brdf, exit_angles, polar)
    polynomials = legendre(jnp.cos(polar), band_limit)
    kernel = 2 * jnp.pi * mean * jnp.sin(polar) * weights
    return jnp.einsum("bt,btl->bl", kernel, polynomials, precision="highest")


def normal_exitance_transfer(
    brdf: Microfacet, exit_cosines: Float[AnyArray, "bin"], band_limit: int
) -> Float[Array, "bin degree"]:
    """Compute the transfer at normal exitance (T 3.44), times each sample's Fresnel ratio."""
    cosines = jnp.asarray(exit_cosines)
    head_on = exit_cosine_transfer(brdf, jnp.ones_like(cosines[:1]), band_limit)
    return head_on * normalised_fresnel(brdf.mu, cosines)[:, None]


def gaussian_transfer(
    brdf: Microfacet, exit_cosines: Float[AnyArray, "bin"], band_limit: int
) -> Float[Array, "bin degree"]:
    """Compute the thesis's F exp(-(sigma l)^2) (T 3.51, 6.6, 6.7)."""
    cosines = jnp.asarray(exit_cosines)
    degrees = jnp.arange(band_limit + 1, dtype=cosines.dtype)
    gaussian = jnp.exp(-((brdf.sigma * degrees) ** 2))
    return gaussian[None, :] * normalised_fresnel(brdf.mu, cosines)[:, None]


TRANSFERS = {
    "exit-cosine": exit_cosine_transfer,
    "normal-exitance": normal_exitance_transfer,
    "gaussian": gaussian_transfer,
}


def _polar_nodes(
    exit_angles: Float[Array, "bin 1"], sigma: Float[Array, ""]
) -> tuple[Float[Array, "bin node"], Float[Array, "bin node"]]:
    """Place nodes over the lobe's extent, split where the circles about R first cross the horizon.

    There the averaged lobe has a kink that one Gauss rule could not follow.
    """
    # Circles wider than pi / 2 + t_o lie below the horizon altogether.
    reach = jnp.minimum(_LOBE_RADIUS_PER_SIGMA * sigma, jnp.pi / 2 + exit_angles)
    touch = jnp.minimum(jnp.pi / 2 - exit_angles, reach)
    nodes, weights = np.polynomial.legendre.leggauss(_POLAR_NODES)
    nodes = jnp.asarray((nodes + 1) / 2, exit_angles.dtype)[None, :]
    weights = jnp.asarray(weights / 2, exit_angles.dtype)[None, :]
    above, across = touch, reach - touch
    # A square puts nodes densest where the cut begins, and removes its square-root kink.
    polar = jnp.concatenate([above * nodes, touch + across * nodes**2], axis=1)
    return polar, jnp.concatenate([above * weights, across * 2 * nodes * weights], axis=1)


def _safe_arccos(cosines: Float[Array, "bin node"]) -> Float[Array, "bin node"]:
    """Take arccos with the ends clipped, and a derivative of zero there instead of infinity."""
    inside = jnp.abs(cosines) < 1
    angle = jnp.arccos(jnp.where(inside, cosines, 0))
    return jnp.where(inside, angle, jnp.where(cosines > 0, 0, jnp.pi))


def _azimuthal_mean(
    brdf: Microfacet, exit_angles: Float[Array, "bin 1"], polar: Float[Array, "bin node"]
) -> Float[Array, "bin node"]:
    """Average the lobe over the part of each circle about R that is above the horizon."""
    sin_o, cos_o = jnp.sin(exit_angles), jnp.cos(exit_angles)
    sin_t, cos_t = jnp.sin(polar), jnp.cos(polar)
    # In the plane of incidence: N = +Z, R = (-sin t_o, 0, cos t_o), V = (sin t_o, 0, cos t_o).
    # A circle of radius t about R, azimuth 0 towards N, meets the horizon at
    # cos phi = -cot t cot t_o.
    lift = sin_t * sin_o
    cosine = jnp.where(lift > 0, -cos_t * cos_o / jnp.where(lift > 0, lift, 1), -jnp.sign(cos_t))
    horizon = _safe_arccos(cosine)[..., None]
    nodes, weights = np.polynomial.legendre.leggauss(_AZIMUTH_NODES)
    azimuth = horizon * jnp.asarray((nodes + 1) / 2, polar.dtype)[None, None, :]
    toward, across = sin_t[..., None] * jnp.cos(azimuth), sin_t[..., None] * jnp.sin(azimuth)
    along = cos_t[..., None]
    sin_o, cos_o = sin_o[..., None], cos_o[..., None]
    incoming = Components(toward * cos_o - along * sin_o, across, toward * sin_o + along * cos_o)
    outgoing = Components(sin_o, jnp.zeros_like(sin_o), cos_o)
    lobe = brdf.specular_transfer(incoming, outgoing)
    weights = jnp.asarray(weights / 2, polar.dtype)[None, None, :]
    return jnp.sum(lobe * weights, axis=-1) * horizon[..., 0] / jnp.pi


def transfer_of_samples(
    brdf: Microfacet,
    exit_cosines: Float[AnyArray, "sample"],
    band_limit: int,
    transfer: str = "exit-cosine",
) -> Float[Array, "sample degree"]:
    """Look up the named transfer for many samples, by cubic interpolation in the exit cosine.

    Raises ``ValueError`` for a name that is not in ``TRANSFERS``.
    """
    if transfer not in TRANSFERS:
        raise ValueError(f"transfer={transfer!r}: choose one of {', '.join(TRANSFERS)}")
    cosines = jnp.clip(jnp.asarray(exit_cosines), _LOWEST_COSINE, 1)
    lowest = _LOWEST_COSINE**0.5
    knots = jnp.linspace(lowest, 1, _EXIT_COSINE_KNOTS, dtype=cosines.dtype) ** 2
    table = TRANSFERS[transfer](brdf, knots, band_limit)
    position = (jnp.sqrt(cosines) - lowest) / (1 - lowest) * (_EXIT_COSINE_KNOTS - 1)
    first = jnp.clip(jnp.floor(position).astype(int) - 1, 0, _EXIT_COSINE_KNOTS - 4)
    weights = _cubic_lagrange(position - first.astype(cosines.dtype))
    terms = (weights[k][:, None] * table[first + k] for k in range(4))
    return sum(terms, start=jnp.zeros((), table.dtype))


def _cubic_lagrange(x: Float[Array, "sample"]) -> list[Float[Array, "sample"]]:
    """Weigh the values at 0, 1, 2, 3 for the cubic through them at ``x``."""
    a, b, c, d = x, x - 1, x - 2, x - 3
    return [-b * c * d / 6, a * c * d / 2, -a * b * d / 2, a * b * c / 6]
