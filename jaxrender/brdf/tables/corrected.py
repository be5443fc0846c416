"""A BRDF times a table: what measurements change about a model.

    rho_c(w_i, w_o) = rho_model,c(w_i, w_o) F_c(t_h, t_d, p_d),    F > 0

F is linear between the nodes of an ``IsotropicTable``.  It is a number without a unit, about 1
where the model is right.  The model keeps what a table cannot hold, such as the peak of a narrow
highlight; and where nothing was measured, the model is what there is.
"""

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.measured import MeasuredAlbedo
from jaxrender.brdf.parameters import is_known, refuse_other_channels
from jaxrender.brdf.tables.isotropic import corners, half_difference
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float


class CorrectedBRDF(MeasuredAlbedo):
    """``model`` times ``factor`` at the nodes of a grid [theta_h, theta_d, phi_d, channel].

    Raises ``ValueError`` for a factor of another rank, of other channels than the model's, with
    fewer than two nodes of either polar angle, and that is not positive and finite.
    """

    model: BRDF
    factor: Float[AnyArray, "theta_h theta_d phi_d channel"]

    def __check_init__(self):
        shape = np.shape(self.factor)
        if len(shape) != 4 or min(shape[:2]) < 2 or min(shape) < 1:
            raise ValueError(
                f"factor has shape {shape}: give [theta_h, theta_d, phi_d, channel] with at least "
                "2 nodes of theta_h and of theta_d"
            )
        refuse_other_channels("factor", self.factor, self.model.amplitudes.shape[1])
        if is_known(self.factor) and not np.all(_is_positive(np.asarray(self.factor))):
            count = int(np.sum(~_is_positive(np.asarray(self.factor))))
            raise ValueError(
                f"{count} values of factor are not positive and finite; 1 is the model"
            )

    @property
    def nodes(self) -> tuple[int, int, int]:
        """The numbers of nodes of theta_h, theta_d and phi_d."""
        half, difference, azimuth, _ = np.shape(self.factor)
        return half, difference, azimuth

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """One: every channel has a lobe of its own."""
        return np.eye(self.factor.shape[-1])

    @property
    def reciprocal(self) -> bool:
        """When the model is: both orders of a pair have one factor."""
        return self.model.reciprocal

    @property
    def isotropic(self) -> bool:
        """When the model is."""
        return self.model.isotropic

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate the model's channels times cos t_i, and each times its factor."""
        lobes = jnp.stack(self.model.transfer(incoming, outgoing), axis=-1)
        amounts = jnp.asarray(self.model.amplitudes, lobes.dtype)
        values = jnp.einsum("...k,kc->...c", lobes, amounts, precision="highest")
        rows = jnp.asarray(self.factor, lobes.dtype).reshape(-1, self.factor.shape[-1])
        parts = [
            corner.weight[..., None].astype(lobes.dtype) * rows[corner.index]
            for corner in corners(self.nodes, half_difference(incoming, outgoing))
        ]
        corrected = values * sum(parts[1:], parts[0])
        return tuple(corrected[..., c] for c in range(corrected.shape[-1]))


def _is_positive(factor: np.ndarray) -> np.ndarray:
    return np.isfinite(factor) & (factor > 0)
