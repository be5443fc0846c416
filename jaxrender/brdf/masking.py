"""Geometric attenuation: how much of a microfacet is hidden or shadowed by its neighbours.

T 6.2 leaves the factor out ("not very significant except at grazing angles"); whether a fit's
answer rests on that omission is what the model variants ask.  A masking is a function of the
roughness and the two cosines, chosen by name from ``MASKINGS``.
"""

import jax.numpy as jnp
from jax.scipy.special import erf

from jaxrender.shapes import AnyArray, Array, Float

# Below this a cosine counts as grazing: the lobe is masked out there whatever the value.
_GRAZING_COSINE = 1e-4


def no_masking(
    sigma: Float[AnyArray, ""] | float,
    cos_incoming: Float[AnyArray, "*#batch"],
    cos_outgoing: Float[AnyArray, "*#batch"],
) -> Float[Array, "*batch"]:
    """Leave the factor out, as T 6.2 does."""
    return jnp.ones(
        jnp.broadcast_shapes(cos_incoming.shape, cos_outgoing.shape), cos_incoming.dtype
    )


def smith_masking(
    sigma: Float[AnyArray, ""] | float,
    cos_incoming: Float[AnyArray, "*#batch"],
    cos_outgoing: Float[AnyArray, "*#batch"],
) -> Float[Array, "*batch"]:
    """Evaluate Smith's height-correlated masking and shadowing for Gaussian slopes.

    The lobe exp(-(t_h / sigma)^2) is to first order Beckmann's with width sigma, whose
    Lambda(a) = exp(-a^2) / (2 a sqrt(pi)) - erfc(a) / 2 with a = 1 / (sigma tan t).
    """
    return 1 / (1 + _smith_lambda(sigma, cos_incoming) + _smith_lambda(sigma, cos_outgoing))


def _smith_lambda(
    sigma: Float[AnyArray, ""] | float, cosines: Float[AnyArray, "*batch"]
) -> Float[Array, "*batch"]:
    # An ulp short of 1 in any precision: at 1 itself the derivative is 0 times infinity.
    cosines = jnp.clip(cosines, _GRAZING_COSINE, 1 - float(jnp.finfo(cosines.dtype).eps))
    a = cosines / (sigma * jnp.sqrt(1 - cosines**2))
    return (erf(a) - 1) / 2 + jnp.exp(-(a**2)) / (2 * a * jnp.sqrt(jnp.pi))


MASKINGS = {"none": no_masking, "smith": smith_masking}
