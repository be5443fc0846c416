"""The material of glTF 2.0 as a BRDF, with KHR_materials_ior, _specular, _clearcoat, _anisotropy.

With S the GGX lobe of alpha = roughness^2 with separate masking, c = base_color, m = metallic, and
P(x) = (1 - x)^5, the dielectric has, in each channel,

    F = f_0 + (w - f_0) P(w_i . h),  f_0 = w min(F_0(ior) specular_color, 1),
    rho_d = (1 - max_c F) c / pi + F S,  rho_m = (c + (1 - c) P(w_i . h)) S,

w the specular factor; rho = (1 - m) rho_d + m rho_m.  A clear coat of weight k takes its share at
both ends: with G = k (.04 + .96 P(n . w)) of the direction w to the viewer,

    rho_coated = (1 - G) rho + G S_coat.

KHR_materials_anisotropy of strength a makes alpha + (1 - alpha) a^2 of the base's width along the
tangent.  A file has the tangents at its vertices; here they are the meridians about +Z, turned.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF, TrowbridgeReitz, head_on_reflectance
from jaxrender.brdf.facets import FacetTransfer, facet_transfer
from jaxrender.brdf.fresnel import schlick_growth
from jaxrender.brdf.half_vector import are_visible, lifted
from jaxrender.brdf.parameters import Scalar, as_scalar, matching
from jaxrender.brdf.tangents import in_tangent_frame
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float

_COAT_HEAD_ON = 0.04
# A mirror has no values: viewers hold alpha above about this.
LEAST_ALPHA = 1e-3


class GltfMaterial(BRDF):
    """What a glTF file holds of a material: numbers that apply to all of its surface."""

    base_color: Float[AnyArray, "3"]
    metallic: Scalar = eqx.field(converter=as_scalar)
    roughness: Scalar = eqx.field(converter=as_scalar)
    ior: Scalar = eqx.field(converter=as_scalar, default=1.5)
    specular: Scalar = eqx.field(converter=as_scalar, default=1.0)
    specular_color: Float[AnyArray, "3"] = eqx.field(default_factory=lambda: np.ones(3))
    clearcoat: Scalar = eqx.field(converter=as_scalar, default=0.0)
    clearcoat_roughness: Scalar = eqx.field(converter=as_scalar, default=0.0)
    anisotropy_strength: Scalar = eqx.field(converter=as_scalar, default=0.0)
    anisotropy_rotation: Scalar = eqx.field(converter=as_scalar, default=0.0)

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """One: every channel has a lobe of its own."""
        return np.eye(3)

    @property
    def reciprocal(self) -> bool:
        """But for a coat, which knows the viewer's direction alone."""
        return not np.any(np.asarray(self.clearcoat))

    @property
    def conserves_energy(self) -> bool:
        """Of a metal alone."""
        metal = bool(np.asarray(self.metallic) == 1)
        return metal and bool(np.all(np.asarray(self.base_color) <= 1))

    @property
    def isotropic(self) -> bool:
        """Where there is no anisotropy."""
        return bool(np.asarray(self.anisotropy_strength) == 0)

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate each channel."""
        visible = are_visible(incoming, outgoing)
        incoming, outgoing = lifted(incoming), lifted(outgoing)
        metallic, ior, weight, coat = (
            matching(one, incoming.z)
            for one in (self.metallic, self.ior, self.specular, self.clearcoat)
        )
        lobe, cosine = self._facets(self.roughness, incoming, outgoing, self.anisotropy_strength)
        growth, head_on = schlick_growth(cosine), head_on_reflectance(ior)
        tints = [jnp.minimum(head_on * c, 1.0) for c in jnp.asarray(self.specular_color)]
        reflected = [weight * (f + (1 - f) * growth) for f in tints]
        left = 1 - jnp.max(jnp.stack(reflected), axis=0)
        share = coat * (_COAT_HEAD_ON + (1 - _COAT_HEAD_ON) * schlick_growth(outgoing.z))
        glaze = share * self._facets(self.clearcoat_roughness, incoming, outgoing).lobe
        found = []
        for color, fresnel in zip(jnp.asarray(self.base_color), reflected):
            dielectric = left * color * incoming.z / jnp.pi + fresnel * lobe
            metal = (color + (1 - color) * growth) * lobe
            whole = (1 - metallic) * dielectric + metallic * metal
            found.append(jnp.where(visible, (1 - share) * whole + glaze, 0))
        return tuple(found)

    def _facets(
        self,
        roughness: Scalar,
        incoming: Components,
        outgoing: Components,
        anisotropy: Scalar = 0.0,
    ) -> FacetTransfer:
        alpha = jnp.maximum(matching(roughness, incoming.z) ** 2, LEAST_ALPHA)
        along = alpha + (1 - alpha) * matching(anisotropy, incoming.z) ** 2
        facets = TrowbridgeReitz(along, alpha)
        sides = (in_tangent_frame(one, self.anisotropy_rotation) for one in (incoming, outgoing))
        return facet_transfer(facets, "smith-separate", *sides)
