"""Burley's diffuse curve (2012): darker at grazing angles of a smooth surface, brighter of a rough.

cos t_i (1 + (F - 1) (1 - cos t_i)^5) (1 + (F - 1) (1 - cos t_o)^5),  F = 1/2 + 2 r cos^2 t_d
"""

import jax.numpy as jnp

from jaxrender.brdf.parameters import Scalar
from jaxrender.geometry import Components
from jaxrender.shapes import Array, Float


def burley_diffuse(
    roughness: Scalar, incoming: Components, outgoing: Components, cosine: Float[Array, "*batch"]
) -> Float[Array, "*batch"]:
    """Evaluate the curve of roughness r in [0, 1] without its 1 / pi, times cos t_i.

    ``cosine`` is that between either direction and the half vector, cos t_d.
    """
    excess = 2 * roughness * cosine**2 - 0.5
    one, other = (1 + excess * (1 - side.z) ** 5 for side in (incoming, outgoing))
    return jnp.asarray(incoming.z * one * other)
