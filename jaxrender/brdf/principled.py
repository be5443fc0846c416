"""Disney's principled material (Burley 2012), the part of it that reflects without tints.

With S the GGX lobe of alpha = roughness^2, separate masking and shadowing, P = (1 - w_i . h)^5, and
F the Fresnel reflectance of a dielectric of index 2 / (1 - sqrt(.08 specular)) - 1:

rho = (1 - metallic) (base_color B / pi + sheen P + F S)
      + metallic (base_color + (1 - base_color) P) S + clearcoat C / 4

B is Burley's diffuse curve, C a lobe of GTR1, whose tail is longer than that of GGX, with the
reflectance of index 1.5.  ``sheen`` and ``clearcoat`` are amounts, and a fit solves for them.
The parts know nothing of one another: a bright base reflects more than arrives.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.burley import burley_diffuse
from jaxrender.brdf.distributions import TrowbridgeReitz
from jaxrender.brdf.facets import facet_transfer
from jaxrender.brdf.fresnel import fresnel, head_on_reflectance, schlick_growth
from jaxrender.brdf.half_vector import are_visible, half_vector, lifted
from jaxrender.brdf.layered import Layered, roughness, shape_of, share
from jaxrender.brdf.masking import separate_smith_masking
from jaxrender.brdf.parameters import Scalar, as_scalar, matching, share_of_energy_is_bounded
from jaxrender.brdf.parametric import Searched, ShapeParameter
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float

# The clear coat's roughness at gloss 0 and 1, that of its masking, and its reflectance head-on.
_COAT_DULL, _COAT_GLOSSY, _COAT_MASKING, _COAT_HEAD_ON = 0.1, 0.001, 0.25, 0.04
# An index has to be above one; a surface of ``specular`` 0 has no interface.
_LEAST_SPECULAR = 0.001


class Principled(Layered):
    """Disney's ``base_color``, ``metallic``, ``roughness``, ``specular`` and what lies on top.

    ``sheen`` and ``clearcoat`` are the same in every channel, unless a fit is told otherwise.

    Raises, outside traced functions, ``ValueError`` for numbers outside the catalogue's intervals.
    """

    model: ClassVar[str] = "principled"
    shape: ClassVar[ShapeParameter] = shape_of("roughness")
    amplitude_names: ClassVar[tuple[str, ...]] = ("base_color", "interface", "sheen", "clearcoat")

    base_color: Float[AnyArray, "channel"]
    interface: Float[AnyArray, "channel"]
    sheen: Float[AnyArray, "channel"]
    clearcoat: Float[AnyArray, "channel"]
    metallic: Scalar = eqx.field(converter=as_scalar)
    roughness: Scalar = eqx.field(converter=as_scalar)
    specular: Scalar = eqx.field(converter=as_scalar, default=0.5)
    clearcoat_gloss: Scalar = eqx.field(converter=as_scalar, default=1.0)

    def __check_init__(self):
        self._check_numbers()

    @property
    def ior(self) -> Scalar:
        """The index that ``specular`` stands for: 1.5 of .5."""
        root = jnp.sqrt(0.08 * jnp.maximum(jnp.asarray(self.specular), _LEAST_SPECULAR))
        return 2 / (1 - root) - 1

    @property
    def head_on(self) -> Scalar:
        """.08 times ``specular``."""
        return head_on_reflectance(self.ior)

    @property
    def searched(self) -> tuple[Searched, ...]:
        """The roughness, the metallic share, ``specular`` and the clear coat's gloss."""
        return (
            roughness("roughness"),
            share("metallic"),
            share("specular", 0.5),
            share("clearcoat_gloss", 0.5),
        )

    @property
    def conserves_energy(self) -> bool:
        """Of a metal without sheen and coat."""
        bare = not (np.any(self.sheen) or np.any(self.clearcoat))
        metal = bool(np.asarray(self.metallic) == 1)
        return bare and metal and share_of_energy_is_bounded(self.base_color, self.interface * 0)

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate what the base colour colours, what it does not, the sheen and the coat."""
        visible = are_visible(incoming, outgoing)
        incoming, outgoing = lifted(incoming), lifted(outgoing)
        r, metal, ior = (
            matching(one, incoming.z) for one in (self.roughness, self.metallic, self.ior)
        )
        facets = TrowbridgeReitz(r**2)
        lobe, cosine = facet_transfer(facets, "smith-separate", incoming, outgoing)
        growth = schlick_growth(cosine)
        diffuse = burley_diffuse(r, incoming, outgoing, cosine) / jnp.pi
        base = (1 - metal) * diffuse + metal * (1 - growth) * lobe
        clear = ((1 - metal) * fresnel(ior, cosine) + metal * growth) * lobe
        sheen = (1 - metal) * growth * incoming.z
        lobes = base, clear, sheen, self._coat(incoming, outgoing, growth)
        return tuple(jnp.where(visible, one, 0) for one in lobes)

    def _coat(
        self, incoming: Components, outgoing: Components, growth: Float[Array, "*batch"]
    ) -> Float[Array, "*batch"]:
        gloss = matching(self.clearcoat_gloss, growth)
        alpha = _COAT_DULL + (_COAT_GLOSSY - _COAT_DULL) * gloss
        square = alpha**2
        half = half_vector(incoming, outgoing).direction
        # The squared sine by itself: one less the squared cosine has no digits left.
        steepness = half.x * half.x + half.y * half.y + square * half.z * half.z
        density = (square - 1) / (jnp.pi * jnp.log(square) * steepness)
        masking = separate_smith_masking(TrowbridgeReitz(_COAT_MASKING), incoming, outgoing)
        reflectance = _COAT_HEAD_ON + (1 - _COAT_HEAD_ON) * growth
        return density * masking * reflectance / (4 * outgoing.z) / 4
