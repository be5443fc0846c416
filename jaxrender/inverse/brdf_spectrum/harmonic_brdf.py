"""Recovered coefficients as a BRDF like any other, for rendering by the integral.

A truncated series may ring and be negative (T figure 6.2).
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.geometry import Components
from jaxrender.harmonics import coefficient_count, real_basis
from jaxrender.inverse.brdf_spectrum.recovery import BRDFSpectrum
from jaxrender.shapes import AnyArray, Array, Float

_SMALLEST_COSINE = 1e-6


class HarmonicBRDF(BRDF):
    """rho cos t_i = sum_lpq rho_lpq y_lpq, over cos t_o in the reciprocal form (T 2.53, 2.58).

    ``coupling`` pairs the flat real harmonics of the two directions; a lobe for each channel.
    """

    coupling: Float[AnyArray, "channel incoming_coefficient outgoing_coefficient"]
    in_reciprocal_form: bool = eqx.field(static=True)
    band_limit: int = eqx.field(static=True)

    @classmethod
    def of(cls, spectrum: BRDFSpectrum) -> "HarmonicBRDF":
        """Take recovered coefficients."""
        table = spectrum.coefficients
        limit = spectrum.basis.band_limit
        count = coefficient_count(limit)
        coupling = np.zeros((table.shape[3], count, count))
        for degree, outgoing in np.ndindex(limit + 1, limit + 1):
            shared = min(degree, outgoing)
            order = np.arange(-shared, shared + 1)
            first, second = degree * (degree + 1) + order, outgoing * (outgoing + 1) + order
            coupling[:, first, second] = table[degree, outgoing, np.abs(order)].T
        return cls(coupling, spectrum.basis.reciprocal, limit)

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """One lobe for each channel."""
        return np.eye(self.coupling.shape[0])

    @property
    def reciprocal(self) -> bool:
        """Where it was imposed."""
        return self.in_reciprocal_form

    @property
    def conserves_energy(self) -> bool:
        """Never promised: nothing imposes it."""
        return False

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Sum the series; zero below the horizon."""
        x, y, z, u, v, w = jnp.broadcast_arrays(*incoming, *outgoing)
        arrive = real_basis(jnp.stack([x, y, z], axis=-1), self.band_limit)
        leave = real_basis(jnp.stack([u, v, w], axis=-1), self.band_limit)
        coupling = jnp.asarray(self.coupling, arrive.dtype)
        # In this order: the other would make a matrix of every pair of directions.
        through = jnp.einsum("...a,cab->c...b", arrive, coupling, precision="highest")
        sums = jnp.sum(through * leave[None], axis=-1)
        if self.in_reciprocal_form:
            sums = sums / jnp.maximum(w, _SMALLEST_COSINE)[None]
        visible = (z > 0) & (w > 0)
        return tuple(jnp.where(visible, lobe, 0) for lobe in sums)
