"""What a BRDF is to the rest of the house: lobes times amplitudes.

A BRDF is a linear combination rho_c(w_i, w_o) = sum_k amplitude[k, c] f_k(w_i, w_o) of lobes f_k
that carry no colour; a fit eliminates the amplitudes and searches the lobes' own parameters.  The
theory never needs rho alone but the *transfer function* rho~ = rho cos t_i, which is zero below
the horizon (T 2.12), so that is the one method a new material writes.

Directions are unit vectors in the surface's own frame: +Z is the normal; both point away from the
surface.  rho is in 1/sr.

Each model states what it promises for the parameters it has: ``reciprocal``, ``conserves_energy``
and ``isotropic``.  ``False`` is the absence of the promise; ``properties`` has the numeric checks.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Directions, Float, checked


class BRDF(eqx.Module):
    """Reflectance as amplitudes times lobes."""

    @property
    @abc.abstractmethod
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """How much of each lobe each colour channel has."""

    @property
    @abc.abstractmethod
    def reciprocal(self) -> bool:
        """Whether rho(w_i, w_o) = rho(w_o, w_i)."""

    @property
    @abc.abstractmethod
    def conserves_energy(self) -> bool:
        """Whether no more leaves than arrives, int rho cos t_o dw_o <= 1 from every direction.

        Depends on the parameters' values, so it can only be asked outside traced functions.
        """

    @property
    @abc.abstractmethod
    def isotropic(self) -> bool:
        """Whether turning both directions about the normal changes nothing."""

    @abc.abstractmethod
    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate each lobe times cos t_i, zero where either direction is below the horizon."""

    @checked
    def evaluate(
        self, incoming: Directions, outgoing: Directions
    ) -> Float[Array, "*batch channel"]:
        """Evaluate the BRDF in 1/sr; zero below the horizon."""
        directions = Components.of(incoming)
        lobes = jnp.stack(self.transfer(directions, Components.of(outgoing)), axis=-1)
        cosine = jnp.asarray(directions.z)[..., None]
        lobes = jnp.where(cosine > 0, lobes / jnp.where(cosine > 0, cosine, 1), 0)
        amplitudes = self.amplitudes
        if _one_lobe_a_channel(amplitudes):
            return lobes
        return jnp.einsum(
            "...k,kc->...c", lobes, jnp.asarray(amplitudes, lobes.dtype), precision="highest"
        )


def _one_lobe_a_channel(amplitudes: Float[AnyArray, "lobe channel"]) -> bool:
    """Whether a product with them changes nothing, as for all that is known by its values."""
    if not isinstance(amplitudes, np.ndarray) or amplitudes.shape[0] != amplitudes.shape[1]:
        return False
    return np.array_equal(amplitudes, np.eye(len(amplitudes)))
