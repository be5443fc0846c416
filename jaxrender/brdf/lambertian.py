"""The Lambertian BRDF: the same radiance in every direction."""

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.parameters import share_of_energy_is_bounded
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float


class Lambertian(BRDF):
    """rho = kd, with kd = albedo / pi in 1/sr (T 6.2; ERRATA: kd is not the albedo).

    Reciprocal; conserves energy when kd <= 1/pi.
    """

    kd: Float[AnyArray, "channel"]

    @property
    def albedo(self) -> Float[AnyArray, "channel"]:
        """The fraction of the irradiance that leaves again, pi kd."""
        return self.kd * np.pi

    @property
    def amplitudes(self) -> Float[AnyArray, "1 channel"]:
        """The one lobe's: kd."""
        return self.kd[None, :]

    @property
    def reciprocal(self) -> bool:
        """Always."""
        return True

    @property
    def conserves_energy(self) -> bool:
        """When the albedo is at most 1."""
        return share_of_energy_is_bounded(self.albedo)

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    def transfer(self, incoming: Components, outgoing: Components) -> tuple[Float[Array, "*batch"]]:
        """Evaluate the clamped cosine (T 3.28)."""
        return (jnp.where(outgoing.z > 0, jnp.maximum(incoming.z, 0), 0),)
