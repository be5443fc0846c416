"""Phong's lobe about the mirror direction, as the transfer function that T 3.34 makes of it.

rho cos t_i = kd cos t_i + ks (s + 1) / (2 pi) max(R . w_i, 0)^s                        (T 3.34)

with R the reflected outgoing direction.  Because the lobe itself is the transfer function, its
BRDF is the lobe over cos t_i: not reciprocal, and more leaves than arrives from grazing directions
(ERRATA 25).  The lobe has unit energy over the whole sphere.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.glossy import Glossy
from jaxrender.brdf.half_vector import are_visible, mirror_cosine, mirror_versine, power_of_cosine
from jaxrender.brdf.parameters import (
    Scalar,
    as_scalar,
    matching,
    refuse_outside,
    share_of_energy_is_bounded,
)
from jaxrender.brdf.parametric import ByOwnNumber, ShapeParameter
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float

# Beyond the angle whose cosine is exp(-25 / s) the power s is below exp(-25).
_NEGLIGIBLE = 25.0


class Phong(ByOwnNumber, Glossy):
    """T 3.34 over a Lambertian base, with a real ``exponent`` s >= 0.

    ``clipped=False`` lets the lobe reach below the horizon of the incoming light, as the thesis
    does to have an exact convolution; ``evaluate`` shows the part above.
    """

    # T 6.7: s = 1 / (2 sigma^2).
    shape: ClassVar[ShapeParameter] = ShapeParameter("exponent", 0.5, -2.0)

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    exponent: Scalar = eqx.field(converter=as_scalar)
    clipped: bool = eqx.field(static=True, default=True)

    def __check_init__(self):
        refuse_outside("exponent", self.exponent, "[0, inf)", "larger is narrower, 32 is glossy")

    @property
    def reciprocal(self) -> bool:
        """Only without the lobe: the lobe over cos t_i is not symmetric."""
        return not np.any(self.ks)

    @property
    def conserves_energy(self) -> bool:
        """Only without the lobe: from grazing directions its BRDF has no bound."""
        return not np.any(self.ks) and share_of_energy_is_bounded(np.pi * self.kd)

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    @property
    def reach(self) -> Float[Array, ""]:
        """The angle from R at which the power has vanished, at most a right one."""
        return jnp.arccos(jnp.exp(-_NEGLIGIBLE / jnp.asarray(self.exponent)))

    @property
    def energy(self) -> float:
        """One: ks is about the lobe's albedo at normal exitance."""
        return 1.0

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
        """Evaluate the clamped cosine and the normalised power of R . w_i."""
        visible = are_visible(incoming, outgoing)
        lobe = self.specular_transfer(incoming, outgoing)
        lit = visible if self.clipped else outgoing.z > 0
        return jnp.where(visible, incoming.z, 0), jnp.where(lit, lobe, 0)

    def specular_transfer(
        self, incoming: Components, outgoing: Components
    ) -> Float[Array, "*batch"]:
        """Evaluate the normalised power of R . w_i."""
        versine = mirror_versine(incoming, outgoing)
        exponent = matching(self.exponent, versine)
        power = power_of_cosine(versine, exponent, mirror_cosine(incoming, outgoing))
        return (exponent + 1) / (2 * np.pi) * power
