"""A BRDF in other channels: each a weighted sum of its own.

A single channel that serves all colours has weights of one.  Wavelengths become linear RGB by
``imaging.colour.rgb_weights``.
"""

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.parameters import share_of_energy_is_bounded
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float


class Recoloured(BRDF):
    """rho'_c = sum_k weights[k, c] rho_k.

    Raises ``ValueError`` for weights of another number of channels than the BRDF has.
    """

    brdf: BRDF
    weights: Float[AnyArray, "own channel"]

    def __check_init__(self):
        own = self.brdf.amplitudes.shape[1]
        if self.weights.shape[0] != own:
            raise ValueError(
                f"weights of {self.weights.shape[0]} channels for a BRDF of {own}; give a row of "
                "weights for each of its channels"
            )

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """The BRDF's own, weighted."""
        own, weights = self.brdf.amplitudes, self.weights
        if isinstance(own, np.ndarray) and isinstance(weights, np.ndarray):
            return own @ weights
        return jnp.matmul(jnp.asarray(own), jnp.asarray(weights), precision="highest")

    @property
    def reciprocal(self) -> bool:
        """When the BRDF is."""
        return self.brdf.reciprocal

    @property
    def conserves_energy(self) -> bool:
        """When the BRDF does, and no channel's weights are negative or add up to more than 1."""
        return self.brdf.conserves_energy and share_of_energy_is_bounded(*np.asarray(self.weights))

    @property
    def isotropic(self) -> bool:
        """When the BRDF is."""
        return self.brdf.isotropic

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate the BRDF's own lobes."""
        return self.brdf.transfer(incoming, outgoing)
