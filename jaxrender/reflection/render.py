"""Camera to image, with any forward model.

Pixels are worked off in batches of one size, so that a single compiled program serves every
photograph whatever the object covers of it.  A ``ShadowedModel`` traces each batch's shadows before
it is reflected; the other models are those of convex shapes and cast none.
"""

import abc
from collections.abc import Callable, Iterator, Sequence

import equinox as eqx
import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.geometry import (
    Camera,
    Shape,
    SurfacePlaces,
    SurfaceSamples,
    SurfaceView,
    observe,
    visible,
)
from jaxrender.lighting import LightNodes, SmoothLobes
from jaxrender.reflection.dual import DualLight, Shadows, cast_shadows, dual_columns
from jaxrender.reflection.integral import integral_columns, polar_columns, radiance
from jaxrender.shapes import AnyArray, Array, Bool, Float

_PIXELS_AT_ONCE = 4096
# Few pixels are filled up to a power of two, not below this one.
_LEAST_AT_ONCE = 256
# Pixels times nodes whose visibility is held at once, a byte each.
_MOST_PAIRS = 2**26


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


class _DarkenedDual(ForwardModel):
    """The dual model of T 6.12 for certain samples, whose shadows are known."""

    light: DualLight
    shadows: Shadows

    def columns(self, brdf: BRDF, samples: SurfaceSamples) -> Float[Array, "sample lobe channel"]:
        """Evaluate T 6.12."""
        return dual_columns(brdf, samples, self.light, shadows=self.shadows)


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


class _SeenForward(ForwardModel):
    """The sum over the nodes that each of certain samples sees."""

    nodes: LightNodes
    seen: Bool[AnyArray, "sample node"]

    def columns(self, brdf: BRDF, samples: SurfaceSamples) -> Float[Array, "sample lobe channel"]:
        """Sum over the visible nodes."""
        return integral_columns(brdf, samples, self.nodes, self.seen)


class ShadowedModel(eqx.Module):
    """A light, and a shape that hides parts of it from itself."""

    @abc.abstractmethod
    def at(self, places: SurfacePlaces, samples: SurfaceSamples) -> ForwardModel:
        """Trace what the samples at these places see, and make their model."""

    @property
    @abc.abstractmethod
    def rays(self) -> int:
        """How many directions each place is asked about."""


class ShadowedForward(ShadowedModel):
    """The integral with visibility: the sum over the nodes that a shape does not hide."""

    shape: Shape
    nodes: LightNodes

    def at(self, places: SurfacePlaces, samples: SurfaceSamples) -> ForwardModel:
        """Trace what these places see, and make the model of their samples."""
        return _SeenForward(self.nodes, visible(self.shape, places, self.nodes.directions))

    @property
    def rays(self) -> int:
        """One a node."""
        return self.nodes.directions.shape[0]


class ShadowedDual(ShadowedModel):
    """The dual model of T 6.12; ``transfer_at`` gives the transfer vectors of any samples."""

    shape: Shape
    light: DualLight
    transfer_at: Callable[[SurfacePlaces, np.ndarray], Float[np.ndarray, "sample coefficient"]]

    def at(self, places: SurfacePlaces, samples: SurfaceSamples) -> ForwardModel:
        """Trace reflected rays and those to the sources, and make the model of the samples."""
        transfer = self.transfer_at(places, np.asarray(samples.normals))
        return _DarkenedDual(
            self.light, cast_shadows(self.shape, places, samples, self.light, transfer)
        )

    @property
    def rays(self) -> int:
        """One a source, and the reflected one."""
        return 1 + self.light.sources.directions.shape[0]


def render_samples(
    brdf: BRDF,
    samples: SurfaceSamples,
    model: ForwardModel | ShadowedModel,
    places: SurfacePlaces | None = None,
) -> Float[np.ndarray, "sample channel"]:
    """Compute the radiance that every sample sends to the camera.

    A model with shadows must know the samples' places (ValueError without).
    """
    found = np.zeros((samples.normals.shape[0], brdf.amplitudes.shape[1]))
    for rows, batch, lit in batches(samples, model, places):
        found[rows] = np.asarray(_reflect(brdf, batch, lit))[: rows.stop - rows.start]
    return found


def batches(
    samples: SurfaceSamples,
    model: ForwardModel | ShadowedModel,
    places: SurfacePlaces | None = None,
) -> Iterator[tuple[slice, SurfaceSamples, ForwardModel]]:
    """Cut samples into batches of one size, the last filled up, each with its model.

    The slice says which samples a batch holds.  A model with shadows must know the samples' places
    (ValueError without).
    """
    if isinstance(model, ShadowedModel) and places is None:
        raise ValueError("shadows need to know where the samples lie: give their places")
    count = samples.normals.shape[0]
    step = min(_batch_size(model), max(_LEAST_AT_ONCE, 2 ** (count - 1).bit_length()))
    for first in range(0, count, step):
        batch = SurfaceSamples(*(_batch(a, first, step) for a in samples))
        lit = model
        if isinstance(lit, ShadowedModel):
            lit = lit.at(SurfacePlaces(*(_batch(a, first, step) for a in places or ())), batch)
        yield slice(first, min(first + step, count)), batch, lit


def _batch_size(model: ForwardModel | ShadowedModel) -> int:
    if not isinstance(model, ShadowedModel):
        return _PIXELS_AT_ONCE
    return max(1, min(_PIXELS_AT_ONCE, _MOST_PAIRS // max(1, model.rays)))


def _batch(rows: Float[AnyArray, "sample 3"], first: int, step: int) -> Float[np.ndarray, "step 3"]:
    """Take ``step`` rows, the last one repeated where there are fewer."""
    some = np.asarray(rows)[first : first + step]
    return np.pad(some, ((0, step - len(some)), (0, 0)), mode="edge")


def render_view(
    brdf: BRDF, view: SurfaceView, model: ForwardModel | ShadowedModel
) -> Float[np.ndarray, "row column channel"]:
    """Compute the image of a surface that is already traced; zero where the ray missed."""
    return render_views(brdf, [view], model)[0]


def render_views(
    brdf: BRDF, views: Sequence[SurfaceView], model: ForwardModel | ShadowedModel
) -> list[Float[np.ndarray, "row column channel"]]:
    """Compute the images of several views under one light, their pixels in common batches."""
    normals = np.concatenate([view.normals[view.hit] for view in views])
    outgoing = np.concatenate([view.outgoing[view.hit] for view in views])
    samples, places = SurfaceSamples(normals, outgoing), SurfacePlaces.of_views(views)
    found = render_samples(brdf, samples, model, places)
    last = np.cumsum([np.count_nonzero(view.hit) for view in views])
    images = []
    for view, values in zip(views, np.split(found, last[:-1])):
        images.append(np.zeros((*view.hit.shape, found.shape[1])))
        images[-1][view.hit] = values
    return images


def render(
    brdf: BRDF, camera: Camera, shape: Shape, model: ForwardModel | ShadowedModel
) -> Float[np.ndarray, "row column channel"]:
    """Trace a shape from a camera and render it; zero where the ray missed."""
    return render_view(brdf, observe(camera, shape), model)


@eqx.filter_jit
def _reflect(
    brdf: BRDF, samples: SurfaceSamples, model: ForwardModel
) -> Float[Array, "sample channel"]:
    return radiance(brdf, model.columns(brdf, samples))
