"""Microfacet lobes of three distributions, by degree and exit cosine, horizon included.

A ``FacetLobe`` is F D G / (4 cos t_o), the transfer function of T 3.42 and 6.2 with the thesis's
Gaussian (``brdf.Microfacet``) or one of the two distributions in use today (``brdf.Distribution``,
unit projected area; ERRATA 54):

========== ===================================================================
gaussian   D = exp(-(t_h / s)^2) / (pi s^2)                         (T 6.2)
beckmann   D = exp(-(tan t_h / s)^2) / (pi s^2 cos^4 t_h)
ggx        D = s^2 / (pi (cos^2 t_h (s^2 - 1) + 1)^2)
========== ===================================================================

Masking is Smith's, height-correlated, of the same distribution (Beckmann's for the Gaussian).
For the thesis's own model ``microfacet.exit_cosine_transfer`` gives the same numbers.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.brdf import DISTRIBUTIONS, FRESNEL_ANGLES, Microfacet, normalised_fresnel
from jaxrender.brdf.facets import facet_transfer as facet_lobe
from jaxrender.brdf.half_vector import lifted
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float
from jaxrender.spectra.mirror_frame import azimuthal_transfer, mean_transfer

Scalar = Float[AnyArray, ""] | float

# The exponential lobes are below exp(-25) of their peak beyond this many sigmas of the half angle.
_REACH = 5.0


FACET_DISTRIBUTIONS = ("gaussian", "beckmann", "ggx")
LOBE_MASKINGS = ("none", "smith")


class FacetLobe(eqx.Module):
    """The lobe F D G / (4 cos t_o) with F the normalised Fresnel ratio; ``mu=None`` sets F = 1.

    Raises ``ValueError`` for unknown names and, outside traced functions, for sigma <= 0.
    """

    sigma: Scalar
    mu: Scalar | None = None
    distribution: str = eqx.field(static=True, default="gaussian")
    masking: str = eqx.field(static=True, default="none")
    fresnel: str = eqx.field(static=True, default="exit")

    def __check_init__(self):
        named = (
            ("distribution", self.distribution, FACET_DISTRIBUTIONS),
            ("masking", self.masking, LOBE_MASKINGS),
            ("fresnel", self.fresnel, FRESNEL_ANGLES),
        )
        for field, name, known in named:
            if name not in known:
                raise ValueError(f"{field}={name!r}: choose one of {', '.join(known)}")
        if not isinstance(self.sigma, Tracer) and not self.sigma > 0:
            raise ValueError(f"sigma={self.sigma}: the roughness must be above 0")

    def __call__(self, incoming: Components, outgoing: Components) -> Float[Array, "*batch"]:
        """Evaluate the lobe for directions above the horizon (below: meaningless)."""
        if self.distribution == "gaussian":
            return self._thesis_model().specular_transfer(incoming, outgoing)
        facets = DISTRIBUTIONS[self.distribution](self.sigma)
        outgoing = lifted(outgoing)
        lobe, cosine = facet_lobe(facets, self.masking, lifted(incoming), outgoing)
        if self.mu is None:
            return lobe
        return lobe * normalised_fresnel(
            self.mu, jnp.asarray(outgoing.z) if self.fresnel == "exit" else cosine
        )

    @property
    def reach(self) -> Float[Array, ""]:
        """The angle from the reflected direction beyond which there is nothing, radians."""
        sigma = jnp.asarray(self.sigma)
        if self.distribution == "ggx":
            return jnp.full_like(sigma, jnp.pi)
        half = _REACH * sigma if self.distribution == "gaussian" else jnp.arctan(_REACH * sigma)
        return 2 * half

    @property
    def tail(self) -> Float[Array, ""] | None:
        """The tangent of half the lobe's width, where its tail falls slowly."""
        return jnp.asarray(self.sigma) if self.distribution == "ggx" else None

    def _thesis_model(self) -> Microfacet:
        black, white = np.zeros(1), np.ones(1)
        return Microfacet(black, white, self.sigma, self.mu, self.fresnel, self.masking)


def facet_transfer(
    lobe: FacetLobe, exit_cosines: Float[AnyArray, "bin"], band_limit: int
) -> Float[Array, "bin degree"]:
    """Compute h_l(sigma, mu, exit cosine), the azimuthal mean; differentiable in sigma and mu."""
    return mean_transfer(lobe, exit_cosines, band_limit, lobe.reach, lobe.tail)


def facet_azimuthal_transfer(
    lobe: FacetLobe,
    exit_cosines: Float[AnyArray, "bin"],
    band_limit: int,
    order_limit: int,
) -> Float[Array, "bin degree order"]:
    """Compute h_lq = Lambda_l rho_lq(t_o) of T 3.43 for q = 0 ... ``order_limit``.

    The azimuth about R is 0 towards N; see ``mirror_frame``.  Order 0 is ``facet_transfer``.
    """
    limits = (band_limit, order_limit)
    return azimuthal_transfer(lobe, exit_cosines, limits, lobe.reach, lobe.tail)


def matched_gaussian_transfer(sigma: Scalar, band_limit: int) -> Float[Array, "degree"]:
    """Compute A_0 exp(-sigma^2 l(l+1)), with the lobe's own energy at normal exitance.

    A_0 = 1 - exp(-(pi / 4 sigma)^2) - ... = 2 pi int_0^(pi/2) of T 3.44 is .993, .974, .941, .805
    for sigma .1, .2, .3, .5; the thesis's exp(-(sigma l)^2) starts at 1 and is 4 to 40 times
    further off (ERRATA 27).
    """
    width = jnp.asarray(sigma, jnp.result_type(sigma, float))
    energy = facet_transfer(FacetLobe(width), jnp.ones((1,), width.dtype), 0)[0]
    degrees = jnp.arange(band_limit + 1, dtype=width.dtype)
    return energy * jnp.exp(-(width**2) * degrees * (degrees + 1))
