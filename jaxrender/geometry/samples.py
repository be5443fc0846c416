"""Where and from where a surface is seen: what the forward model knows of a pixel."""

from typing import NamedTuple

import jax.numpy as jnp

from jaxrender.geometry.directions import dot, reflect
from jaxrender.shapes import AnyArray, Array, Float


class SurfaceSamples(NamedTuple):
    """Unit ``normals`` and unit ``outgoing`` directions (surface to camera) of usable pixels."""

    normals: Float[AnyArray, "sample 3"]
    outgoing: Float[AnyArray, "sample 3"]

    @property
    def exit_cosines(self) -> Float[Array, "sample"]:
        """The cosines of the angles between the normals and the outgoing directions."""
        return dot(jnp.asarray(self.normals), jnp.asarray(self.outgoing))

    @property
    def reflected(self) -> Float[Array, "sample 3"]:
        """The reflected viewing directions R, where a mirror would look."""
        return reflect(jnp.asarray(self.outgoing), jnp.asarray(self.normals))
