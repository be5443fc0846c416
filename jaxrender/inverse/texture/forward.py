"""Forward models of chosen observations: who fits a texture asks for some of them at a time.

A ``ModelOf`` makes the model of the observations of given indices, so that millions of them never
need to be expanded at once, and shadows (which belong to single observations) stay in step.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse.models import Columns, ExactModel, Model, TabulatedModel
from jaxrender.inverse.observations import Observations
from jaxrender.lighting import LightNodes
from jaxrender.reflection import (
    DualLight,
    FrameNodes,
    Shadows,
    dual_columns,
    roughness_table,
)
from jaxrender.shapes import AnyArray, Array, Float, Int

ModelOf = Callable[[Int[np.ndarray, "kept"]], Model]


class Forward(NamedTuple):
    """Models of chosen observations: quick over a range of sigma, once at one sigma, and exact.

    ``search`` serves the search for sigma and mu, ``final`` the sites' materials once these are
    known, ``exact`` (where given) the refinement of sigma and mu.
    """

    search: ModelOf
    final: ModelOf
    exact: ModelOf | None = None


class DualModel(eqx.Module):
    """The dual model itself, shadows included: no table to make, slower to evaluate again."""

    variant: Microfacet
    samples: SurfaceSamples
    light: DualLight
    shadows: Shadows | None = None

    def columns(self, sigma: Float[Array, ""], mu: Float[Array, ""] | None) -> Columns:
        """Evaluate T 6.9, or T 6.12."""
        brdf = self.variant.with_roughness(sigma, None if self.variant.mu is None else mu)
        columns = dual_columns(brdf, self.samples, self.light, shadows=self.shadows)
        return Columns(columns[:, 0], columns[:, 1])

    def thinned(self, step: int) -> "DualModel":
        """Keep one in ``step`` samples."""
        count = self.samples.normals.shape[0]
        return _dual_model(
            self.variant, self.samples, self.light, (self.shadows, np.arange(0, count, step))
        )


def dual_forward(
    variant: Microfacet,
    observations: Observations,
    light: DualLight,
    sigma_range: tuple[float, float],
    shadows: Shadows | None = None,
) -> Forward:
    """Model observations by the dual model: a table for the search, unless there are shadows."""
    samples = observations.samples

    def final(index: Int[np.ndarray, "kept"]) -> Model:
        return _dual_model(variant, samples, light, (shadows, index))

    def search(index: Int[np.ndarray, "kept"]) -> Model:
        own = _light_of(light, index)
        table = roughness_table(variant, _taken(samples, index), own, sigma_range)
        return TabulatedModel(table)

    return Forward(search if shadows is None else final, final)


def exact_forward(
    variant: Microfacet,
    observations: Observations,
    nodes: tuple[LightNodes | FrameNodes, ...],
) -> ModelOf:
    """Model observations by the integral over a light's nodes."""

    def model_of(index: Int[np.ndarray, "kept"]) -> Model:
        own = tuple(
            part._replace(frame_of_sample=np.asarray(part.frame_of_sample)[index])
            if isinstance(part, FrameNodes)
            else part
            for part in nodes
        )
        return ExactModel(variant, _taken(observations.samples, index), own)

    return model_of


def _dual_model(
    variant: Microfacet,
    samples: SurfaceSamples,
    light: DualLight,
    chosen: tuple[Shadows | None, Int[np.ndarray, "kept"]],
) -> DualModel:
    shadows, index = chosen
    if shadows is not None:
        transfer, reflected, sources = (np.asarray(part)[index] for part in shadows[:3])
        by_frame = shadows.frame_sources
        by_frame = None if by_frame is None else np.asarray(by_frame)[index]
        shadows = Shadows(transfer, reflected, sources, by_frame)
    return DualModel(variant, _taken(samples, index), _light_of(light, index), shadows)


def _light_of(light: DualLight, index: AnyArray) -> DualLight:
    if light.frames is None:
        return light
    return light.for_frames(np.asarray(light.frames.frame_of_sample)[index])


def _taken(samples: SurfaceSamples, index: Int[np.ndarray, "kept"]) -> SurfaceSamples:
    return SurfaceSamples(*(np.asarray(part)[index] for part in samples))
