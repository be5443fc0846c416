"""Sheen: what fibres that stand up from cloth reflect, brightest where they are seen from the side.

D(h) = (2 + 1/r) sin(t_h)^(1/r) / (2 pi), with the visibility 1 / (4 (cos t_i + cos t_o - cos t_i
cos t_o)) in place of masking (Estevez and Kulla 2017, Neubelt and Pettineo 2013).
"""

import jax.numpy as jnp

from jaxrender.brdf.half_vector import half_vector
from jaxrender.brdf.parameters import Scalar, matching
from jaxrender.geometry import Components
from jaxrender.shapes import Array, Float

# Smoother sheen would reflect more at grazing angles than arrives.
SMOOTHEST_SHEEN = 0.25
# Squared sines below this are those of a facet that lies flat, which reflects nothing.
_FLAT = 1e-24


def sheen(roughness: Scalar, incoming: Components, outgoing: Components) -> Float[Array, "*batch"]:
    """Evaluate the lobe times cos t_i, for lifted directions and roughness r in [.25, 1]."""
    half = half_vector(incoming, outgoing).direction
    power = 1 / matching(roughness, jnp.asarray(incoming.z))
    squared_sine = jnp.maximum(half.x * half.x + half.y * half.y, _FLAT)
    density = (2 + power) * jnp.exp(power / 2 * jnp.log(squared_sine)) / (2 * jnp.pi)
    seen = incoming.z + outgoing.z - incoming.z * outgoing.z
    return density * incoming.z / (4 * seen)
