"""Forward models behind the one interface that a search asks of them: columns of amplitudes.

A lobe is asked for by the model's own numbers, by name (``Parametric.searched``).
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Protocol, TypeVar, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.brdf import Glossy, Parametric, normalised_fresnel
from jaxrender.geometry import SurfaceSamples
from jaxrender.lighting import LightNodes
from jaxrender.programs import stored
from jaxrender.reflection import (
    DualLight,
    FrameNodes,
    RoughnessTable,
    Shadows,
    dual_columns,
    integral_columns,
    integral_columns_by_frame,
)
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int, as_jax

Lobe = TypeVar("Lobe", bound=Parametric)
# The numbers of a lobe; some models take a width for each sample.
Numbers = Mapping[str, Float[Array, "*sample"]]
# Which samples to keep: their indices, or every so many.
Rows = Int[np.ndarray, "kept"] | slice


class Columns(eqx.Module):
    """What each lobe reflects at amplitude one, in the order of the model's amplitudes.

    Of most models these are the columns of kd and ks.  ``shaped`` are the places of the lobes that
    the model's numbers shape; all but the first, which is a base, where nothing else is said.
    """

    parts: tuple[Float[AnyArray, "sample channel"], ...]
    shaped: tuple[int, ...] = eqx.field(static=True)

    def __init__(
        self, *parts: Float[AnyArray, "sample channel"], shaped: tuple[int, ...] | None = None
    ):
        self.parts = parts
        self.shaped = tuple(range(1, len(parts))) if shaped is None else shaped

    def __iter__(self) -> Iterator[Float[AnyArray, "sample channel"]]:
        return iter(self.parts)

    def __len__(self) -> int:
        return len(self.parts)

    @property
    def diffuse(self) -> Float[AnyArray, "sample channel"]:
        """The column of a model's base."""
        return self.parts[0]

    @property
    def specular(self) -> Float[AnyArray, "sample channel"]:
        """The column of the lobe over the base."""
        return self.parts[1]

    def map(self, change: Callable) -> "Columns":
        """Change every column alike."""
        return Columns(*map(change, self.parts), shaped=self.shaped)

    def times(self, amplitudes: Float[Array, "lobe channel"]) -> Float[Array, "sample channel"]:
        """Add up what the lobes reflect at given amplitudes."""
        # One after the other: the order of the sum is the order of the lobes.
        total = amplitudes[0][None, :] * self.parts[0]
        for amplitude, part in zip(amplitudes[1:], self.parts[1:]):
            total = total + amplitude[None, :] * part
        return total

    def times_on_host(
        self, amplitudes: Iterable[Float[AnyArray, "channel"]]
    ) -> Float[np.ndarray, "sample channel"]:
        """Add up the same by NumPy, which needs no program."""
        each = zip(amplitudes, self.parts, strict=True)
        return np.sum([np.asarray(a, float)[None] * np.asarray(part) for a, part in each], axis=0)


@runtime_checkable
class Model(Protocol):
    """What a fit asks of a forward model."""

    def columns(self, numbers: Numbers) -> Columns:
        """Evaluate the column of each amplitude for given numbers of the model.

        Some models take a width for each sample.
        """
        ...

    def take(self, index: Rows) -> "Model":
        """Keep the samples of the given indices."""
        ...


class TabulatedModel(eqx.Module):
    """The dual model of ``variant`` (whatever its numbers) through its table over the width."""

    variant: Glossy
    table: RoughnessTable

    def columns(self, numbers: Numbers) -> Columns:
        """Look up the columns."""
        lobe = self.variant.with_numbers(numbers)
        mu = None if lobe.mu is None else jnp.asarray(lobe.mu)
        specular = self.table.specular(jnp.asarray(lobe.sigma), mu)
        return Columns(jnp.asarray(self.table.diffuse), specular)

    def take(self, index: Rows) -> "TabulatedModel":
        """Keep the samples of the given indices."""
        return TabulatedModel(self.variant, self.table.take(index))


class DualModel(eqx.Module):
    """The dual model itself, shadows included: no table to make, slower to evaluate again."""

    variant: Glossy
    samples: SurfaceSamples
    light: DualLight
    shadows: Shadows | None = None
    transfer: str = eqx.field(static=True, default="exit-cosine")

    def columns(self, numbers: Numbers) -> Columns:
        """Evaluate T 6.9, or T 6.12; with the transfer ``facets`` for a width a sample, too."""
        lobe, widths = _lobe_and_widths(self.variant, numbers)
        columns = dual_columns(
            lobe, self.samples, self.light, self.transfer, self.shadows, widths=widths
        )
        return Columns(columns[:, 0], columns[:, 1])

    def take(self, index: Rows) -> "DualModel":
        """Keep the samples of the given indices."""
        light, shadows = self.light, self.shadows
        if light.frames is not None:
            light = light.for_frames(np.asarray(light.frames.frame_of_sample)[index])
        if shadows is not None:
            shadows = Shadows(*jax.tree.map(lambda part: np.asarray(part)[index], shadows))
        samples = SurfaceSamples(*(np.asarray(part)[index] for part in self.samples))
        return DualModel(self.variant, samples, light, shadows, self.transfer)


class ExactModel(eqx.Module):
    """The integral over the light's nodes, for the lobe of ``variant`` (whatever its numbers).

    ``seen`` tells for each part of the light which of its nodes every sample sees; None: all.
    """

    variant: Parametric
    samples: SurfaceSamples
    nodes: tuple[LightNodes | FrameNodes, ...]
    seen: tuple[Bool[AnyArray, "sample node"], ...] | None = None

    def columns(self, numbers: Numbers) -> Columns:
        """Integrate; a Fresnel ratio at the exit angle is a factor and stays outside the sum."""
        lobe, widths = _lobe_and_widths(self.variant, numbers)
        outside = lobe.fresnel_is_factor and lobe.mu is not None
        columns = self._integrate(lobe.as_metal() if outside else lobe, widths)
        parts = [columns[:, at] for at in range(columns.shape[1])]
        if outside:
            ratio = normalised_fresnel(lobe.mu, self.samples.exit_cosines)[:, None]
            for at in lobe.shaped():
                parts[at] = parts[at] * ratio
        return Columns(*parts, shaped=lobe.shaped())

    def take(self, index: Rows) -> "ExactModel":
        """Keep the samples of the given indices."""
        samples = SurfaceSamples(*(a[index] for a in self.samples))
        nodes = tuple(
            FrameNodes(part.directions, part.irradiance, part.frame_of_sample[index])
            if isinstance(part, FrameNodes)
            else part
            for part in self.nodes
        )
        seen = None if self.seen is None else tuple(part[index] for part in self.seen)
        return ExactModel(self.variant, samples, nodes, seen)

    def _integrate(
        self, lobe: Parametric, widths: Float[Array, "sample"] | None
    ) -> Float[Array, "sample lobe channel"]:
        """Sum over the lights that all photographs share and over those of each frame."""
        parts = [
            columns_under(lobe, self.samples, part, seen, widths)
            for part, seen in zip(self.nodes, self.seen or [None] * len(self.nodes))
        ]
        return jnp.sum(jnp.stack(parts), axis=0)


def columns_under(
    lobe: Parametric,
    samples: SurfaceSamples,
    nodes: LightNodes | FrameNodes,
    seen: Bool[AnyArray, "sample node"] | None = None,
    widths: Float[AnyArray, "sample"] | None = None,
) -> Float[Array, "sample lobe channel"]:
    """Sum each lobe over one part of a light: of all photographs, or of each its own."""
    if isinstance(nodes, FrameNodes):
        return integral_columns_by_frame(lobe, samples, nodes, seen, widths=widths)
    return integral_columns(lobe, samples, nodes, seen, widths=widths)


class DiffuseModel(eqx.Module):
    """A model of a base and a lobe that is dark: a diffuse material."""

    model: Model

    def columns(self, numbers: Numbers) -> Columns:
        """Evaluate the diffuse column alone."""
        diffuse = self.model.columns(numbers).diffuse
        return Columns(diffuse, jnp.zeros_like(diffuse))

    def take(self, index: Rows) -> "DiffuseModel":
        """Keep the samples of the given indices."""
        return DiffuseModel(self.model.take(index))


class LinearisedModel(eqx.Module):
    """Any model to first order about some of its numbers: what error bars are made of.

    ``slopes`` are, for each of the numbers that vary, the derivatives of the columns ``at.shaped``
    by it.  A width may be one for each sample, where the model takes that.
    """

    at: Columns
    slopes: dict[str, tuple[Float[AnyArray, "sample channel"], ...]]
    numbers: dict[str, Float[Array, "*sample"]]

    @classmethod
    def about(
        cls, model: Model, numbers: Numbers, by: Iterable[str] | None = None
    ) -> "LinearisedModel":
        """Evaluate a model once, and its derivatives ``by`` some of its numbers; None: by all."""
        return _linearise(model, dict(numbers), tuple(numbers if by is None else by))

    def columns(self, numbers: Numbers) -> Columns:
        """Extrapolate the columns linearly."""
        parts = list(self.at)
        for name, slopes in self.slopes.items():
            step = numbers[name] - self.numbers[name]
            for at, slope in zip(self.at.shaped, slopes):
                parts[at] = parts[at] + slope * (step[:, None] if jnp.ndim(step) else step)
        return Columns(*parts, shaped=self.at.shaped)

    def take(self, index: Rows) -> "LinearisedModel":
        """Keep the samples of the given indices."""

        def kept(rows: Float[AnyArray, "sample *channel"]) -> Float[Array, "kept *channel"]:
            # On the host: every number of samples would be some more programs to compile.
            return rows[index] if isinstance(rows, Tracer) else as_jax(np.asarray(rows)[index])

        return LinearisedModel(
            self.at.map(kept),
            {name: tuple(map(kept, slopes)) for name, slopes in self.slopes.items()},
            {name: kept(v) if jnp.ndim(v) else v for name, v in self.numbers.items()},
        )

    def gathered(self, names: Iterable[str]) -> tuple[Float[AnyArray, "sample channel"], ...]:
        """Line up the columns, and then the derivatives by the given numbers.

        By what does not vary they are zero.
        """
        shaped = [self.at.parts[at] for at in self.at.shaped]
        slopes = (self.slopes.get(name) or map(jnp.zeros_like, shaped) for name in names)
        return (*self.at, *(slope for each in slopes for slope in each))


def _lobe_and_widths(variant: Lobe, numbers: Numbers) -> tuple[Lobe, Float[Array, "sample"] | None]:
    """Give a kind of lobe its numbers; and the widths of all samples, where each has its own."""
    lobe = variant.with_numbers({n: v[0] if jnp.ndim(v) else v for n, v in numbers.items()})
    width = numbers.get(variant.shape.name)
    each = width is not None and jnp.ndim(width)
    return lobe, variant.shape.width_of(width) if each else None


@stored(effort="less")
def _linearise(
    model: Model, numbers: dict[str, Float[Array, "*sample"]], names: tuple[str, ...]
) -> LinearisedModel:
    if len(names) > 1:
        # All derivatives in one pass over the nodes, which each alone would make again.
        def shaped_at(
            off: Float[Array, "number"],
        ) -> tuple[list[Float[AnyArray, "sample channel"]], Columns]:
            moved = {name: numbers[name] + step for name, step in zip(names, off)}
            columns = model.columns({**numbers, **moved})
            return [columns.parts[place] for place in columns.shaped], columns

        dtype = jnp.result_type(*(numbers[name] for name in names))
        slopes, columns = jax.jacfwd(shaped_at, has_aux=True)(jnp.zeros(len(names), dtype))
        by_name = {
            name: tuple(slope[..., place] for slope in slopes) for place, name in enumerate(names)
        }
        return LinearisedModel(columns, by_name, numbers)
    columns = model.columns(numbers)
    by_name = {}
    for name in names:
        value = numbers[name]

        def moved(to: Float[Array, "*sample"], name: str = name) -> Columns:
            return model.columns({**numbers, name: to})

        slopes = jax.jvp(moved, (value,), (jnp.ones_like(value),))[1]
        by_name[name] = tuple(slopes.parts[place] for place in columns.shaped)
    return LinearisedModel(columns, by_name, numbers)
