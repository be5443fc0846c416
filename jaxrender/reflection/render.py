"""Camera to image, with either forward model.

Pixels are worked off in batches of one size, so that a single compiled program serves every
photograph whatever the object covers of it.
"""

import abc
from collections.abc import Sequence

import equinox as eqx
import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.geometry import Camera, Shape, SurfaceSamples, SurfaceView, observe
from jaxrender.lighting import LightNodes, SmoothLobes
from jaxrender.reflection.dual import DualLight, dual_columns
from jaxrender.reflection.integral import integral_columns, polar_columns, radiance
from jaxrender.shapes import Array, Float

_PIXELS_AT_ONCE = 4096


class ForwardModel(eqx.Module):
    """A light and a way to reflect it."""

    @abc.abstractmethod
    def columns(self, brdf: BRDF, samples: SurfaceSamples) -> Float[Array, "sample lobe channel"]:
        """Evaluate the radiance of each lobe at amplitude one."""


class DualForward(ForwardModel):
    """The dual model of T 6.9."""

    light: DualLight
    transfer: str = eqx.field(static=True, default="exit-cosine")

    def columns(self, brdf: BRDF, samples: SurfaceSamples) -> Float[Array, "sample lobe channel"]:
        """Evaluate T 6.9."""
        return dual_columns(brdf, samples, self.light, self.transfer)


class ExactForward(ForwardModel):
    """The integral: point masses summed, smooth lobes by a quadrature about each normal."""

    nodes: LightNodes
    lobes: SmoothLobes | None = None
    polar_nodes: int = eqx.field(static=True, default=48)

    def columns(self, brdf: BRDF, samples: SurfaceSamples) -> Float[Array, "sample lobe channel"]:
        """Sum over the nodes and integrate the lobes."""
        columns = integral_columns(brdf, samples, self.nodes)
        if self.lobes is None:
            return columns
        return columns + polar_columns(brdf, samples, self.lobes.radiance, self.polar_nodes)


def render_samples(
    brdf: BRDF, samples: SurfaceSamples, model: ForwardModel
) -> Float[np.ndarray, "sample channel"]:
    """Compute the radiance that every sample sends to the camera."""
    count = samples.normals.shape[0]
    channels = brdf.amplitudes.shape[1]
    found = np.zeros((count, channels))
    for first in range(0, count, _PIXELS_AT_ONCE):
        batch = [np.asarray(a)[first : first + _PIXELS_AT_ONCE] for a in samples]
        size = len(batch[0])
        short = ((0, _PIXELS_AT_ONCE - size), (0, 0))
        padded = SurfaceSamples(*(np.pad(a, short, mode="edge") for a in batch))
        found[first : first + size] = np.asarray(_reflect(brdf, padded, model))[:size]
    return found


def render_view(
    brdf: BRDF, view: SurfaceView, model: ForwardModel
) -> Float[np.ndarray, "row column channel"]:
    """Compute the image of a surface that is already traced; zero where the ray missed."""
    return render_views(brdf, [view], model)[0]


def render_views(
    brdf: BRDF, views: Sequence[SurfaceView], model: ForwardModel
) -> list[Float[np.ndarray, "row column channel"]]:
    """Compute the images of several views under one light, their pixels in common batches."""
    normals = np.concatenate([view.normals[view.hit] for view in views])
    outgoing = np.concatenate([view.outgoing[view.hit] for view in views])
    found = render_samples(brdf, SurfaceSamples(normals, outgoing), model)
    last = np.cumsum([np.count_nonzero(view.hit) for view in views])
    images = []
    for view, values in zip(views, np.split(found, last[:-1])):
        images.append(np.zeros((*view.hit.shape, found.shape[1])))
        images[-1][view.hit] = values
    return images


def render(
    brdf: BRDF, camera: Camera, shape: Shape, model: ForwardModel
) -> Float[np.ndarray, "row column channel"]:
    """Trace a shape from a camera and render it; zero where the ray missed."""
    return render_view(brdf, observe(camera, shape), model)


@eqx.filter_jit
def _reflect(
    brdf: BRDF, samples: SurfaceSamples, model: ForwardModel
) -> Float[Array, "sample channel"]:
    return radiance(brdf, model.columns(brdf, samples))
