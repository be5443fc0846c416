"""A Lambertian base under one lobe about the reflected direction: what T 6 recovers.

rho = kd + ks f(w_i, w_o; sigma, mu)

Reflection by such a lobe is a convolution (T 3.4), so that a fit has the frequency view of it: one
split of the light, one table over roughness and one transfer serve every model.
"""

import abc

import equinox as eqx
import jax.numpy as jnp

from jaxrender.brdf.half_vector import are_visible
from jaxrender.brdf.parametric import Parametric
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float


class Glossy(Parametric):
    """A parametric BRDF with the clamped cosine as its base and its lobe about R."""

    kd: eqx.AbstractVar[Float[AnyArray, "channel"]]
    ks: eqx.AbstractVar[Float[AnyArray, "channel"]]

    @property
    def has_frequency_view(self) -> bool:
        """Unless there are lobes or numbers beside those of T 6.2, which the tables do not know."""
        known = (self.shape.name, self.index.name)
        return self.amplitude_names == ("kd", "ks") and all(
            one.name in known for one in self.searched
        )

    @property
    @abc.abstractmethod
    def reach(self) -> Float[Array, ""] | None:
        """The angle from R (radians) beyond which the lobe is negligible; None: it has a tail."""

    @abc.abstractmethod
    def specular_transfer(
        self, incoming: Components, outgoing: Components
    ) -> Float[Array, "*batch"]:
        """Evaluate the lobe times cos t_i for directions above the horizon (below: meaningless)."""

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
        """Evaluate the clamped cosine, and the lobe times the clamped cosine."""
        visible = are_visible(incoming, outgoing)
        lobe = self.specular_transfer(incoming, outgoing)
        return jnp.where(visible, incoming.z, 0), jnp.where(visible, lobe, 0)
