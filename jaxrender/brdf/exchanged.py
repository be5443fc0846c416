"""A BRDF with its two directions exchanged: what a renderer sees that looks it up the other way."""

import jax.numpy as jnp

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.half_vector import are_visible, lifted
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float


class Exchanged(BRDF):
    """rho'(w_i, w_o) = rho(w_o, w_i)."""

    brdf: BRDF

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """The BRDF's own."""
        return self.brdf.amplitudes

    @property
    def reciprocal(self) -> bool:
        """When the BRDF is."""
        return self.brdf.reciprocal

    @property
    def conserves_energy(self) -> bool:
        """When the BRDF does and is reciprocal; else nothing is promised."""
        return self.brdf.reciprocal and self.brdf.conserves_energy

    @property
    def isotropic(self) -> bool:
        """When the BRDF is."""
        return self.brdf.isotropic

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate each lobe of the exchanged pair, times cos t_i / cos t_o."""
        visible = are_visible(incoming, outgoing)
        incoming, outgoing = lifted(incoming), lifted(outgoing)
        factor = incoming.z / outgoing.z
        return tuple(
            jnp.where(visible, lobe * factor, 0) for lobe in self.brdf.transfer(outgoing, incoming)
        )
