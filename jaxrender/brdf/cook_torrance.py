"""Cook and Torrance's model of 1982: microfacets whose colour is the metal's Fresnel reflectance.

rho_c = kd_c + ks_c F(eta_c, k_c, w_i . h) D(h) G(w_i, w_o) / (4 cos t_i cos t_o)

They print 1 / pi for 1 / 4 because their D has another scale; with a D of unit projected area the
factor is 1/4 (ERRATA 54).  Beckmann's distribution and V-shaped grooves are their choices and the
defaults.  The complex index eta + i k is each channel's own, so there is one lobe a channel.
"""

import equinox as eqx
import jax.numpy as jnp

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.distributions import Distribution
from jaxrender.brdf.facets import distribution_named, facet_transfer, facets_conserve_energy
from jaxrender.brdf.fresnel import conductor_fresnel
from jaxrender.brdf.half_vector import are_visible, lifted
from jaxrender.brdf.masking import FACET_MASKINGS
from jaxrender.brdf.parameters import (
    Scalar,
    as_scalar,
    as_scalar_or_none,
    matching,
    refuse_other_channels,
    refuse_outside,
    refuse_unlisted,
)
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float


class CookTorrance(BRDF):
    """Microfacets of index ``eta`` + i ``k`` per channel over a Lambertian base.

    ``k=0`` is a dielectric.  ``roughness`` in (0, 1] is the distribution's width along the tangent,
    ``roughness_y`` across it (``None``: the same).  Raises ``ValueError`` for values outside,
    unlisted names and an index for another number of channels.
    """

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    roughness: Scalar = eqx.field(converter=as_scalar)
    eta: Float[AnyArray, "_"]
    k: Float[AnyArray, "_"]
    roughness_y: Scalar | None = eqx.field(converter=as_scalar_or_none, default=None)
    distribution: str = eqx.field(static=True, default="beckmann")
    masking: str = eqx.field(static=True, default="v-groove")

    def __check_init__(self):
        refuse_unlisted("masking", self.masking, tuple(FACET_MASKINGS))
        self.facets()
        refuse_metal(self.eta, self.k, self.kd.shape[0])

    def facets(self) -> Distribution:
        """The distribution of facet normals."""
        return distribution_named(self.distribution, self.roughness, self.roughness_y)

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """The clamped cosine's row kd, then each channel's own lobe: ks on the diagonal."""
        return diagonal_amplitudes(self.kd, self.ks)

    @property
    def reciprocal(self) -> bool:
        """Always."""
        return True

    @property
    def conserves_energy(self) -> bool:
        """With a masking, when pi kd + ks is at most 1."""
        return facets_conserve_energy(self.masking, self.kd, self.ks)

    @property
    def isotropic(self) -> bool:
        """Unless the roughness differs along and across the tangent."""
        return self.roughness_y is None or bool(self.roughness_y == self.roughness)

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate the clamped cosine, and F_c D G / (4 cos t_o) for each channel."""
        visible = are_visible(incoming, outgoing)
        lobe, cosine = facet_transfer(
            self.facets(), self.masking, lifted(incoming), lifted(outgoing)
        )
        indices = zip(matching(self.eta, cosine), matching(self.k, cosine), strict=True)
        colours = (conductor_fresnel(eta, k, cosine) for eta, k in indices)
        coloured = (jnp.where(visible, lobe * colour, 0) for colour in colours)
        return jnp.where(visible, incoming.z, 0), *coloured


def diagonal_amplitudes(
    kd: Float[AnyArray, "channel"], ks: Float[AnyArray, "channel"]
) -> Float[Array, "lobe channel"]:
    """Stack kd and a diagonal of ks: what a model with one lobe a channel has for amplitudes."""
    return jnp.concatenate([jnp.asarray(kd)[None, :], jnp.diag(jnp.asarray(ks))])


def refuse_metal(eta: Float[AnyArray, "_"], k: Float[AnyArray, "_"], channels: int) -> None:
    """Raise ``ValueError`` for an impossible complex index or one for other channels."""
    refuse_other_channels("eta", eta, channels)
    refuse_other_channels("k", k, channels)
    refuse_outside("eta", eta, "(0, inf)", "metals have .1 to 5, such as gold's .14 in the red")
    refuse_outside("k", k, "[0, inf)", "absorption is positive here; 0 is a dielectric")
