"""Where and from where a surface is seen: what the forward model knows of a pixel."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.geometry.directions import dot, reflect
from jaxrender.geometry.frames import world_from_local
from jaxrender.shapes import AnyArray, Array, Float

# Closer to its normal than this (radians) a sample is seen head-on: no azimuth is marked.
_HEAD_ON = 1e-6


class SurfaceSamples(NamedTuple):
    """Unit ``normals`` and unit ``outgoing`` directions (surface to camera) of usable pixels."""

    normals: Float[AnyArray, "sample 3"]
    outgoing: Float[AnyArray, "sample 3"]

    @property
    def exit_cosines(self) -> Float[AnyArray, "sample"]:
        """The cosines of the angles between the normals and the outgoing directions."""
        if isinstance(self.normals, np.ndarray) and isinstance(self.outgoing, np.ndarray):
            # On the host, where nothing is compiled for each number of samples.
            return np.sum(self.normals * self.outgoing, axis=-1)
        return dot(self.normals, self.outgoing)

    @property
    def reflected(self) -> Float[AnyArray, "sample 3"]:
        """The reflected viewing directions R, where a mirror would look."""
        if isinstance(self.normals, np.ndarray) and isinstance(self.outgoing, np.ndarray):
            return 2 * self.exit_cosines[:, None] * self.normals - self.outgoing
        return reflect(self.outgoing, self.normals)

    @property
    def world_from_mirror(self) -> Float[Array, "sample 3 3"]:
        """Frames with R as third axis and N in the half plane of the first; any, seen head-on."""
        normals, reflected = jnp.asarray(self.normals), self.reflected
        towards = normals - dot(normals, reflected)[:, None] * reflected
        squared = dot(towards, towards)[:, None]
        head_on = squared < _HEAD_ON**2
        # The root of zero has no derivative, so there it is not taken.
        length = jnp.sqrt(jnp.where(head_on, 1, squared))
        first = jnp.where(head_on, world_from_local(reflected)[:, :, 0], towards / length)
        return jnp.stack([first, jnp.cross(reflected, first), reflected], axis=-1)
