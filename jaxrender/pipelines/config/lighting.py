"""The light of a fit or a recipe: an environment image, light stated by numbers, moving sources.

The sections of light that is stated by numbers are those of the catalogue.  A new kind there needs
no change here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, create_model, model_validator

from jaxrender.catalogue import LIGHTS, LightKey, LightKind
from jaxrender.pipelines.config.values import (
    ConfigPath,
    Count,
    Direction,
    Fraction,
    LobeWidth,
    Number,
    Positive,
    Rgb,
    Section,
    SignedRgb,
    Switch,
    Vector,
)

Convention = Literal["z-up", "y-up", "angular", "cross", "mirror-ball"]

_KINDS: dict[str, Any] = {
    "direction": Direction,
    "position": Vector,
    "colour": Rgb,
    "colours": Annotated[tuple[SignedRgb, ...], Field(min_length=1)],
    "angle": LobeWidth,
}


class EnvironmentConfig(Section):
    """An environment image."""

    path: ConfigPath
    """The panorama."""
    convention: Convention = "z-up"
    """Layout of the panorama."""
    mirrored: Switch = False
    """Whether the panorama is the mirror image of what it should be, left for right."""
    yaw: Number = 0.0
    """Degrees by which the light is turned about the panorama's up, anticlockwise from above."""
    scale: Positive = 1.0
    """Factor from pixel values to radiance."""
    height: Count | None = None
    """Rows after resampling.  Default: those of the panorama."""


def _entry(key: LightKey) -> tuple[Any, Any]:
    """Make the type of a key, and its default with what it means."""
    if key.kind == "word":
        return Literal[key.words], Field(key.words[0], description=key.meaning)
    return _KINDS[key.kind], Field(description=key.meaning)


def _section(kind: LightKind) -> tuple[Any, Any]:
    """Make the section of a kind of light, or the list of them, and its default."""
    words = kind.meaning[0].upper() + kind.meaning[1:] + "."
    title = "".join(part.capitalize() for part in kind.name.split("_"))
    keys: dict[str, Any] = {key.name: _entry(key) for key in kind.keys}
    section: Any = create_model(f"{title}Config", __base__=Section, __doc__=words, **keys)
    if kind.many:
        return tuple[section, ...], Field(default=(), description=f"{words}  A list.")
    return section | None, Field(default=None, description=words)


class _Light(Section):
    """Light that photographs share; several kinds add up."""

    environment: EnvironmentConfig | None = None
    """An environment image."""

    def stated(self) -> dict[str, tuple[dict[str, Any], ...]]:
        """List the entries of each kind of light that is stated by numbers."""
        found = {}
        for name in LIGHTS:
            given = getattr(self, name)
            entries = given if isinstance(given, tuple) else (given,)
            if given:
                found[name] = tuple(dict(entry) for entry in entries)
        return found

    @property
    def has_image(self) -> bool:
        """Whether there is more than directional sources."""
        return bool(self.environment) or any(LIGHTS[name].is_image for name in self.stated())


class _CaptureLighting(_Light):
    """The light of the photographs of one capture; several kinds add up."""

    per_frame: ConfigPath | None = None
    """A file with a list of directional sources for each photograph."""
    per_frame_irradiance: ConfigPath | None = None
    """The irradiance of each photograph's source, if per_frame is a text of directions."""

    @model_validator(mode="after")
    def _irradiance_of_sources(self) -> _CaptureLighting:
        if self.per_frame_irradiance is not None and self.per_frame is None:
            raise ValueError(
                "found per_frame_irradiance without per_frame; give the directions there, too"
            )
        return self

    @property
    def given(self) -> bool:
        """Whether the section names any light."""
        return bool(self.environment or self.stated() or self.per_frame)


class _Lighting(_CaptureLighting):
    """The light of the photographs; several kinds add up."""

    split: Literal["off", "auto"] | Fraction = "auto"
    """How compact bright parts become sources: off, auto, or the part of energy that stays slow."""
    free_scale: Switch = False
    """Whether the scale between light and photographs is unknown."""


class _RecipeLighting(_Light):
    """The true light; several kinds add up."""

    @model_validator(mode="after")
    def _has_light(self) -> _RecipeLighting:
        if not (self.environment or self.stated()):
            kinds = ", ".join(("environment", *LIGHTS))
            raise ValueError(f"no light given; give at least one of {kinds}")
        return self


if TYPE_CHECKING:
    CaptureLightingConfig = _CaptureLighting
    LightingConfig = _Lighting
    RecipeLightingConfig = _RecipeLighting
else:
    _SECTIONS = {name: _section(kind) for name, kind in LIGHTS.items()}
    CaptureLightingConfig = create_model(
        "CaptureLightingConfig",
        __base__=_CaptureLighting,
        __doc__=_CaptureLighting.__doc__,
        **_SECTIONS,
    )
    LightingConfig = create_model(
        "LightingConfig", __base__=(_Lighting, CaptureLightingConfig), __doc__=_Lighting.__doc__
    )
    RecipeLightingConfig = create_model(
        "RecipeLightingConfig",
        __base__=_RecipeLighting,
        __doc__=_RecipeLighting.__doc__,
        **_SECTIONS,
    )
