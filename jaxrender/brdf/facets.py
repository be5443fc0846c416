"""The lobe that Torrance and Sparrow's, Cook and Torrance's and their successors' models share.

D(h) G(w_i, w_o) / (4 cos t_o), before the Fresnel reflectance at the angle to the half vector.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.distributions import DISTRIBUTIONS, Distribution
from jaxrender.brdf.half_vector import half_vector
from jaxrender.brdf.masking import FACET_MASKINGS
from jaxrender.brdf.parameters import Scalar, refuse_unlisted, share_of_energy_is_bounded
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float


def distribution_named(
    name: str, roughness: Scalar, roughness_y: Scalar | None = None
) -> Distribution:
    """Make a distribution of ``DISTRIBUTIONS``; raises ``ValueError`` when it cannot be."""
    refuse_unlisted("distribution", name, tuple(DISTRIBUTIONS))
    if roughness_y is None:
        return DISTRIBUTIONS[name](roughness)
    if name == "gaussian":
        raise ValueError(
            f"roughness_y={roughness_y}: the Gaussian distribution is isotropic; leave it out, "
            "or choose distribution='beckmann' or 'ggx'"
        )
    return DISTRIBUTIONS[name](**{"roughness": roughness, "roughness_y": roughness_y})


class FacetTransfer(NamedTuple):
    """D G / (4 cos t_o), and the cosine between either direction and the half vector."""

    lobe: Float[Array, "*batch"]
    half_cosine: Float[Array, "*batch"]


def facet_transfer(
    distribution: Distribution, masking: str, incoming: Components, outgoing: Components
) -> FacetTransfer:
    """Evaluate the facets' lobe for lifted directions."""
    half = half_vector(incoming, outgoing)
    shading = FACET_MASKINGS[masking](distribution, incoming, outgoing)
    lobe = distribution.density(half.direction) * shading / (4 * outgoing.z)
    return FacetTransfer(lobe, jnp.minimum(half.cosine, 1))


def facets_conserve_energy(
    masking: str, kd: Float[AnyArray, "channel"], ks: Float[AnyArray, "channel"]
) -> bool:
    """Say whether masking bounds the facets' albedo by ks, the Fresnel reflectance by 1."""
    if masking == "none" and np.any(ks):
        return False
    return share_of_energy_is_bounded(np.pi * kd, ks)
