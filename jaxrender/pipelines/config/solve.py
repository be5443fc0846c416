"""How the unknowns are found: band limit of the light, transfer, solver, loss, noise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Strict, Tag, model_validator

from jaxrender.pipelines.config.nuisances import Free
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
    """Highest degree of the light that is kept.  auto chooses it by the photographs."""
    model: Literal["dual", "azimuthal", "shrm"] = "dual"
    """The frequency model of slow light.  dual takes the lobe's mean about R.  azimuthal keeps the
    azimuth about R, for grazing pixels.  shrm does as a reflection map does."""
    view_degree: ViewDegree = _VIEW_DEGREE
    """P: the highest order about R of model azimuthal, or the viewer's degree of model shrm."""
    transfer: Literal["exit-cosine", "normal-exitance", "gaussian"] = "exit-cosine"
    """How the specular lobe filters each degree in model dual."""
    refine: Literal["exact", "off"] = "exact"
    """Whether the answer is refined with the exact reflection integral."""
    refine_samples: Count = 2000
    """Pixels of a capture that the refinement begins with.  It takes more where the light is a few
    sources, and where two halves of the pixels disagree."""
    method: Literal["variable-projection", "simplex"] = "variable-projection"
    """The search: variable-projection eliminates the linear part; simplex is the thesis's."""
    loss: Literal["auto", "squares", "huber", "cauchy"] = "auto"
    """How residuals count.  huber and cauchy are for photographs with outliers.  auto is squares
    under known light, and huber under unknown light."""
    noise: Noise = "estimate"
    """The noise of the photographs: estimate, or {relative, floor}."""
    starts: Count = 8
    """Starting points of the search."""
    free_exposure: Switch = False
    """Whether each photograph has an unknown exposure, which the fit finds."""
    most_sources: Count = 48
    """Largest number of directional sources in unknown light, beside its slow part."""
    variants: Switch = True
    """Whether the fit is repeated with other choices of the same model, for comparison."""
    free: Free = ()
    """Nuisances that are found with the material, by name, or auto: those that the diagnosis
    names."""
    diagnose: Switch = True
    """Whether the fit says what would explain what it leaves beyond noise."""
    held_out: OpenFraction = 0.2
    """Part of the samples that brdf.compare keeps out of the fits, to compare the models."""
    interreflection: Switch = False
    """Whether the fit models light that bounces between parts of a concave object (T 6.6)."""

    @model_validator(mode="after")
    def _names_what_it_frees(self) -> SolveConfig:
        if self.free == "auto" and not self.diagnose:
            raise ValueError(
                "free: auto frees what the diagnosis names; choose diagnose: true, or name what to "
                "free"
            )
        if "exposure" in self.free and self.free_exposure:
            raise ValueError(
                "free: [exposure] and free_exposure: true free the same; leave one of them out "
                "(the first has a prior of 5 percent)"
            )
        return self

    @property
    def transfer_name(self) -> str:
        """What the forward model calls the chosen filter."""
        return self.transfer if self.model == "dual" else f"{self.model}-{self.view_degree}"
