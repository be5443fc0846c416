"""The root of a run's config: one file says everything about a fit."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from jaxrender.pipelines.config.brdf import GLOSSY, BrdfConfig
from jaxrender.pipelines.config.capture import CaptureConfig
from jaxrender.pipelines.config.lighting import LightingConfig
from jaxrender.pipelines.config.samples import SamplesConfig
from jaxrender.pipelines.config.solve import SolveConfig
from jaxrender.pipelines.config.values import ConfigPath, Section


class RunConfig(Section):
    """A fit: what is known, what is asked, and how it is found."""

    task: Literal["brdf", "lighting", "factorize"]
    """What is recovered: the material, the light, or both."""
    capture: CaptureConfig
    """The photographs and the shape."""
    lighting: LightingConfig = LightingConfig()
    """The known light; left out where it is recovered, or with a recipe, whose own is then used."""
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
        recovers_light = self.task != "brdf"
        if recovers_light and self.lighting.given:
            raise ValueError(
                f"task {self.task} recovers the light; remove lighting, or choose task: brdf"
            )
        if not recovers_light and self.capture.recipe is None and not self.lighting.given:
            raise ValueError(
                "no light given; lighting needs one of environment, directional, per_frame"
            )
        return self

    @model_validator(mode="after")
    def _knows_what_its_task_needs(self) -> RunConfig:
        brdf = self.brdf
        if self.task == "brdf":
            return self
        if brdf.model == "lambertian":
            raise ValueError(
                f"task {self.task} reads the light off the gloss; choose model {GLOSSY}"
            )
        if self.solve.free_exposure:
            raise ValueError(f"task {self.task} needs known exposures; remove solve.free_exposure")
        amounts = {"kd": not brdf.kd.free, "ks": not brdf.ks.free}
        given = amounts | {"sigma": not brdf.sigma.free}
        given["mu"] = brdf.mu == "none" or not brdf.mu.free
        if self.task == "lighting" and not all(given.values()):
            missing = ", ".join(name for name, is_given in given.items() if not is_given)
            raise ValueError(
                f"task lighting needs a known material; fix {missing}, or choose task: factorize"
            )
        if self.task == "factorize" and len(set(amounts.values())) > 1:
            raise ValueError(
                "under unknown light only the ratio of kd and ks means anything; fix both or none"
            )
        return self
