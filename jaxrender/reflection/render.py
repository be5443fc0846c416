"""Camera to image, with any forward model.

Pixels are worked off in batches of one size, so that a single compiled program serves every
photograph whatever the object covers of it.  A ``ShadowedModel`` traces each batch's shadows before
it is reflected; the other models are those of convex shapes and cast none.

On the host the images are NumPy arrays, filled batch by batch.  Under ``jit``, ``vmap`` and
``grad`` they are traced arrays, differentiable in the material, the light and the normals; what is
seen, and where shadows fall, is fixed beforehand.
"""

import abc
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

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
from jaxrender.programs import stored
from jaxrender.reflection.dual import DualLight, Shadows, cast_shadows, dual_columns
from jaxrender.reflection.integral import integral_columns, polar_columns, radiance
from jaxrender.reflection.polar_nodes import polar_nodes_for
from jaxrender.shapes import AnyArray, Array, Bool, Float, checked

_PIXELS_AT_ONCE = 4096
# Few pixels are filled up to a power of two, not below this one.
_LEAST_AT_ONCE = 256
# Pixels times nodes whose visibility is held at once, a byte each.
_MOST_PAIRS = 2**26

Material = TypeVar("Material", bound=BRDF)


class ForwardModel(eqx.Module):
    """A light and a way to reflect it."""

    @abc.abstractmethod
    def columns(self, brdf: BRDF, samples: SurfaceSamples) -> Float[Array, "sample lobe channel"]:
        """Evaluate the radiance of each lobe at amplitude one."""

    def settled(self, brdf: BRDF) -> "ForwardModel":
        """Fix what depends on a BRDF whose numbers are known, before a program is compiled."""
        return self


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
    """The integral: point masses summed, smooth lobes by a quadrature about each normal.

    ``polar_nodes=None``: as many as the BRDF's width asks for, as ``polar_columns`` says.
    """

    nodes: LightNodes
    lobes: SmoothLobes | None = None
    polar_nodes: int | None = eqx.field(static=True, default=None)

    def columns(self, brdf: BRDF, samples: SurfaceSamples) -> Float[Array, "sample lobe channel"]:
        """Sum over the nodes and integrate the lobes."""
        columns = integral_columns(brdf, samples, self.nodes)
        if self.lobes is None:
            return columns
        return columns + polar_columns(brdf, samples, self.lobes.radiance, self.polar_nodes)

    def settled(self, brdf: BRDF) -> "ExactForward":
        """Choose the nodes by the BRDF's width, unless they are given or nothing needs them."""
        if self.lobes is None or self.polar_nodes is not None or is_traced(brdf):
            return self
        return ExactForward(self.nodes, self.lobes, polar_nodes_for(brdf))


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


@checked
def render_samples(
    brdf: BRDF,
    samples: SurfaceSamples,
    model: ForwardModel | ShadowedModel,
    places: SurfacePlaces | None = None,
) -> Float[AnyArray, "sample channel"]:
    """Compute the radiance that every sample sends to the camera.

    A model with shadows must know the samples' places (ValueError without).
    """
    return in_batches(_reflect, brdf, samples, model, brdf.amplitudes.shape[1:], places)


def in_batches(
    function: Callable[[Material, SurfaceSamples, ForwardModel], Float[Array, "step *rest"]],
    brdf: Material,
    samples: SurfaceSamples,
    model: ForwardModel | ShadowedModel,
    shape: tuple[int, ...],
    places: SurfacePlaces | None = None,
) -> Float[AnyArray, "sample *rest"]:
    """Call a compiled function for one batch of samples after the other.

    ``shape`` is that of its values for one sample.  Raises ``ValueError`` as ``batches`` does.
    """
    traced = is_traced(brdf, samples, model)
    if isinstance(model, ForwardModel):
        model = model.settled(brdf)
    if traced:
        return _traced_in_batches(function, brdf, samples, model, shape, places)
    found = np.zeros((samples.normals.shape[0], *shape))
    for rows, batch, lit in batches(samples, model, places):
        found[rows] = np.asarray(function(brdf, batch, lit))[: rows.stop - rows.start]
    return found


def is_traced(*arguments) -> bool:
    """Whether some of the numbers are not known yet."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(arguments))


def _traced_in_batches(
    function: Callable[[Material, SurfaceSamples, ForwardModel], Float[Array, "step *rest"]],
    brdf: Material,
    samples: SurfaceSamples,
    model: ForwardModel | ShadowedModel,
    shape: tuple[int, ...],
    places: SurfacePlaces | None,
) -> Float[Array, "sample *rest"]:
    """Map over the batches within the program that is being compiled."""
    count = samples.normals.shape[0]
    if count == 0:
        return jnp.zeros((0, *shape), jnp.result_type(brdf.amplitudes))
    some = [(batch, lit) for _, batch, lit in batches(samples, model, places)]
    if len(some) == 1:
        return function(brdf, *some[0])[:count]
    # Most of a light is the same for all batches; what differs is mapped over.
    leaves, structures = zip(*(jax.tree.flatten(pair) for pair in some))
    columns = list(zip(*leaves))
    shared = [all(leaf is column[0] for leaf in column) for column in columns]
    own = [jnp.stack(column) for column, same in zip(columns, shared) if not same]

    # What a batch needs for its derivative is computed again: memory for one batch suffices.
    @jax.checkpoint
    def one(own: list[Array]) -> Array:
        rest = iter(own)
        merged = [leaf if same else next(rest) for leaf, same in zip(leaves[0], shared)]
        return function(brdf, *structures[0].unflatten(merged))

    return jax.lax.map(one, own).reshape(-1, *shape)[:count]


class Batch(NamedTuple):
    """Some samples with the model of their light; ``rows`` says which of all they are."""

    rows: slice
    samples: SurfaceSamples
    model: ForwardModel


def batches(
    samples: SurfaceSamples,
    model: ForwardModel | ShadowedModel,
    places: SurfacePlaces | None = None,
) -> Iterator[Batch]:
    """Cut samples into batches of one size, the last filled up, each with its model.

    A model with shadows must know the samples' places,
    and what its rays meet is found on the host: ValueError without places, and for normals that
    are traced.
    """
    if isinstance(model, ShadowedModel):
        if places is None:
            raise ValueError("shadows need to know where the samples lie: give their places")
        if is_traced(samples, places):
            raise ValueError(
                "rays of shadows are traced on the host: give normals and places as NumPy arrays, "
                "or differentiate a model without shadows by them"
            )
    count = samples.normals.shape[0]
    step = min(_batch_size(model), max(_LEAST_AT_ONCE, 2 ** (count - 1).bit_length()))
    for first in range(0, count, step):
        batch = SurfaceSamples(*(_batch(a, first, step) for a in samples))
        lit = model
        if isinstance(lit, ShadowedModel):
            where = (np.asarray(_batch(a, first, step)) for a in places or ())
            lit = lit.at(SurfacePlaces(*where), batch)
        yield Batch(slice(first, min(first + step, count)), batch, lit)


def _batch_size(model: ForwardModel | ShadowedModel) -> int:
    if not isinstance(model, ShadowedModel):
        return _PIXELS_AT_ONCE
    return max(1, min(_PIXELS_AT_ONCE, _MOST_PAIRS // max(1, model.rays)))


def _batch(rows: Float[AnyArray, "sample 3"], first: int, step: int) -> Float[AnyArray, "step 3"]:
    """Take ``step`` rows, the last one repeated where there are fewer."""
    if isinstance(rows, Tracer):
        return rows[np.minimum(np.arange(first, first + step), rows.shape[0] - 1)]
    some = np.asarray(rows)[first : first + step]
    return np.pad(some, ((0, step - len(some)), (0, 0)), mode="edge")


@checked
def render_view(
    brdf: BRDF, view: SurfaceView, model: ForwardModel | ShadowedModel
) -> Float[AnyArray, "row column channel"]:
    """Compute the image of a surface that is already traced; zero where the ray missed.

    A view whose ``normals`` or ``outgoing`` are traced arrays is differentiable by them.
    """
    return render_views(brdf, [view], model)[0]


def render_views(
    brdf: BRDF, views: Sequence[SurfaceView], model: ForwardModel | ShadowedModel
) -> list[Float[AnyArray, "row column channel"]]:
    """Compute the images of several views under one light, their pixels in common batches."""
    places = SurfacePlaces.of_views(views)
    found = render_samples(brdf, samples_of_views(views), model, places)
    last = np.cumsum([np.count_nonzero(view.hit) for view in views])
    numbers = np if isinstance(found, np.ndarray) else jnp
    parts = numbers.split(found, last[:-1])
    return [_image(view.hit, values) for view, values in zip(views, parts)]


def samples_of_views(views: Sequence[SurfaceView]) -> SurfaceSamples:
    """Gather the pixels that hit the surface, view after view, row by row."""
    numbers = jnp if is_traced(*views) else np
    return SurfaceSamples(
        numbers.concatenate([view.normals[view.hit] for view in views]),
        numbers.concatenate([view.outgoing[view.hit] for view in views]),
    )


def _image(
    hit: Bool[np.ndarray, "row column"], values: Float[AnyArray, "pixel channel"]
) -> Float[AnyArray, "row column channel"]:
    """Put the values of the pixels that are hit where they belong."""
    shape = (*hit.shape, values.shape[1])
    if not isinstance(values, np.ndarray):
        return jnp.zeros(shape, values.dtype).at[np.nonzero(hit)].set(values)
    image = np.zeros(shape)
    image[hit] = values
    return image


def render(
    brdf: BRDF, camera: Camera, shape: Shape, model: ForwardModel | ShadowedModel
) -> Float[AnyArray, "row column channel"]:
    """Trace a shape from a camera and render it; zero where the ray missed."""
    return render_view(brdf, observe(camera, shape), model)


@stored()
def _reflect(
    brdf: BRDF, samples: SurfaceSamples, model: ForwardModel
) -> Float[Array, "sample channel"]:
    return radiance(brdf, model.columns(brdf, samples))
