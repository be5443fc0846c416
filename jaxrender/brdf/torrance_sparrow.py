"""Torrance and Sparrow's model of 1967 and its successors for dielectrics.

rho = kd + ks F(w_i . h) D(h) G(w_i, w_o) / (4 cos t_i cos t_o)

Their own choices are the defaults: Gaussian facets and V-shaped grooves.  ``distribution="ggx",
masking="smith"`` is today's.  Unlike in T 6.2 (``Microfacet``), F is the reflectance itself, so ks
is 1 for a clean surface; and G keeps the albedo below 1.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from jaxrender.brdf.distributions import Distribution
from jaxrender.brdf.facets import distribution_named, facet_transfer, facets_conserve_energy
from jaxrender.brdf.fresnel import fresnel, head_on_reflectance, schlick_fresnel
from jaxrender.brdf.glossy import Glossy
from jaxrender.brdf.half_vector import lifted
from jaxrender.brdf.masking import FACET_MASKINGS
from jaxrender.brdf.parameters import (
    Scalar,
    as_scalar,
    as_scalar_or_none,
    matching,
    refuse_outside,
    refuse_unlisted,
)
from jaxrender.brdf.parametric import ShapeParameter
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float

FACET_FRESNELS = ("exact", "schlick")
# The exponential distributions are below exp(-25) of their peak beyond this many widths of the half
# angle (Gaussian) or of its tangent (Beckmann).
_REACH = 5.0


class TorranceSparrow(Glossy):
    """Microfacets of a refractive index ``mu`` over a Lambertian base; ``mu=None`` sets F = 1.

    ``roughness`` in (0, 1] is the distribution's width along the tangent, ``roughness_y`` across
    it (``None``: the same).  Raises ``ValueError`` for values outside and unlisted names.
    """

    # The roughness; of an anisotropic distribution that along +X.
    shape: ClassVar[ShapeParameter] = ShapeParameter("roughness")

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    roughness: Scalar = eqx.field(converter=as_scalar)
    mu: Scalar | None = eqx.field(converter=as_scalar_or_none, default=None)
    roughness_y: Scalar | None = eqx.field(converter=as_scalar_or_none, default=None)
    distribution: str = eqx.field(static=True, default="gaussian")
    masking: str = eqx.field(static=True, default="v-groove")
    fresnel: str = eqx.field(static=True, default="exact")

    def __check_init__(self):
        refuse_unlisted("masking", self.masking, tuple(FACET_MASKINGS))
        refuse_unlisted("fresnel", self.fresnel, FACET_FRESNELS)
        self.facets()
        if self.mu is not None:
            refuse_outside("mu", self.mu, "(1, inf)", "None sets the Fresnel factor to 1")

    def facets(self) -> Distribution:
        """The distribution of facet normals."""
        return distribution_named(self.distribution, self.roughness, self.roughness_y)

    @property
    def sigma(self) -> Scalar:
        """The roughness, as a lobe's width."""
        return self.roughness

    @property
    def reciprocal(self) -> bool:
        """Always: the Fresnel factor is taken at the half angle."""
        return True

    @property
    def conserves_energy(self) -> bool:
        """With a masking, when pi kd + ks is at most 1."""
        return facets_conserve_energy(self.masking, self.kd, self.ks)

    @property
    def isotropic(self) -> bool:
        """Unless the roughness differs along and across the tangent."""
        return self.roughness_y is None or bool(self.roughness_y == self.roughness)

    @property
    def fresnel_is_factor(self) -> bool:
        """Only where there is none: it is taken at the half angle."""
        return self.mu is None

    @property
    def reach(self) -> Float[Array, ""] | None:
        """Twice the half angle at which the distribution ends; GGX has a tail."""
        if self.distribution == "ggx":
            return None
        widths = (
            (self.roughness,) if self.roughness_y is None else (self.roughness, self.roughness_y)
        )
        end = _REACH * jnp.max(jnp.stack([jnp.asarray(width) for width in widths]))
        return 2 * (end if self.distribution == "gaussian" else jnp.arctan(end))

    @property
    def energy(self) -> Scalar:
        """The facets' reflectance head-on, F(mu, 0)."""
        return 1.0 if self.mu is None else head_on_reflectance(self.mu)

    def as_metal(self) -> "TorranceSparrow":
        """Have no factor to drop: the reflectance belongs to the lobe."""
        return self

    def specular_transfer(
        self, incoming: Components, outgoing: Components
    ) -> Float[Array, "*batch"]:
        """Evaluate F D G / (4 cos t_o)."""
        lobe, cosine = facet_transfer(
            self.facets(), self.masking, lifted(incoming), lifted(outgoing)
        )
        if self.mu is None:
            return lobe
        mu = matching(self.mu, cosine)
        if self.fresnel == "exact":
            return lobe * fresnel(mu, cosine)
        return lobe * schlick_fresnel(head_on_reflectance(mu), cosine)
