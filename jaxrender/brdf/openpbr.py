"""OpenPBR's opaque surface (version 1.1): a base, diffuse or metal, under a coat, under a fuzz.

With S the GGX lobe of the base, E its albedo under the Fresnel reflectance F of ``specular_ior``,
Ē the mean of E, P = (1 - w_i . h)^5, and m the metalness:

dielectric = F S + base_color / pi (1 - E(w_i)) (1 - E(w_o)) / (1 - Ē)
metal      = (base_color + (1 - base_color) P) S, darker at 82 degrees by ``specular_color``
base       = (1 - m) dielectric + m metal
coated     = w_c F_c S_c + (1 - w_c + w_c T(w_i) T(w_o)) base
rho        = w_f sheen + (1 - w_f E_f(w_i)) (1 - w_f E_f(w_o)) coated

T is what a coat lets through and does not absorb.  All layers are joined so that w_i and w_o may
change places.  The specification leaves the way open and sketches one in which they may not; under
even light from everywhere the two are the same.  Lambert's is the diffuse base, a coat absorbs all
colours alike, it does not make the base rougher, and the fuzz is ``sheen``.  Transmission,
subsurface scattering and thin films are left out.

``multiple_scattering="facets"`` adds what facets hand on to one another (Kulla and Conty 2017), a
metal's tinted once.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.distributions import TrowbridgeReitz
from jaxrender.brdf.fresnel import (
    EDGE_COSINE,
    edge_darkening,
    fresnel,
    head_on_reflectance,
    schlick_growth,
)
from jaxrender.brdf.half_vector import are_visible, half_vector, lifted
from jaxrender.brdf.layer_albedo import (
    interface_albedo,
    mean_interface_albedo,
    sheen_albedo,
)
from jaxrender.brdf.layered import Layered, index, roughness, shape_of, share
from jaxrender.brdf.masking import smith_facet_masking
from jaxrender.brdf.parameters import (
    Scalar,
    as_scalar,
    matching,
    refuse_unlisted,
    share_of_energy_is_bounded,
)
from jaxrender.brdf.parametric import Searched, ShapeParameter
from jaxrender.brdf.sheen import SMOOTHEST_SHEEN, sheen
from jaxrender.brdf.tangents import TANGENT_ROTATION, in_tangent_frame
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float

MULTIPLE_SCATTERING = ("none", "facets")
# The mean over a hemisphere of Schlick's growth.
_MEAN_GROWTH = 1 / 21


class OpenPBR(Layered):
    """OpenPBR's numbers by their own names; weights of base and specular are 1.

    ``tangent_rotation`` [radians] turns the tangent, along which an anisotropic lobe is widest,
    about the normal.

    Raises, outside traced functions, ``ValueError`` for numbers outside the catalogue's intervals.
    """

    model: ClassVar[str] = "openpbr"
    metalness: ClassVar[str] = "base_metalness"
    shape: ClassVar[ShapeParameter] = shape_of("specular_roughness")

    base_color: Float[AnyArray, "channel"]
    interface: Float[AnyArray, "channel"]
    base_metalness: Scalar = eqx.field(converter=as_scalar)
    specular_roughness: Scalar = eqx.field(converter=as_scalar)
    specular_ior: Scalar = eqx.field(converter=as_scalar, default=1.5)
    specular_color: Scalar = eqx.field(converter=as_scalar, default=1.0)
    specular_roughness_anisotropy: Scalar = eqx.field(converter=as_scalar, default=0.0)
    tangent_rotation: Scalar = eqx.field(converter=as_scalar, default=0.0)
    coat_weight: Scalar = eqx.field(converter=as_scalar, default=0.0)
    coat_color: Scalar = eqx.field(converter=as_scalar, default=1.0)
    coat_roughness: Scalar = eqx.field(converter=as_scalar, default=0.1)
    coat_ior: Scalar = eqx.field(converter=as_scalar, default=1.6)
    fuzz_weight: Scalar = eqx.field(converter=as_scalar, default=0.0)
    fuzz_roughness: Scalar = eqx.field(converter=as_scalar, default=0.5)
    multiple_scattering: str = eqx.field(static=True, default="none")

    def __check_init__(self):
        refuse_unlisted("multiple_scattering", self.multiple_scattering, MULTIPLE_SCATTERING)
        self._check_numbers()

    @property
    def head_on(self) -> Scalar:
        """The reflectance of ``specular_ior``."""
        return head_on_reflectance(self.specular_ior)

    @property
    def searched(self) -> tuple[Searched, ...]:
        """All numbers; most are settled unless somebody frees them."""
        return (
            roughness("specular_roughness"),
            share("base_metalness"),
            index("specular_ior", 1.5),
            share("specular_color", 0.7),
            share("specular_roughness_anisotropy"),
            TANGENT_ROTATION,
            share("coat_weight", 0.5),
            share("coat_color", 0.7),
            roughness("coat_roughness", 0.15),
            index("coat_ior", 1.6),
            share("fuzz_weight", 0.2),
            roughness("fuzz_roughness", 0.5, SMOOTHEST_SHEEN),
        )

    @property
    def isotropic(self) -> bool:
        """Where there is no anisotropy."""
        return bool(np.asarray(self.specular_roughness_anisotropy) == 0)

    @property
    def conserves_energy(self) -> bool:
        """While no colour is above one, nor the interface brighter than it can be."""
        return share_of_energy_is_bounded(self.base_color) and share_of_energy_is_bounded(
            self.interface
        )

    @property
    def width(self) -> Scalar:
        """The narrowest of the base's two widths and, where there is a coat, its own."""
        across = self._widths(jnp.asarray(self.specular_roughness))[1]
        coat = jnp.where(jnp.asarray(self.coat_weight) > 0, self.coat_roughness**2, 1.0)
        return jnp.minimum(across, coat)

    @property
    def widths(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """The base's widths along and across the tangent."""
        return self._widths(jnp.asarray(self.specular_roughness))

    def _widths(self, like: Float[AnyArray, "..."]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """The widths along and across the tangent, as the specification has them."""
        r = matching(self.specular_roughness, like)
        ratio = 1 - matching(self.specular_roughness_anisotropy, like)
        along = r**2 * jnp.sqrt(2 / (1 + ratio**2))
        return jnp.minimum(along, 1), jnp.minimum(along, 1) * jnp.maximum(ratio, 1e-3)

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate what the base colour colours, and what it does not."""
        visible = are_visible(incoming, outgoing)
        incoming, outgoing = lifted(incoming), lifted(outgoing)
        base, clear = self._base(incoming, outgoing)
        coat, below = self._coat(incoming, outgoing)
        fuzz, under = self._fuzz(incoming, outgoing)
        base, clear = below * base, below * clear + coat
        return jnp.where(visible, under * base, 0), jnp.where(visible, under * clear + fuzz, 0)

    def _base(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
        """Evaluate the base's parts in its colour and in white."""
        half = half_vector(incoming, outgoing)
        cosine = jnp.minimum(half.cosine, 1)
        metal, ior, tint = (
            matching(one, cosine)
            for one in (self.base_metalness, self.specular_ior, self.specular_color)
        )
        facets = TrowbridgeReitz(*self._widths(cosine))
        turned = [
            in_tangent_frame(one, self.tangent_rotation)
            for one in (half.direction, incoming, outgoing)
        ]
        lobe = facets.density(turned[0]) / (4 * outgoing.z)
        lobe = lobe * smith_facet_masking(facets, *turned[1:])
        growth = schlick_growth(cosine)
        darker = (1 - tint) * edge_darkening(cosine)
        grown_there = (1 - EDGE_COSINE) ** 5
        base = metal * lobe * (1 - growth - darker * (1 - grown_there))
        white = metal * lobe * (growth - darker * grown_there)
        white = white + (1 - metal) * lobe * fresnel(ior, cosine)
        r = matching(self.specular_roughness, cosine)
        lost = [1 - interface_albedo(r, ior, side.z) for side in (incoming, outgoing)]
        mean = 1 - mean_interface_albedo(r, ior, cosine)
        if self.multiple_scattering == "facets":
            handed = [1 - interface_albedo(r, None, side.z) for side in (incoming, outgoing)]
            mean_handed = 1 - mean_interface_albedo(r, None, cosine)
            more = handed[0] * handed[1] * incoming.z / (jnp.pi * mean_handed)
            # Of what facets hand on this part leaves in the end, after one bounce or many.
            once = 1 - mean
            again = once / (1 - mean_handed)
            kept = again**2 * (1 - mean_handed) / (1 - again * mean_handed)
            base = base + metal * more * (1 - _MEAN_GROWTH)
            white = white + more * (metal * _MEAN_GROWTH + (1 - metal) * kept)
            lost = [one - kept * two for one, two in zip(lost, handed)]
            mean = mean - kept * mean_handed
        diffuse = lost[0] * lost[1] / mean * incoming.z / jnp.pi
        return base + (1 - metal) * diffuse, white

    def _coat(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
        """Evaluate what a coat reflects, and what it leaves of the base."""
        half = half_vector(incoming, outgoing)
        cosine = jnp.minimum(half.cosine, 1)
        weight, r, ior, color = (
            matching(one, cosine)
            for one in (self.coat_weight, self.coat_roughness, self.coat_ior, self.coat_color)
        )
        facets = TrowbridgeReitz(r**2)
        lobe = facets.density(half.direction) / (4 * outgoing.z)
        lobe = lobe * smith_facet_masking(facets, incoming, outgoing) * fresnel(ior, cosine)

        def passed(side: Components) -> Float[Array, "*batch"]:
            """Evaluate T: refracted, light goes a longer way than along the normal."""
            inside = jnp.sqrt(1 - (1 - side.z**2) / ior**2)
            return (1 - interface_albedo(r, ior, side.z)) * color ** (1 / (2 * inside))

        return weight * lobe, 1 - weight + weight * passed(incoming) * passed(outgoing)

    def _fuzz(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
        """Evaluate what the fuzz reflects, and what it leaves of all below."""
        like = jnp.asarray(incoming.z)
        weight, r = matching(self.fuzz_weight, like), matching(self.fuzz_roughness, like)
        left = [1 - weight * sheen_albedo(r, side.z) for side in (incoming, outgoing)]
        return weight * sheen(r, incoming, outgoing), left[0] * left[1]
