"""The root of a run's config: one file says everything about a fit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import Field, model_validator

from jaxrender.catalogue import MODELS
from jaxrender.pipelines.config.brdf import BrdfConfig
from jaxrender.pipelines.config.capture import CaptureConfig
from jaxrender.pipelines.config.honoured import CASES
from jaxrender.pipelines.config.lighting import LightingConfig
from jaxrender.pipelines.config.samples import SamplesConfig
from jaxrender.pipelines.config.solve import SolveConfig
from jaxrender.pipelines.config.stated import Root
from jaxrender.pipelines.config.task_keys import MEANINGS
from jaxrender.pipelines.config.texture import SpectrumConfig, TextureConfig
from jaxrender.pipelines.config.values import ConfigPath

if TYPE_CHECKING:
    Task = str
else:
    Task = Literal[tuple(MEANINGS)]
_UNDER_KNOWN_LIGHT = ("brdf", "texture", "brdf-spectrum")


class RunConfig(Root):
    """A run: what is known, what is to be recovered, and how."""

    cases = CASES

    task: Task = Field(
        description="What the run recovers.  "
        + "  ".join(f"{task}: {what}." for task, what in MEANINGS.items())
    )
    capture: CaptureConfig
    """The photographs and the shape."""
    lighting: LightingConfig = LightingConfig()
    """The known light.  Leave it out to recover the light, or to use that of a recipe."""
    brdf: BrdfConfig = BrdfConfig()
    """The material model."""
    samples: SamplesConfig = SamplesConfig()
    """The pixels that take part."""
    solve: SolveConfig = SolveConfig()
    """The settings of the solver."""
    texture: TextureConfig | None = None
    """The settings of task texture."""
    spectrum: SpectrumConfig | None = None
    """The settings of task brdf-spectrum."""
    output: ConfigPath | None = None
    """Result folder; taken relative to the working directory."""

    @property
    def knows_light(self) -> bool:
        """Whether the light is known, from the config or from its recipe."""
        if self.task == "texture" and self.texture is not None and self.texture.unknown_light:
            return False
        known = self.lighting.given or self.capture.recipe is not None
        return known and self.task in _UNDER_KNOWN_LIGHT

    @model_validator(mode="after")
    def _knows_what_its_task_needs(self) -> RunConfig:
        if self.task in ("brdf", "brdf-spectrum") and not self.knows_light:
            raise ValueError(
                "no light given; lighting needs one of environment, directional, per_frame"
            )
        brdf, model = self.brdf, MODELS[self.brdf.model]
        known = {name: brdf.known(name) for name in model.names("amplitude", "searched")}
        given = {name: value is None or not value.free for name, value in known.items()}
        if self.task == "lighting" and not all(given.values()):
            missing = ", ".join(name for name, is_given in given.items() if not is_given)
            raise ValueError(
                f"task lighting needs a known material; fix {missing}, or choose task: factorize"
            )
        if self.task == "factorize" and given["kd"] and not model.has_specular:
            raise ValueError(
                "under unknown light a diffuse object shows only the product of light and kd; "
                "leave kd free, or choose task: lighting"
            )
        if self.task == "factorize" and given["kd"] != given.get("ks", given["kd"]):
            raise ValueError(
                "under unknown light only the ratio of kd and ks is identifiable; fix both or none"
            )
        return self
