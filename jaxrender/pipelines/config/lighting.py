"""The known light: an environment image, directional sources, or a list for each photograph."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from jaxrender.pipelines.config.values import (
    ConfigPath,
    Count,
    Direction,
    Fraction,
    Positive,
    Rgb,
    Section,
    Switch,
)

Convention = Literal["z-up", "y-up", "angular", "cross", "mirror-ball"]


class EnvironmentConfig(Section):
    """An environment image."""

    path: ConfigPath
    """The panorama."""
    convention: Convention = "z-up"
    """Layout of the panorama."""
    scale: Positive = 1.0
    """Factor from pixel values to radiance."""
    height: Count | None = None
    """Rows after resampling.  Default: those of the panorama."""


class DirectionalConfig(Section):
    """A directional source."""

    direction: Direction
    """Vector towards the source, of any length."""
    irradiance: Rgb
    """Irradiance on a plane facing the source: one number or three."""


class LightingConfig(Section):
    """The light of the photographs; several kinds add up."""

    environment: EnvironmentConfig | None = None
    """An environment image."""
    directional: tuple[DirectionalConfig, ...] = ()
    """Directional sources."""
    per_frame: ConfigPath | None = None
    """A file with a list of directional sources for each photograph."""
    per_frame_irradiance: ConfigPath | None = None
    """The irradiance of each photograph's source, if per_frame is a text of directions."""
    split: Literal["off", "auto"] | Fraction = "auto"
    """How compact bright parts become sources: off, auto, or the part of energy that stays slow."""
    free_scale: Switch = False
    """Whether the scale between light and photographs is unknown."""

    @model_validator(mode="after")
    def _irradiance_of_sources(self) -> LightingConfig:
        if self.per_frame_irradiance is not None and self.per_frame is None:
            raise ValueError(
                "found per_frame_irradiance without per_frame; give the directions there, too"
            )
        return self

    @property
    def given(self) -> bool:
        """Whether the section names any light."""
        return bool(self.environment or self.directional or self.per_frame)
