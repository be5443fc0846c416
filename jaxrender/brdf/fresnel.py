"""Fresnel reflectance of dielectrics and metals, and the normalised ratio of T 6.2.

The thesis writes F for the ratio F(mu, t) / F(mu, 0), which is 1 at normal exitance; the literal
F(1.5, 0) = 0.04 would make the specular lobe 25 times too weak (ERRATA 44).  ``mu`` is the
refractive index; ``None`` stands for a metal, whose ratio the thesis takes to be 1 everywhere.
The physical models multiply by the reflectance itself, at the angle to the half vector: ``fresnel``
of a dielectric, ``conductor_fresnel`` of a complex index eta + i k, or Schlick's polynomial.
"""

import jax.numpy as jnp

from jaxrender.shapes import AnyArray, Array, Float, checked

# The angle that the Fresnel ratio is taken at: the exit angle is what makes T 6.6 a product
# (the thesis's choice), the angle to the half vector is what the physics says.
FRESNEL_ANGLES = ("exit", "half")
# Where the reflectance of most metals is furthest below Schlick's curve.
EDGE_COSINE = 1 / 7


@checked
def fresnel(
    mu: Float[AnyArray, ""] | float, cosines: Float[AnyArray, "*batch"]
) -> Float[Array, "*batch"]:
    """Evaluate the unpolarised Fresnel reflectance of a dielectric of index mu > 1."""
    return jnp.asarray(head_on_reflectance(mu) * _over_head_on(mu, _clipped(cosines)))


@checked
def normalised_fresnel(
    mu: Float[AnyArray, ""] | float | None, cosines: Float[AnyArray, "*batch"]
) -> Float[Array, "*batch"]:
    """Evaluate F(mu, t) / F(mu, 0) of T 6.2; 1 everywhere for ``mu=None``."""
    if mu is None:
        return jnp.ones_like(cosines)
    return _over_head_on(mu, _clipped(cosines))


def largest_fresnel_ratio(mu: Float[AnyArray, ""] | float | None) -> float:
    """Compute F(mu, t) / F(mu, 0) at grazing: ((mu + 1) / (mu - 1))^2, 25 for glass; 1 of a metal.

    Tell what a lobe that is weighed by the ratio may reflect at most.
    """
    return 1.0 if mu is None else float((mu + 1) / (mu - 1)) ** 2


def _over_head_on(
    mu: Float[AnyArray, ""] | float, cosines: Float[Array, "*batch"]
) -> Float[Array, "*batch"]:
    """Evaluate F(mu, t) / F(mu, 0) with all digits for mu near 1, where F itself has few.

    With g^2 = mu^2 - sin^2 t, s = ((g - c) / (g + c))^2 and g - c = (mu^2 - 1) / (g + c), the
    ratio of s to its value head-on is ((mu + 1) / (g + c))^4.
    """
    square = (mu - 1) * (mu + 1)
    total = jnp.sqrt(square + cosines**2) + cosines
    ratio = (cosines * total - 1) / (cosines * (square / total) + 1)
    return jnp.asarray(((mu + 1) / total) ** 4 * (1 + ratio**2) / 2)


@checked
def conductor_fresnel(
    eta: Float[AnyArray, ""] | float,
    k: Float[AnyArray, ""] | float,
    cosines: Float[AnyArray, "*batch"],
) -> Float[Array, "*batch"]:
    """Evaluate the unpolarised Fresnel reflectance of a metal of complex index eta + i k.

    With a + i b = sqrt((eta + i k)^2 - sin^2 t), in real numbers so that it differentiates:
    R_s = |(c - a - i b) / (c + a + i b)|^2 and R_p = R_s |(a - s^2/c + i b) / (a + s^2/c + i b)|^2.
    For k = 0 it is the dielectric's, also for eta < 1 (total reflection).
    """
    c = _clipped(cosines)
    c2, s2 = c * c, 1 - c * c
    real = eta * eta - k * k - s2
    # The floors keep both square roots' derivatives finite where a dielectric reflects totally.
    tiny = float(jnp.finfo(c.dtype).tiny) ** 0.5
    modulus = jnp.sqrt(jnp.maximum(real * real + 4 * (eta * k) ** 2, tiny))
    a = jnp.sqrt(jnp.maximum((modulus + real) / 2, tiny))
    s_polarised = (modulus + c2 - 2 * a * c) / (modulus + c2 + 2 * a * c)
    even, odd = c2 * modulus + s2 * s2, 2 * a * c * s2
    return s_polarised * (1 + (even - odd) / (even + odd)) / 2


@checked
def schlick_fresnel(
    head_on: Float[AnyArray, ""] | float, cosines: Float[AnyArray, "*batch"]
) -> Float[Array, "*batch"]:
    """Evaluate Schlick's approximation F_0 + (1 - F_0) (1 - cos t)^5."""
    complement = 1 - _clipped(cosines)
    return jnp.asarray(head_on + (1 - head_on) * complement**5)


@checked
def schlick_growth(cosines: Float[AnyArray, "*batch"]) -> Float[Array, "*batch"]:
    """Evaluate Schlick's (1 - cos t)^5, how far a reflectance has grown towards one."""
    return jnp.asarray((1 - _clipped(cosines)) ** 5)


@checked
def edge_darkening(cosines: Float[AnyArray, "*batch"]) -> Float[Array, "*batch"]:
    """Evaluate cos t (1 - cos t)^6 over its largest value, at cos t = 1/7 (82 degrees).

    A metal's reflectance is Schlick's less (1 - tint) of it times Schlick's at that angle
    (Kutz, Hasan and Edmondson 2021, "F82-tint").
    """
    c = _clipped(cosines)
    return jnp.asarray(c * (1 - c) ** 6 / (EDGE_COSINE * (1 - EDGE_COSINE) ** 6))


@checked
def head_on_reflectance(mu: Float[AnyArray, ""] | float) -> Float[AnyArray, ""] | float:
    """Evaluate F_0 = ((mu - 1) / (mu + 1))^2 of a dielectric."""
    return ((mu - 1) / (mu + 1)) ** 2


def _clipped(cosines: Float[AnyArray, "*batch"]) -> Float[Array, "*batch"]:
    """Clip to 0 ... 1, with the slope of what is inside at the ends, where ``clip`` has half."""
    c = jnp.asarray(cosines)
    return jnp.where(c < 0, 0, jnp.where(c > 1, 1, c))
