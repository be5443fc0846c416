"""The captures of a run: their photographs, how pixels are read, and the light of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

from jaxrender.geometry import Shape
from jaxrender.imaging import response_named
from jaxrender.inverse import KnownLight
from jaxrender.inverse.photographs import (
    Listener,
    Photograph,
    Reading,
    posed,
    read_photographs,
    trace_photographs,
)
from jaxrender.io import Capture, Image, read_capture, read_curve
from jaxrender.pipelines.config import (
    CaptureConfig,
    CaptureLightingConfig,
    CurveConfig,
    FurtherCaptureConfig,
    RunConfig,
)
from jaxrender.pipelines.scene import fault_of, known_light


class LitCapture(NamedTuple):
    """Photographs with their cameras, how their pixels become radiance, and what lights them.

    ``names`` are those of the photographs in their own file.
    """

    capture: Capture
    names: tuple[str, ...]
    stated: CaptureConfig | FurtherCaptureConfig
    lighting: CaptureLightingConfig
    min_cosine: float

    @property
    def reading(self) -> Reading:
        """How pixels become radiance; a measured response is read from its file."""
        return reading_of(self.stated, self.min_cosine)

    def light(self, shape: Shape | None) -> KnownLight:
        """Make or read the light."""
        return known_light(self.lighting, list(self.names), shape)

    def images(self, listener: Listener) -> list[Image]:
        """Read the pictures."""
        return read_photographs(self.capture, self.reading, listener)

    def traced(self, images: list[Image], shape: Shape, listener: Listener) -> list[Photograph]:
        """Find the surface behind every pixel."""
        with fault_of(str(self.capture.source)):
            return trace_photographs(self.capture, images, shape, self.reading, listener)


def captures_of(config: RunConfig, *, require_images: bool = True) -> tuple[LitCapture, ...]:
    """Read the cameras and file names of all captures, whose photographs exist.

    Of several captures each gives its photographs its number, so that no two have one name.
    """
    stated = (config.capture, *config.captures)
    lightings = (config.lighting, *(one.lighting for one in config.captures))
    captures = [capture_of(one, require_images=require_images) for one in stated]
    least = float(config.samples.min_cosine)
    return tuple(
        LitCapture(capture, tuple(f.name for f in told.frames), one, lighting, least)
        for one, told, capture, lighting in zip(stated, captures, numbered(captures), lightings)
    )


def numbered(captures: Sequence[Capture]) -> list[Capture]:
    """Put the number of its capture before the name of each photograph, if there are several."""
    if len(captures) == 1:
        return list(captures)
    return [
        capture._replace(
            frames=tuple(frame._replace(name=f"{at}-{frame.name}") for frame in capture.frames)
        )
        for at, capture in enumerate(captures, 1)
    ]


def joined(captures: Sequence[Capture]) -> Capture:
    """Put the photographs of all captures together; their file is that of the first."""
    frames = tuple(frame for capture in captures for frame in capture.frames)
    return Capture(frames, captures[0].source)


def light_of_captures(captures: Sequence[LitCapture], shape: Shape | None) -> KnownLight:
    """Put the lights of all captures together."""
    lights = []
    for at, one in enumerate(captures):
        with fault_of(f"captures[{at - 1}]" if at else "capture"):
            lights.append(one.light(shape))
    return KnownLight.joined(lights, [len(one.capture.frames) for one in captures])


def capture_of(
    config: CaptureConfig | FurtherCaptureConfig, *, require_images: bool = True
) -> Capture:
    """Read a capture's cameras and file names."""
    assert config.transforms is not None
    read = read_capture(
        config.transforms,
        images=config.images,
        allow_outside=config.allow_outside,
        require_images=require_images,
        foreign=False,
    )
    return posed(read, config.camera_axes)


def _number_or_word(value: float | Literal["auto"] | None) -> float | Literal["auto"] | None:
    return value if value is None or value == "auto" else float(value)


def reading_of(capture: CaptureConfig | FurtherCaptureConfig, min_cosine: float) -> Reading:
    """Make the reading of a capture's pixels from the config."""
    response = None
    if isinstance(capture.response, CurveConfig):
        response = read_curve(capture.response.curve)
    elif "response" in capture.model_fields_set:
        response = response_named(capture.response)
    return Reading(
        response,
        capture.invalid,
        _number_or_word(capture.saturation),
        capture.saturation_grow,
        float(capture.black_level),
        capture.erode,
        capture.exposure,
        min_cosine,
        capture.mirrored,
    )
