"""How a prediction changes as a sample's normal and its direction to the camera turn.

Wrong cameras, a misplaced object, bumps and turned lights all act through these two directions.
So one set of derivatives serves them all: of each part of the light, by two steps of each
direction along the sphere.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.geometry import SurfaceSamples, world_from_local
from jaxrender.inverse.models import columns_under
from jaxrender.lighting import LightNodes
from jaxrender.programs import stored
from jaxrender.reflection import FrameNodes, radiance
from jaxrender.shapes import AnyArray, Array, Bool, Float


class Turning(NamedTuple):
    """What one part of the light makes a camera see, and how that changes.

    ``by_normal`` and ``by_outgoing`` are derivatives along two tangents each (``tangents``).
    """

    value: Float[np.ndarray, "sample channel"]
    by_normal: Float[np.ndarray, "sample channel 2"]
    by_outgoing: Float[np.ndarray, "sample channel 2"]
    samples: SurfaceSamples

    def moved(
        self,
        normals: Float[np.ndarray, "sample 3"],
        outgoing: Float[np.ndarray, "sample 3"],
    ) -> Float[np.ndarray, "sample channel"]:
        """Differentiate along a movement of every sample's two directions."""
        along_normal = np.einsum("sit,si->st", tangents(self.samples.normals), normals)
        along_outgoing = np.einsum("sit,si->st", tangents(self.samples.outgoing), outgoing)
        found = np.einsum("sct,st->sc", self.by_normal, along_normal)
        return found + np.einsum("sct,st->sc", self.by_outgoing, along_outgoing)

    def turned(self, axes: Float[np.ndarray, "*sample 3"]) -> Float[np.ndarray, "sample channel"]:
        """Differentiate along a rotation of this part of the light about axes; radians.

        Turning the light is turning all else the other way.
        """
        normals, outgoing = (np.asarray(part, float) for part in self.samples)
        return self.moved(-np.cross(axes, normals), -np.cross(axes, outgoing))


def tangents(directions: Float[AnyArray, "sample 3"]) -> Float[np.ndarray, "sample 3 2"]:
    """Make two tangents of the sphere at every direction."""
    return np.asarray(world_from_local(jnp.asarray(directions)))[:, :, :2]


def turning_of(
    brdf: Parametric,
    samples: SurfaceSamples,
    nodes: LightNodes | FrameNodes,
    seen: Bool[np.ndarray, "sample node"] | None = None,
    paint: Float[np.ndarray, "sample lobe channel"] | None = None,
) -> Turning:
    """Evaluate a material under one part of the light, and differentiate it.

    ``paint`` are the amplitudes of the lobes at each sample, where they are not the material's.
    """
    arrays = SurfaceSamples(*(jnp.asarray(part, float) for part in samples))
    steps = [jnp.asarray(tangents(part)) for part in samples]
    value, slopes = _turning(brdf, arrays, nodes, seen, paint, *steps)
    first, second = np.split(np.moveaxis(np.asarray(slopes), 0, -1), 2, axis=-1)
    return Turning(
        np.asarray(value), first, second, SurfaceSamples(*(np.asarray(part) for part in samples))
    )


@stored(effort="less")
def _turning(
    brdf: Parametric,
    samples: SurfaceSamples,
    nodes: LightNodes | FrameNodes,
    seen: Bool[AnyArray, "sample node"] | None,
    paint: Float[AnyArray, "sample lobe channel"] | None,
    by_normal: Float[Array, "sample 3 2"],
    by_outgoing: Float[Array, "sample 3 2"],
) -> tuple[Float[Array, "sample channel"], Float[Array, "4 sample channel"]]:
    def at(normals, outgoing) -> Float[Array, "sample channel"]:
        columns = columns_under(brdf, SurfaceSamples(normals, outgoing), nodes, seen)
        return radiance(brdf, columns) if paint is None else jnp.sum(paint * columns, axis=1)

    still = jnp.zeros_like(by_normal)
    steps = (
        jnp.moveaxis(jnp.concatenate([by_normal, still], axis=2), 2, 0),
        jnp.moveaxis(jnp.concatenate([still, by_outgoing], axis=2), 2, 0),
    )
    along = jax.vmap(
        lambda *step: jax.jvp(at, (samples.normals, samples.outgoing), step), out_axes=(None, 0)
    )
    return along(*steps)


@stored(effort="less")
def lobes_under(
    brdf: Parametric,
    samples: SurfaceSamples,
    nodes: LightNodes | FrameNodes,
    seen: Bool[AnyArray, "sample node"] | None = None,
) -> Float[Array, "sample lobe channel"]:
    """Evaluate a material's lobes at amplitude one, under one part of the light."""
    return columns_under(brdf, samples, nodes, seen)
