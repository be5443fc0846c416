"""Geometric attenuation: how much of a microfacet is hidden or shadowed by its neighbours.

T 6.2 leaves the factor out ("not very significant except at grazing angles"); whether a fit's
answer rests on that omission is what the model variants ask.  A masking is a function of the
roughness and the two cosines, chosen by name from ``MASKINGS``.
"""

import jax.numpy as jnp
from jax.scipy.special import erf

from jaxrender.brdf.distributions import Distribution
from jaxrender.brdf.half_vector import half_vector
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float, checked

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


@checked
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


def smith_facet_masking(
    distribution: Distribution, incoming: Components, outgoing: Components
) -> Float[Array, "*batch"]:
    """Evaluate Smith's height-correlated 1 / (1 + Lambda(w_i) + Lambda(w_o)) of a distribution."""
    return 1 / (1 + distribution.smith_lambda(incoming) + distribution.smith_lambda(outgoing))


def separate_smith_masking(
    distribution: Distribution, incoming: Components, outgoing: Components
) -> Float[Array, "*batch"]:
    """Evaluate Smith's masking and his shadowing as if either did not know of the other.

    It is darker than the height-correlated one, and what glTF 2.0 and Disney's model have.
    """
    masked, shadowed = (1 + distribution.smith_lambda(side) for side in (outgoing, incoming))
    return 1 / (masked * shadowed)


def v_groove_masking(
    distribution: Distribution, incoming: Components, outgoing: Components
) -> Float[Array, "*batch"]:
    """Evaluate Torrance and Sparrow's min(1, 2 h_z cos t_i / (w_o . h), 2 h_z cos t_o / (w_o . h)).

    Each facet is one side of a symmetric V-shaped groove, whatever the distribution.
    """
    half = half_vector(incoming, outgoing)
    lower = jnp.minimum(incoming.z, outgoing.z)
    return jnp.minimum(2 * half.direction.z * lower / half.cosine, 1)


def no_facet_masking(
    distribution: Distribution, incoming: Components, outgoing: Components
) -> Float[Array, "*batch"]:
    """Leave the factor out: more light than arrives may leave at grazing."""
    return jnp.ones_like(incoming.z + outgoing.z)


# What the models with a choice of distribution multiply by; Microfacet's own are MASKINGS.
FACET_MASKINGS = {
    "none": no_facet_masking,
    "smith": smith_facet_masking,
    "smith-separate": separate_smith_masking,
    "v-groove": v_groove_masking,
}
