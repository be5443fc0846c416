"""What Blender's Cycles makes of a Principled BSDF with the numbers of glTF's material.

With S the GGX lobe of alpha = roughness^2, here with joint masking, c = base_color, m = metallic,
F_D the dielectric's Fresnel reflectance of ior, F_0 its value head-on, s = (F_D - F_0) / (1 - F_0),
and f_0 = F_0 specular_color in each channel:

    rho_d = c / pi (1 - max E(w_o)) + (f_0 + (1 - f_0) s) S,  E = f_0 + (1 - f_0) E_s / E_1,
    rho_m = (c + (1 - c) (1 - w_i . h)^5) S, darker at 82 degrees by specular_color,

rho = (1 - m) rho_d + m rho_m, E_s and E_1 what a lobe reflects of s and of 1.  A coat of weight k
leaves 1 - k F_coat(w_o).  Blender 5.0, distribution GGX; the default adds light that facets hand
on to one another.  The base knows the viewer's direction alone, so that it is not reciprocal.
"""

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF, TrowbridgeReitz, fresnel, head_on_reflectance
from jaxrender.brdf.facets import FacetTransfer, facet_transfer
from jaxrender.brdf.fresnel import EDGE_COSINE, edge_darkening, schlick_growth
from jaxrender.brdf.half_vector import are_visible, lifted
from jaxrender.brdf.layer_albedo import interface_albedo
from jaxrender.brdf.parameters import Scalar, matching
from jaxrender.brdf.tangents import in_tangent_frame
from jaxrender.geometry import Components
from jaxrender.io.exports.gltf_material import LEAST_ALPHA, GltfMaterial
from jaxrender.shapes import AnyArray, Array, Float

_COAT_INDEX = 1.5
# Albedos of interfaces are known up to this index.
_HIGHEST_INDEX = 6.0


class BlenderMaterial(BRDF):
    """The BRDF of a Principled BSDF that ``numbers`` were given to."""

    numbers: GltfMaterial

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """One: every channel has a lobe of its own."""
        return np.eye(3)

    @property
    def reciprocal(self) -> bool:
        """Of a bare metal alone."""
        metal = bool(np.asarray(self.numbers.metallic) == 1)
        return metal and self.numbers.reciprocal

    @property
    def conserves_energy(self) -> bool:
        """When no base colour is above one."""
        return bool(np.all(np.asarray(self.numbers.base_color) <= 1))

    @property
    def isotropic(self) -> bool:
        """When the numbers are."""
        return self.numbers.isotropic

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate each channel."""
        visible, own = are_visible(incoming, outgoing), self.numbers
        incoming, outgoing = lifted(incoming), lifted(outgoing)
        metallic, ior, coat = (
            matching(one, incoming.z) for one in (own.metallic, own.ior, own.clearcoat)
        )
        lobe, cosine = self._base_facets(incoming, outgoing)
        head_on = head_on_reflectance(ior)
        tints = [jnp.minimum(head_on * c, 1.0) for c in jnp.asarray(own.specular_color)]
        grown = (fresnel(ior, cosine) - head_on) / (1 - head_on)
        share = self._mean_growth(outgoing)
        left = 1 - jnp.max(jnp.stack([f + (1 - f) * share for f in tints]), axis=0)
        glaze = coat * self._coat_lobe(incoming, outgoing)
        below = 1 - coat * fresnel(_COAT_INDEX, outgoing.z)
        edge = edge_darkening(cosine)
        found = []
        for color, tint, f in zip(
            jnp.asarray(own.base_color), jnp.asarray(own.specular_color), tints
        ):
            dielectric = left * color * incoming.z / jnp.pi + (f + (1 - f) * grown) * lobe
            there = color + (1 - color) * (1 - EDGE_COSINE) ** 5
            reflected = color + (1 - color) * schlick_growth(cosine)
            darker = (1 - jnp.minimum(tint, 1)) * there * edge
            metal = (reflected - darker) * lobe
            whole = (1 - metallic) * dielectric + metallic * metal
            found.append(jnp.where(visible, below * whole + glaze, 0))
        return tuple(found)

    def _base_facets(self, incoming: Components, outgoing: Components) -> FacetTransfer:
        own = self.numbers
        across = self._alpha(own.roughness, incoming)
        along = across + (1 - across) * matching(own.anisotropy_strength, incoming.z) ** 2
        sides = (in_tangent_frame(one, own.anisotropy_rotation) for one in (incoming, outgoing))
        return facet_transfer(TrowbridgeReitz(along, across), "smith", *sides)

    def _coat_lobe(self, incoming: Components, outgoing: Components) -> Float[Array, "*batch"]:
        facets = TrowbridgeReitz(self._alpha(self.numbers.clearcoat_roughness, incoming))
        lobe, cosine = facet_transfer(facets, "smith", incoming, outgoing)
        return lobe * fresnel(_COAT_INDEX, cosine)

    def _mean_growth(self, outgoing: Components) -> Float[Array, "*batch"]:
        """Evaluate E_s / E_1: how far the reflectance has grown in the mean over the lobe."""
        own = self.numbers
        across = matching(own.roughness, outgoing.z) ** 2
        along = across + (1 - across) * matching(own.anisotropy_strength, outgoing.z) ** 2
        roughness = jnp.sqrt(jnp.sqrt(jnp.maximum(along * across, LEAST_ALPHA**2)))
        index = jnp.minimum(matching(own.ior, outgoing.z), _HIGHEST_INDEX)
        head_on = head_on_reflectance(index)
        mean = interface_albedo(roughness, index, outgoing.z)
        mean = mean / interface_albedo(roughness, None, outgoing.z)
        return jnp.clip((mean - head_on) / jnp.maximum(1 - head_on, LEAST_ALPHA), 0, 1)

    def _alpha(self, roughness: Scalar, like: Components) -> Float[Array, "*batch"]:
        return jnp.maximum(matching(roughness, like.z) ** 2, LEAST_ALPHA)
