"""The tangent along which a lobe is widest or narrowest, turned about the normal."""

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.parameters import Scalar, matching
from jaxrender.brdf.parametric import Searched
from jaxrender.geometry import Components

# A tangent is turned by at most a right angle; its search variable is nearly even.
_MOST_TURN, _BELOW_TURNS = np.pi / 2, -10.0
TANGENT_ROTATION = Searched("tangent_rotation", -_MOST_TURN, _MOST_TURN, 0.0, _BELOW_TURNS)


def in_tangent_frame(direction: Components, rotation: Scalar) -> Components:
    """Turn a direction into the frame of a tangent that is turned by so many radians."""
    angle = matching(rotation, jnp.asarray(direction.z))
    c, s = jnp.cos(angle), jnp.sin(angle)
    return Components(
        c * direction.x + s * direction.y, c * direction.y - s * direction.x, direction.z
    )
