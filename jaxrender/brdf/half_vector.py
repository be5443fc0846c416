"""The direction half-way between the incoming and the outgoing one, safe to differentiate.

A lobe is evaluated for every pair and set to zero afterwards where a direction is below the
horizon; so that no derivative is NaN there, its directions are first lifted to the horizon.
"""

from typing import NamedTuple

import jax.numpy as jnp

from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Bool, Float

# Keeps 1 / cos t finite; samples this close to grazing are never used.
SMALLEST_COSINE = 1e-6
# Below it a cosine has more digits than its versine.
_SMALL = 0.5


class HalfVector(NamedTuple):
    """The unit half vector and its cosine to either direction."""

    direction: Components
    cosine: Float[Array, "*batch"]

    @property
    def versine(self) -> Float[Array, "*batch"]:
        """1 - N . h, with all its digits near the normal."""
        x, y, z = self.direction
        return jnp.asarray((x * x + y * y) / (1 + z))


def are_visible(incoming: Components, outgoing: Components) -> Bool[AnyArray, "*batch"]:
    """Say where both directions are above the horizon."""
    return (incoming.z > 0) & (outgoing.z > 0)


def lifted(direction: Components) -> Components:
    """Replace cosines below the smallest one by it; only meaningless values are changed."""
    return direction.lifted(SMALLEST_COSINE)


def half_vector(incoming: Components, outgoing: Components) -> HalfVector:
    """Evaluate h = (w_i + w_o) / |w_i + w_o| of lifted directions; |w_i + w_o| / 2 = w_i . h."""
    x, y, z = incoming.sum_with(outgoing)
    # The components' sum of squares, since 2 + 2 w_i . w_o cancels where both are at grazing.
    length = jnp.sqrt(x * x + y * y + z * z)
    return HalfVector(Components(x / length, y / length, z / length), length / 2)


def mirror_versine(incoming: Components, outgoing: Components) -> Float[Array, "*batch"]:
    """Evaluate 1 - R . w_i of unit directions as |w_i - R|^2 / 2, R = (-x, -y, z) of w_o."""
    x, y, _ = incoming.sum_with(outgoing)
    z = incoming.z - outgoing.z
    return jnp.asarray((x * x + y * y + z * z) / 2)


def mirror_cosine(incoming: Components, outgoing: Components) -> Float[Array, "*batch"]:
    """Evaluate R . w_i, R = (-x, -y, z) of w_o; near 1 its versine has more digits."""
    return jnp.asarray(incoming.z * outgoing.z - incoming.x * outgoing.x - incoming.y * outgoing.y)


def power_of_cosine(
    versine: Float[AnyArray, "*batch"],
    exponent: Float[AnyArray, ""] | float,
    cosine: Float[AnyArray, "*batch"] | None = None,
) -> Float[Array, "*batch"]:
    """Evaluate max(c, 0)^s from the versine 1 - c; where c is not positive derivatives are 0.

    A cosine near 1 has too few digits for a large power in single precision; its versine has all.
    For a power below 1 it is the reverse near 0: there the ``cosine``, where given, is used.
    """
    if cosine is None:
        positive = versine < 1
        logarithm = jnp.log1p(-jnp.where(positive, versine, 0))
    else:
        positive, small = cosine > 0, cosine < _SMALL
        near, far = jnp.where(small & positive, cosine, 1), jnp.where(small, 0, versine)
        logarithm = jnp.where(small, jnp.log(near), jnp.log1p(-far))
    return jnp.where(positive, jnp.exp(exponent * logarithm), 0)
