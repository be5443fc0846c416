"""Directions with their components kept apart, as loops over many millions of pairs want them.

An array of shape [..., 3] makes every operation stride over three numbers; three arrays let the
compiler fuse a whole BRDF evaluation into one pass (three to four times faster on a CPU).
"""

from typing import NamedTuple

import jax.numpy as jnp

from jaxrender.shapes import AnyArray, Array, Directions, Float, checked


class Components(NamedTuple):
    """The three components of directions, each an array of the batch's shape."""

    x: Float[AnyArray, "*batch"]
    y: Float[AnyArray, "*batch"]
    z: Float[AnyArray, "*batch"]

    @classmethod
    @checked
    def of(cls, directions: Directions) -> "Components":
        """Take an array of directions apart."""
        directions = jnp.asarray(directions)
        return cls(directions[..., 0], directions[..., 1], directions[..., 2])

    @checked
    def in_frame(self, world_from_local: Float[AnyArray, "3 3"]) -> "Components":
        """Turn world directions into the frame whose axes are the columns of the matrix."""
        frame = jnp.asarray(world_from_local)
        return Components(
            *(self.x * frame[0, k] + self.y * frame[1, k] + self.z * frame[2, k] for k in range(3))
        )

    def dot(self, other: "Components") -> Float[Array, "*batch"]:
        """Inner product with other directions."""
        return jnp.asarray(self.x * other.x + self.y * other.y + self.z * other.z)
