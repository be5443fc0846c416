"""Fresnel reflectance of a dielectric, and the normalised ratio that T 6.2 multiplies by.

The thesis writes F for the ratio F(mu, t) / F(mu, 0), which is 1 at normal exitance; the literal
F(1.5, 0) = 0.04 would make the specular lobe 25 times too weak (ERRATA 44).  ``mu`` is the
refractive index; ``None`` stands for a metal, whose ratio the thesis takes to be 1 everywhere.
"""

import jax.numpy as jnp

from jaxrender.shapes import AnyArray, Array, Float

# The angle that the Fresnel ratio is taken at: the exit angle is what makes T 6.6 a product
# (the thesis's choice), the angle to the half vector is what the physics says.
FRESNEL_ANGLES = ("exit", "half")


def fresnel(
    mu: Float[AnyArray, ""] | float, cosines: Float[AnyArray, "*batch"]
) -> Float[Array, "*batch"]:
    """Evaluate the unpolarised Fresnel reflectance of a dielectric of index mu > 1."""
    cosines = jnp.clip(jnp.asarray(cosines), 0, 1)
    g = jnp.sqrt(mu * mu - 1 + cosines**2)
    s_polarised = ((g - cosines) / (g + cosines)) ** 2
    ratio = (cosines * (g + cosines) - 1) / (cosines * (g - cosines) + 1)
    return s_polarised * (1 + ratio**2) / 2


def normalised_fresnel(
    mu: Float[AnyArray, ""] | float | None, cosines: Float[AnyArray, "*batch"]
) -> Float[Array, "*batch"]:
    """Evaluate F(mu, t) / F(mu, 0) of T 6.2; 1 everywhere for ``mu=None``."""
    if mu is None:
        return jnp.ones_like(cosines)
    return fresnel(mu, cosines) * ((mu + 1) / (mu - 1)) ** 2
