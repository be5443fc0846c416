"""The material of glTF 2.0 (appendix B), as nearly every viewer and game engine has it.

With S the GGX lobe of alpha = roughness^2, separate masking and shadowing, P = (1 - w_i . h)^5 and
F = F_0 + (1 - F_0) P, F_0 = ((ior - 1) / (ior + 1))^2:

rho = (1 - metallic) ((1 - F) base_color / pi + F S) + metallic (base_color + (1 - base_color) P) S

The base under a dielectric does not know that the interface took light away at w_i and w_o, but
only at the half vector: at grazing angles more leaves than arrives.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.distributions import TrowbridgeReitz
from jaxrender.brdf.facets import facet_transfer
from jaxrender.brdf.fresnel import head_on_reflectance, schlick_growth
from jaxrender.brdf.half_vector import are_visible, lifted
from jaxrender.brdf.layered import Layered, index, roughness, shape_of, share
from jaxrender.brdf.parameters import Scalar, as_scalar, matching, share_of_energy_is_bounded
from jaxrender.brdf.parametric import Searched, ShapeParameter
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float


class MetallicRoughness(Layered):
    """glTF's ``base_color``, ``metallic`` and ``roughness``; ``ior`` is KHR_materials_ior's.

    Raises, outside traced functions, ``ValueError`` for numbers outside the catalogue's intervals.
    """

    model: ClassVar[str] = "metallic-roughness"
    shape: ClassVar[ShapeParameter] = shape_of("roughness")

    base_color: Float[AnyArray, "channel"]
    interface: Float[AnyArray, "channel"]
    metallic: Scalar = eqx.field(converter=as_scalar)
    roughness: Scalar = eqx.field(converter=as_scalar)
    ior: Scalar = eqx.field(converter=as_scalar, default=1.5)

    def __check_init__(self):
        self._check_numbers()

    @property
    def head_on(self) -> Scalar:
        """F_0 of the index."""
        return head_on_reflectance(self.ior)

    @property
    def searched(self) -> tuple[Searched, ...]:
        """The roughness, the metallic share and the index."""
        return roughness("roughness"), share("metallic"), index("ior", 1.5)

    @property
    def conserves_energy(self) -> bool:
        """Of a metal alone."""
        metal = bool(np.asarray(self.metallic) == 1)
        return metal and share_of_energy_is_bounded(self.base_color, self.interface * 0)

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate what the base colour colours, and what it does not."""
        visible = are_visible(incoming, outgoing)
        incoming, outgoing = lifted(incoming), lifted(outgoing)
        r, metal, ior = (
            matching(one, incoming.z) for one in (self.roughness, self.metallic, self.ior)
        )
        facets = TrowbridgeReitz(r**2)
        lobe, cosine = facet_transfer(facets, "smith-separate", incoming, outgoing)
        growth = schlick_growth(cosine)
        diffuse = (1 - growth) * incoming.z / jnp.pi
        base, clear = mixed(metal, ior, diffuse, (1 - growth) * lobe, growth * lobe)
        return jnp.where(visible, base, 0), jnp.where(visible, clear, 0)


def mixed(
    metallic: Float[AnyArray, "*#batch"] | float,
    ior: Scalar,
    diffuse: Float[Array, "*batch"],
    lobe: Float[Array, "*batch"],
    edge: Float[Array, "*batch"],
) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
    """Put together what the base colour colours, and what it does not, from three parts.

    ``diffuse`` is (1 - P) / pi, ``lobe`` (1 - P) S and ``edge`` P S, or integrals of these, of
    which only S knows the roughness.  All is linear in them, in the share and in F_0.
    """
    head_on = head_on_reflectance(ior)
    base = (1 - metallic) * (1 - head_on) * diffuse + metallic * lobe
    clear = (1 - metallic) * head_on * lobe + edge
    return jnp.asarray(base), jnp.asarray(clear)
