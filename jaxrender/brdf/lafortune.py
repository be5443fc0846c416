"""Lafortune, Foo, Torrance and Greenberg's model of 1997: generalised cosine lobes.

rho = kd + sum_j ks_j max(C_xj x_i x_o + C_yj y_i y_o + C_zj z_i z_o, 0)^n_j

C = (-1, -1, 1) is Phong's mirror lobe (as a BRDF), (1, 1, 1) a retro-reflector; unequal x and y
are anisotropic, and a C_z smaller than the others moves the peak towards grazing.

``CosineLobe`` is the model with one lobe (-1, -1, C_z), which a fit can recover.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
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

# Beyond the angle whose cosine is exp(-25 / n) the power n is below exp(-25).
_NEGLIGIBLE = 25.0


class Lafortune(BRDF):
    """Cosine lobes with ``coefficients`` (C_x, C_y, C_z) and ``exponents`` n >= 0 over kd.

    ``ks`` in 1/sr is the value where the generalised cosine is 1.  Raises ``ValueError`` for a
    negative exponent and, with lobes of unlike number, says which.
    """

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "cosine channel"]
    coefficients: Float[AnyArray, "_ 3"]
    exponents: Float[AnyArray, "_"]

    def __check_init__(self):
        lobes = self.ks.shape[0], self.coefficients.shape[0], self.exponents.shape[0]
        if len(set(lobes)) > 1:
            raise ValueError(
                f"ks, coefficients and exponents have {lobes} lobes: give each lobe one row of each"
            )
        refuse_outside("exponents", self.exponents, "[0, inf)", "larger is narrower")

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """The clamped cosine's row kd, then each lobe's ks."""
        return jnp.concatenate([jnp.asarray(self.kd)[None, :], jnp.asarray(self.ks)])

    @property
    def reciprocal(self) -> bool:
        """Always."""
        return True

    @property
    def conserves_energy(self) -> bool:
        """When a bound says so: pi kd + sum_j ks_j 2 pi max|C_j|^n_j / (n_j + 2) is at most 1.

        The lobe's integral with the cosine is largest where its axis is the normal, and the axis
        (C_x x_o, C_y y_o, C_z z_o) is at most max |C| long.
        """
        exponents = np.asarray(self.exponents, float)
        longest = np.max(np.abs(np.asarray(self.coefficients, float)), axis=1)
        bounds = 2 * np.pi * longest**exponents / (exponents + 2)
        parts = np.asarray(self.ks, float) * bounds[:, None]
        return share_of_energy_is_bounded(np.pi * np.asarray(self.kd, float), *parts)

    @property
    def isotropic(self) -> bool:
        """When C_x = C_y in every lobe."""
        return bool(np.all(self.coefficients[:, 0] == self.coefficients[:, 1]))

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate the clamped cosine, and each lobe times the clamped cosine."""
        visible = are_visible(incoming, outgoing)
        x, y, z = (jnp.asarray(a * b) for a, b in zip(incoming, outgoing, strict=True))
        phong = mirror_versine(incoming, outgoing)
        coefficients, exponents = matching(self.coefficients, z), matching(self.exponents, z)
        lobes = []
        for (cx, cy, cz), exponent in zip(coefficients, exponents, strict=True):
            # 1 - (C_x x + C_y y + C_z z), by how much its axis differs from R.
            versine = phong - (cx + 1) * x - (cy + 1) * y - (cz - 1) * z
            cosine = cx * x + cy * y + cz * z
            lobe = power_of_cosine(versine, exponent, cosine) * incoming.z
            lobes.append(jnp.where(visible, lobe, 0))
        return jnp.where(visible, incoming.z, 0), *lobes


class CosineLobe(ByOwnNumber, Glossy):
    """One isotropic lobe (-1, -1, ``c_z``) of an ``exponent`` n >= 0 over kd; c_z = 1 is Phong's.

    ``ks`` in 1/sr is the value where the generalised cosine is 1.
    """

    # With c_z = 1 the power of R . w_i, as Phong's: n = 1 / (2 sigma^2).
    shape: ClassVar[ShapeParameter] = ShapeParameter("exponent", 0.5, -2.0)

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    exponent: Scalar = eqx.field(converter=as_scalar)
    c_z: Scalar = eqx.field(converter=as_scalar, default=1.0)

    def __check_init__(self):
        refuse_outside("exponent", self.exponent, "[0, inf)", "larger is narrower")
        refuse_outside("c_z", self.c_z, "(0, inf)", "1 is Phong's lobe, measured ones have .8 to 1")

    @property
    def reciprocal(self) -> bool:
        """Always."""
        return True

    @property
    def conserves_energy(self) -> bool:
        """When pi kd + ks 2 pi max(1, C_z)^n / (n + 2) is at most 1, as of ``Lafortune``."""
        longest = np.maximum(1.0, self.c_z)
        bound = 2 * np.pi * longest**self.exponent / (self.exponent + 2)
        return share_of_energy_is_bounded(np.pi * self.kd, self.ks * bound)

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    @property
    def reach(self) -> Float[Array, ""]:
        """The angle at which the power has vanished, and how far the axis may be off R."""
        exponent, c_z = jnp.asarray(self.exponent), jnp.asarray(self.c_z)
        # Seen at t the axis is at arctan(tan t / C_z); furthest from t where tan t = sqrt(C_z).
        off = jnp.arctan(jnp.abs(1 - c_z) / (2 * jnp.sqrt(c_z)))
        return jnp.arccos(jnp.exp(-_NEGLIGIBLE / exponent)) + off

    @property
    def energy(self) -> Scalar:
        """The lobe's albedo at normal exitance, 2 pi C_z^n / (n + 2)."""
        return 2 * np.pi * self.c_z**self.exponent / (self.exponent + 2)

    def specular_transfer(
        self, incoming: Components, outgoing: Components
    ) -> Float[Array, "*batch"]:
        """Evaluate the lobe times cos t_i."""
        versine = mirror_versine(incoming, outgoing)
        exponent, c_z = matching(self.exponent, versine), matching(self.c_z, versine)
        longer = (c_z - 1) * incoming.z * outgoing.z
        cosine = mirror_cosine(incoming, outgoing) + longer
        return power_of_cosine(versine - longer, exponent, cosine) * incoming.z
