"""Kajiya and Kay's model of 1989 for a surface of fibres that run along the tangent +X.

rho cos t_i = kd sin(T, w_i) + ks max(sin(T, w_i) sin(T, w_o) - (T . w_i) (T . w_o), 0)^s

The lobe is cos^s of the distance from the cone into which a thin cylinder reflects,
T . w_o = -T . w_i.  T 5.3.1 and T 5.7.1 write cos^s(t_i - t_o) of the angles to the tangent, which
is this lobe when one of them is measured from the other end of T; with both directions pointing
away from the surface and one T it would reflect light back towards its source.

As in the paper, and for the thesis, the expression is the transfer function: light on a fibre is
not foreshortened by the normal.  Both lobes have their peak at 1 and are cut at the horizon.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.half_vector import are_visible, power_of_cosine
from jaxrender.brdf.parameters import Scalar, as_scalar, matching, refuse_outside
from jaxrender.brdf.parametric import ByOwnNumber, ShapeParameter
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float


class KajiyaKay(ByOwnNumber):
    """Fibres with a diffuse and a specular part, kd and ks in 1/sr, ``exponent`` s >= 0."""

    # cos^s t is about exp(-s t^2 / 2).
    shape: ClassVar[ShapeParameter] = ShapeParameter("exponent", 2.0, -2.0)

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    exponent: Scalar = eqx.field(converter=as_scalar)

    def __check_init__(self):
        refuse_outside("exponent", self.exponent, "[0, inf)", "larger is narrower, 32 is glossy")

    @property
    def reciprocal(self) -> bool:
        """Only black fibres: both lobes lack the cosine that would make the BRDF symmetric."""
        return not (np.any(self.kd) or np.any(self.ks))

    @property
    def conserves_energy(self) -> bool:
        """Only black fibres: from grazing directions the BRDF has no bound."""
        return self.reciprocal

    @property
    def isotropic(self) -> bool:
        """Only black fibres."""
        return self.reciprocal

    @property
    def energy(self) -> Scalar:
        """The lobe's integral at normal exitance, pi int cos^(s + 1), to 2 % from s = 1 on."""
        return np.pi * (2 * np.pi / (jnp.asarray(self.exponent) + 1.5)) ** 0.5

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
        """Evaluate the sine to the tangent and the power of the cone's cosine."""
        visible = are_visible(incoming, outgoing)
        sine_in, sine_out = _sine_to_tangent(incoming), _sine_to_tangent(outgoing)
        # 1 - (sin sin' - x x') of unit directions, with all its digits near the cone.
        versine = ((sine_in - sine_out) ** 2 + (incoming.x + outgoing.x) ** 2) / 2
        lobe = power_of_cosine(versine, matching(self.exponent, versine))
        return jnp.where(visible, sine_in, 0), jnp.where(visible, lobe, 0)


def _sine_to_tangent(direction: Components) -> Float[Array, "*batch"]:
    squared = jnp.asarray(direction.y * direction.y + direction.z * direction.z)
    # The floor keeps the derivative finite along the tangent itself.
    return jnp.sqrt(jnp.maximum(squared, float(jnp.finfo(squared.dtype).eps) ** 2))
