"""How the unknowns are found: light's band limit, transfer, solver, loss, noise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Strict, Tag, model_validator

from jaxrender.pipelines.config.values import (
    Accepts,
    Count,
    NonNegative,
    OpenFraction,
    Section,
    Switch,
    WholeNumber,
)


class NoiseConfig(Section):
    """A given noise model: standard deviation sqrt((relative radiance)^2 + floor^2)."""

    relative: NonNegative = 0.0
    """Part proportional to radiance."""
    floor: NonNegative = 0.0
    """Constant part, in radiance."""

    @model_validator(mode="after")
    def _not_free_of_noise(self) -> NoiseConfig:
        if self.relative == 0 and self.floor == 0:
            raise ValueError("relative and floor are both 0; give one above 0, or noise: estimate")
        return self


def _kind(value: Any) -> str:
    return "<given>" if isinstance(value, Mapping | NoiseConfig) else "<word>"


Noise = Annotated[
    Annotated[Literal["estimate"], Tag("<word>")] | Annotated[NoiseConfig, Tag("<given>")],
    Discriminator(_kind),
]


ViewDegree = Annotated[int, Strict(), Field(ge=0, le=12), Accepts("a whole number from 0 to 12")]
_VIEW_DEGREE = 4


class SolveConfig(Section):
    """Settings of the solver."""

    band_limit: Literal["auto"] | WholeNumber = "auto"
    """Highest degree of the light that is kept."""
    model: Literal["dual", "azimuthal", "shrm"] = "dual"
    """The frequency model of slow light: the lobe's mean about R, its azimuth too, or a reflection
    map's."""
    view_degree: ViewDegree = _VIEW_DEGREE
    """P, the highest order about R, and degree of the viewer, of models azimuthal and shrm."""
    transfer: Literal["exit-cosine", "normal-exitance", "gaussian"] = "exit-cosine"
    """How the specular lobe filters each degree, of model dual."""
    refine: Literal["exact", "off"] = "exact"
    """Whether the answer is refined with the exact reflection integral."""
    refine_samples: Count = 2000
    """Pixels that the refinement begins with: it takes more where the light is a few sources, and
    where two halves of them disagree."""
    method: Literal["variable-projection", "simplex"] = "variable-projection"
    """The search: linear part eliminated, or the thesis's simplex."""
    loss: Literal["auto", "squares", "huber", "cauchy"] = "auto"
    """How residuals count: auto is squares, but huber where the light is found along."""
    noise: Noise = "estimate"
    """The noise of the photographs: estimate, or {relative, floor}."""
    starts: Count = 8
    """Starting points of the search."""
    free_exposure: Switch = False
    """Whether each photograph has an unknown exposure."""
    most_sources: Count = 48
    """Directional sources that unknown light may have, beside its slow part."""
    variants: Switch = True
    """Whether the answer is compared with those of other choices of the same model."""
    held_out: OpenFraction = 0.2
    """Part of the samples that brdf.compare keeps from the fits, to judge them by."""
    interreflection: Switch = False
    """Whether light that bounces between parts of a concave diffuse object is modelled."""

    @property
    def transfer_name(self) -> str:
        """What the forward model calls the chosen filter."""
        return self.transfer if self.model == "dual" else f"{self.model}-{self.view_degree}"
