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


class HalfVector(NamedTuple):
    """The unit half vector and its cosine to either direction."""

    direction: Components
    cosine: Float[Array, "*batch"]


def are_visible(incoming: Components, outgoing: Components) -> Bool[AnyArray, "*batch"]:
    """Say where both directions are above the horizon."""
    return (incoming.z > 0) & (outgoing.z > 0)


def lifted(direction: Components) -> Components:
    """Replace cosines below the smallest one by it; only meaningless values are changed."""
    return Components(
        jnp.asarray(direction.x),
        jnp.asarray(direction.y),
        jnp.maximum(direction.z, SMALLEST_COSINE),
    )


def half_vector(incoming: Components, outgoing: Components) -> HalfVector:
    """Evaluate h = (w_i + w_o) / |w_i + w_o| of lifted directions; |w_i + w_o| / 2 = w_i . h."""
    x, y, z = (a + b for a, b in zip(incoming, outgoing, strict=True))
    # The components' sum of squares, since 2 + 2 w_i . w_o cancels where both are at grazing.
    length = jnp.sqrt(x * x + y * y + z * z)
    return HalfVector(Components(x / length, y / length, z / length), length / 2)


def power(
    base: Float[AnyArray, "*batch"], exponent: Float[AnyArray, ""] | float
) -> Float[Array, "*batch"]:
    """Evaluate max(x, 0)^s, whose derivatives in x and in s are 0 where x is not positive."""
    positive = base > 0
    return jnp.where(positive, jnp.exp(exponent * jnp.log(jnp.where(positive, base, 1))), 0)
