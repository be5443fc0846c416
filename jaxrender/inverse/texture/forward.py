"""Forward models of chosen observations, since a texture is fitted a part at a time.

A ``ModelOf`` makes the model of the observations of given indices.  So millions of observations
need not be expanded at once, and every observation keeps its own shadows.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse.models import DualModel, ExactModel, Model, TabulatedModel
from jaxrender.inverse.observations import Observations
from jaxrender.lighting import LightNodes
from jaxrender.reflection import (
    DualLight,
    FrameNodes,
    Shadows,
    roughness_table,
)
from jaxrender.shapes import Int

ModelOf = Callable[[Int[np.ndarray, "kept"]], Model]


class Forward(NamedTuple):
    """Models of chosen observations: quick over a range of sigma, once at one sigma, and exact.

    ``search`` serves the search for sigma and mu, ``final`` the sites' materials once these are
    known, ``exact`` (where given) the refinement of sigma and mu.
    """

    search: ModelOf
    final: ModelOf
    exact: ModelOf | None = None


def dual_forward(
    variant: Microfacet,
    observations: Observations,
    light: DualLight,
    sigma_range: tuple[float, float],
    shadows: Shadows | None = None,
) -> Forward:
    """Model observations by the dual model: a table for the search, unless there are shadows."""
    final = DualModel(variant, observations.samples, light, shadows).take

    def search(index: Int[np.ndarray, "kept"]) -> Model:
        own = final(index)
        table = roughness_table(variant, own.samples, own.light, sigma_range)
        return TabulatedModel(variant, table)

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


def _taken(samples: SurfaceSamples, index: Int[np.ndarray, "kept"]) -> SurfaceSamples:
    return SurfaceSamples(*(np.asarray(part)[index] for part in samples))
