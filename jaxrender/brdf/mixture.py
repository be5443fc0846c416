"""A weighted sum of BRDFs."""

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.parameters import refuse_other_channels, share_of_energy_is_bounded
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float


class Mixture(BRDF):
    """rho_c = sum_n weights[n, c] rho_nc: every lobe of every part, its amplitudes weighted.

    Raises ``ValueError`` when parts and weights differ in number, or in channels.
    """

    parts: tuple[BRDF, ...]
    weights: Float[AnyArray, "part channel"]

    def __check_init__(self):
        if len(self.parts) != self.weights.shape[0] or not self.parts:
            raise ValueError(
                f"parts={len(self.parts)} and weights={self.weights.shape[0]}: give at least one "
                "part, and one row of weights for each"
            )
        for part in self.parts:
            refuse_other_channels("weights", self.weights, part.amplitudes.shape[1])

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """The parts' amplitudes, weighted, one after the other."""
        pairs = zip(self.parts, jnp.asarray(self.weights), strict=True)
        return jnp.concatenate(
            [jnp.asarray(part.amplitudes) * weight[None, :] for part, weight in pairs]
        )

    @property
    def reciprocal(self) -> bool:
        """When all parts are."""
        return all(part.reciprocal for part in self.parts)

    @property
    def conserves_energy(self) -> bool:
        """When all parts do, and no channel's weights are negative or add up to more than 1."""
        conserving = all(part.conserves_energy for part in self.parts)
        return conserving and share_of_energy_is_bounded(*np.asarray(self.weights))

    @property
    def isotropic(self) -> bool:
        """When all parts are."""
        return all(part.isotropic for part in self.parts)

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate the parts' lobes, one after the other."""
        return tuple(lobe for part in self.parts for lobe in part.transfer(incoming, outgoing))
