"""The root of a run's config: one file says everything about a fit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pydantic import Field, model_validator

from jaxrender.pipelines.config.brdf import BrdfConfig
from jaxrender.pipelines.config.capture import CaptureConfig, FurtherCaptureConfig
from jaxrender.pipelines.config.honoured import CASES
from jaxrender.pipelines.config.lighting import LightingConfig
from jaxrender.pipelines.config.samples import SamplesConfig
from jaxrender.pipelines.config.solve import SolveConfig
from jaxrender.pipelines.config.stated import Root
from jaxrender.pipelines.config.tasks import TASKS
from jaxrender.pipelines.config.texture import SpectrumConfig, TextureConfig
from jaxrender.pipelines.config.values import ConfigPath

if TYPE_CHECKING:
    Task = str
else:
    Task = Literal[tuple(TASKS)]


class RunConfig(Root):
    """A run: what is known, what is to be recovered, and how."""

    cases = CASES

    task: Task = Field(
        description="What the run recovers.  "
        + "  ".join(f"{name}: {task.recovers}." for name, task in TASKS.items())
    )
    capture: CaptureConfig
    """The photographs and the shape."""
    lighting: LightingConfig = LightingConfig()
    """The known light.  Leave it out to recover the light, or to use that of a recipe."""
    captures: tuple[FurtherCaptureConfig, ...] = ()
    """Further photographs of the same object, each set with its own light.  A list."""
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
    def recipes(self) -> tuple[Path, ...]:
        """The recipes whose photographs are fitted, each once."""
        every = (self.capture.recipe, *(one.recipe for one in self.captures))
        return tuple(dict.fromkeys(path for path in every if path is not None))

    @property
    def sample_count(self) -> int:
        """How many samples a fit draws, of all captures together."""
        return self.samples.count * (1 + len(self.captures))

    @property
    def refine_count(self) -> int:
        """How many samples the refinement draws, of all captures together."""
        return self.solve.refine_samples * (1 + len(self.captures))

    @property
    def knows_light(self) -> bool:
        """Whether the light is known, from the config or from its recipe."""
        task = TASKS[self.task]
        if task.dark is not None and self.texture is not None and self.texture.unknown_light:
            return False
        known = self.lighting.given or self.capture.recipe is not None
        return known and task.lit is not None

    @model_validator(mode="after")
    def _knows_what_its_task_needs(self) -> RunConfig:
        task = TASKS[self.task]
        if task.dark is None and not self.knows_light:
            raise ValueError(
                "no light given; lighting needs one of environment, directional, per_frame"
            )
        task.check(self)
        return self
