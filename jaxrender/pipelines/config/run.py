"""The root of a run's config: one file says everything about a fit."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from jaxrender.pipelines.config.brdf import BrdfConfig
from jaxrender.pipelines.config.capture import CaptureConfig
from jaxrender.pipelines.config.lighting import LightingConfig
from jaxrender.pipelines.config.samples import SamplesConfig
from jaxrender.pipelines.config.solve import SolveConfig
from jaxrender.pipelines.config.values import ConfigPath, Section


class RunConfig(Section):
    """A fit: what is known, what is asked, and how it is found."""

    task: Literal["brdf"]
    """What is recovered."""
    capture: CaptureConfig
    """The photographs and the shape."""
    lighting: LightingConfig = LightingConfig()
    """The known light; may be left out with a recipe, whose own light is then used."""
    brdf: BrdfConfig = BrdfConfig()
    """The material model."""
    samples: SamplesConfig = SamplesConfig()
    """Which pixels take part."""
    solve: SolveConfig = SolveConfig()
    """How the unknowns are found."""
    output: ConfigPath | None = None
    """Result folder; taken relative to the working directory."""

    @model_validator(mode="after")
    def _has_light(self) -> RunConfig:
        if self.capture.recipe is None and not self.lighting.given:
            raise ValueError(
                "no light given; lighting needs one of environment, directional, per_frame"
            )
        return self
