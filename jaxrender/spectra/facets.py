"""Microfacet lobes of three distributions, by degree and exit cosine, horizon included.

A ``FacetLobe`` is F D G / (4 cos t_o), the transfer function of T 3.42 and 6.2 with the thesis's
Gaussian or one of the two distributions in use today (``brdf.Distribution``, unit projected area;
ERRATA 54):

========== ===================================================================
gaussian   D = exp(-(t_h / s)^2) / (pi s^2)                         (T 6.2)
beckmann   D = exp(-(tan t_h / s)^2) / (pi s^2 cos^4 t_h)
ggx        D = s^2 / (pi (cos^2 t_h (s^2 - 1) + 1)^2)
========== ===================================================================

Masking is Smith's, height-correlated, of the same distribution (Beckmann's for the Gaussian).
The lobe is ``brdf.Microfacet``'s, without its diffuse base: ``microfacet.exit_cosine_transfer`` of
that gives the numbers of ``facet_transfer``.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import DISTRIBUTIONS, Microfacet
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float, checked
from jaxrender.spectra.microfacet import Extent, extent_of
from jaxrender.spectra.mirror_frame import azimuthal_transfer, mean_transfer

Scalar = Float[AnyArray, ""] | float

FACET_DISTRIBUTIONS = tuple(DISTRIBUTIONS)


class FacetLobe(eqx.Module):
    """The lobe F D G / (4 cos t_o) with F the normalised Fresnel ratio; ``mu=None`` sets F = 1.

    Raises ``ValueError`` as ``brdf.Microfacet`` does.
    """

    sigma: Scalar
    mu: Scalar | None = None
    distribution: str = eqx.field(static=True, default="gaussian")
    masking: str = eqx.field(static=True, default="none")
    fresnel: str = eqx.field(static=True, default="exit")

    def __check_init__(self):
        self._model()

    def __call__(self, incoming: Components, outgoing: Components) -> Float[Array, "*batch"]:
        """Evaluate the lobe for directions above the horizon (below: meaningless)."""
        return self._model().specular_transfer(incoming, outgoing)

    @property
    def extent(self) -> Extent:
        """How far from the reflected direction the lobe reaches, and how wide its tail is."""
        model = self._model()
        return extent_of(model, jnp.asarray(model.sigma).dtype)

    def _model(self) -> Microfacet:
        black, white = np.zeros(1), np.ones(1)
        choices = self.fresnel, self.masking, self.distribution
        return Microfacet(black, white, self.sigma, self.mu, *choices)


@eqx.filter_jit
@checked
def facet_transfer(
    lobe: FacetLobe, exit_cosines: Float[AnyArray, "bin"], band_limit: int
) -> Float[Array, "bin degree"]:
    """Compute h_l(sigma, mu, exit cosine), the azimuthal mean; differentiable in sigma and mu."""
    return mean_transfer(lobe, exit_cosines, band_limit, *lobe.extent)


@eqx.filter_jit
@checked
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
    return azimuthal_transfer(lobe, exit_cosines, limits, *lobe.extent)


@checked
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
