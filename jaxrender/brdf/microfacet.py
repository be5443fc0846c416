"""The thesis's microfacet model: a simplified Torrance-Sparrow lobe over a Lambertian base.

rho = kd + ks F S / (4 cos t_i cos t_o),  S = exp(-(t_h / sigma)^2) / (pi sigma^2)      (T 6.2)

with F the *normalised* Fresnel ratio.  Without a masking term the model is reciprocal only when F
is taken at the half angle, and it exceeds 1 at grazing exit (ERRATA 25: directional albedo 1.21 at
85 degrees for sigma = .2): both are the thesis's, kept on purpose.  ``fresnel="half"`` and
``masking="smith"`` are the variants that physics would choose.

``distribution="beckmann"`` or ``"ggx"`` puts one of the two distributions in use today in the place
of S, with unit projected area (``distributions``, ERRATA 54): with both variants it is the model
that renderers call rough dielectric or, with ``mu=None``, rough conductor.
"""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.distributions import DISTRIBUTIONS
from jaxrender.brdf.facets import facet_transfer
from jaxrender.brdf.fresnel import FRESNEL_ANGLES, largest_fresnel_ratio, normalised_fresnel
from jaxrender.brdf.glossy import Glossy
from jaxrender.brdf.half_vector import lifted
from jaxrender.brdf.masking import FACET_MASKINGS, MASKINGS
from jaxrender.brdf.parameters import (
    Scalar,
    as_scalar,
    as_scalar_or_none,
    is_known,
    refuse_outside,
    refuse_unlisted,
    share_of_energy_is_bounded,
)
from jaxrender.brdf.parametric import ShapeParameter
from jaxrender.geometry import Components, squared_angle_of_versine
from jaxrender.shapes import AnyArray, Array, Float, checked

# Keeps 1 / cos t_o finite; samples this close to grazing are never used.
_SMALLEST_COSINE = 1e-6
# The exponential lobes are below exp(-25) of their peak beyond this many sigmas of the half angle
# (Gaussian) or of its tangent (Beckmann).
_REACH = 5.0


class Microfacet(Glossy):
    """T 6.2 with ``kd`` and ``ks`` per channel, roughness ``sigma`` and index ``mu``.

    ``mu=None`` sets F = 1 (metals).  ``sigma`` is the half angle (radians) at which the Gaussian is
    1/e of its peak, the root mean square slope of ``beckmann``, and of ``ggx`` what is commonly
    called alpha.  Smith's masking is that of the distribution (Beckmann's for the Gaussian).

    Raises ``ValueError`` for an unknown Fresnel angle, masking or distribution and, outside traced
    functions, for sigma <= 0 (of beckmann and ggx also > 1) and mu <= 1.
    """

    shape: ClassVar[ShapeParameter] = ShapeParameter("sigma")

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    sigma: Scalar = eqx.field(converter=as_scalar)
    mu: Scalar | None = eqx.field(converter=as_scalar_or_none)
    fresnel: str = eqx.field(static=True, default="exit")
    masking: str = eqx.field(static=True, default="none")
    distribution: str = eqx.field(static=True, default="gaussian")

    def __check_init__(self):
        refuse_unlisted("fresnel", self.fresnel, FRESNEL_ANGLES)
        refuse_unlisted("masking", self.masking, tuple(MASKINGS))
        refuse_unlisted("distribution", self.distribution, tuple(DISTRIBUTIONS))
        if is_known(self.sigma) and not np.asarray(self.sigma) > 0:
            raise ValueError(
                f"sigma={self.sigma}: the roughness must be above 0 (mirror: use a small one)"
            )
        if self.distribution != "gaussian":
            remedy = f"for a rougher surface than {self.distribution} has use gaussian"
            refuse_outside("sigma", self.sigma, "(0, 1]", remedy)
        if self.mu is not None and is_known(self.mu) and not np.asarray(self.mu) > 1:
            raise ValueError(
                f"mu={self.mu}: the refractive index must be above 1, or None for a metal"
            )

    @property
    def reciprocal(self) -> bool:
        """Unless the Fresnel ratio is taken at the exit angle, as the thesis does."""
        return self.mu is None or self.fresnel == "half"

    @property
    def conserves_energy(self) -> bool:
        """With masking, when pi kd + ks times the Fresnel ratio's largest value is at most 1.

        Without masking, never.
        """
        if self.masking == "none":
            return not np.any(self.ks) and share_of_energy_is_bounded(np.pi * self.kd)
        ratio = largest_fresnel_ratio(self.mu)
        return share_of_energy_is_bounded(np.pi * self.kd, self.ks * ratio)

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    @property
    def fresnel_is_factor(self) -> bool:
        """Unless it is taken at the half angle."""
        return self.mu is None or self.fresnel == "exit"

    @property
    def reach(self) -> Float[Array, ""] | None:
        """Twice the half angle at which the lobe ends; GGX has a tail."""
        if self.distribution == "ggx":
            return None
        end = _REACH * jnp.asarray(self.sigma)
        return 2 * (end if self.distribution == "gaussian" else jnp.arctan(end))

    @property
    def energy(self) -> float:
        """One: ks is about the lobe's albedo at normal exitance."""
        return 1.0

    def with_variant(self, fresnel: str, masking: str) -> "Microfacet":
        """Choose another Fresnel angle and masking of the same distribution."""
        return dataclasses.replace(self, fresnel=fresnel, masking=masking)

    def as_metal(self) -> "Microfacet":
        """Drop the Fresnel ratio, where it is a factor that the caller multiplies by himself."""
        return dataclasses.replace(self, mu=None, fresnel="exit")

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
        """Evaluate the clamped cosine and F S G / (4 cos t_o)."""
        visible = (incoming.z > 0) & (outgoing.z > 0)
        diffuse = jnp.where(visible, incoming.z, 0)
        return diffuse, jnp.where(visible, self.specular_transfer(incoming, outgoing), 0)

    def specular_transfer(
        self, incoming: Components, outgoing: Components
    ) -> Float[Array, "*batch"]:
        """Evaluate F S G / (4 cos t_o) for directions above the horizon (below: meaningless)."""
        if self.distribution == "gaussian":
            lobe, cos_half, cos_o = self._gaussian_lobe(incoming, outgoing)
        else:
            incoming, outgoing = lifted(incoming), lifted(outgoing)
            facets = DISTRIBUTIONS[self.distribution](self.sigma)
            lobe, cos_half = facet_transfer(facets, "none", incoming, outgoing)
            cos_o = jnp.asarray(outgoing.z)
        return self._attenuated(lobe, incoming, outgoing, cos_half, cos_o)

    def _attenuated(
        self,
        lobe: Float[Array, "*batch"],
        incoming: Components,
        outgoing: Components,
        cos_half: Float[Array, "*batch"],
        cos_o: Float[Array, "*#batch"],
    ) -> Float[Array, "*batch"]:
        """Multiply a lobe by masking and Fresnel ratio."""
        if self.masking != "none":
            lobe = lobe * self.masked(self.masking, incoming, outgoing)
        if self.mu is None:
            return lobe
        return lobe * normalised_fresnel(self.mu, cos_o if self.fresnel == "exit" else cos_half)

    def masked(
        self, masking: str, incoming: Components, outgoing: Components
    ) -> Float[Array, "*batch"]:
        """Evaluate the masking G of that name for this model's distribution."""
        if self.distribution != "gaussian":
            facets = DISTRIBUTIONS[self.distribution](self.sigma)
            return FACET_MASKINGS[masking](facets, incoming, outgoing)
        cos_o = jnp.maximum(outgoing.z, _SMALLEST_COSINE)
        return MASKINGS[masking](self.sigma, incoming.z, cos_o)

    def _gaussian_lobe(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"], Float[Array, "*exit"]]:
        """Evaluate S / (4 cos t_o), the cosine to the half vector, and the exit cosine.

        Normalised as T 6.2 has it.  1 - cos t_h is formed from the half vector's components along
        the surface: in single precision cosines have no digits left for a narrow lobe.
        """
        cos_o = jnp.maximum(outgoing.z, _SMALLEST_COSINE)
        x, y, z = incoming.sum_with(outgoing)
        along = x * x + y * y
        # |w_i + w_o| / 2 is the cosine between either direction and the half vector.
        squared_length = jnp.maximum(along + z * z, _SMALLEST_COSINE**2)
        half_length = jnp.sqrt(squared_length)
        versine = along / (squared_length + jnp.maximum(z, 0) * half_length)
        squared_half_angle = squared_angle_of_versine(jnp.minimum(versine, 1))
        lobe = microfacet_distribution(squared_half_angle, self.sigma) / (4 * cos_o)
        return lobe, half_length / 2, cos_o


@checked
def microfacet_distribution(
    squared_half_angle: Float[AnyArray, "*batch"], sigma: Scalar
) -> Float[Array, "*batch"]:
    """Evaluate S = exp(-(t_h / sigma)^2) / (pi sigma^2) of T 6.2, in 1/sr."""
    return jnp.exp(-squared_half_angle / sigma**2) / (jnp.pi * sigma**2)
