"""Photographs into observations: read, traced, linearised, every unusable pixel accounted for."""

from typing import NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry import Shape, SurfacePlaces, SurfaceSamples, SurfaceView, observe
from jaxrender.imaging import (
    Curve,
    Response,
    Selection,
    below_black,
    erode,
    response_named,
    saturated,
    to_radiance,
    usable_pixels,
)
from jaxrender.inverse import Observations
from jaxrender.io import (
    Capture,
    Frame,
    Image,
    read_capture,
    read_curve,
    read_mask,
    read_photograph,
)
from jaxrender.pipelines.config.capture import CaptureConfig
from jaxrender.pipelines.progress import Progress
from jaxrender.shapes import Bool, Float

# Integer formats clip at their largest value: within half a step of it a pixel is saturated.
_FULL_SCALE = 0.998


class Photograph(NamedTuple):
    """One photograph as radiance, the surface behind its pixels, and which of them are usable."""

    frame: Frame
    radiance: Float[np.ndarray, "row column channel"]
    view: SurfaceView
    covered: Bool[np.ndarray, "row column"]
    selection: Selection


def read_frames(capture: CaptureConfig) -> Capture:
    """Read a capture's cameras and file names."""
    assert capture.transforms is not None
    return read_capture(
        capture.transforms, images=capture.images, allow_outside=capture.allow_outside
    )


def read_photographs(config: CaptureConfig, capture: Capture, progress: Progress) -> list[Image]:
    """Read every photograph; invalid pixels are refused or masked as the config says."""
    images = []
    for number, frame in enumerate(capture.frames):
        image = read_photograph(frame, config.invalid)
        _check_response_stated(config, frame, image)
        masked = int(np.count_nonzero(image.invalid))
        if masked:
            progress.note(
                f"{frame.image_path}: masked {masked} of {image.invalid.size} pixels that are "
                "negative or not finite"
            )
        images.append(image)
        progress.advance((number + 1) / len(capture.frames))
    return images


def trace_photographs(
    config: CaptureConfig,
    capture: Capture,
    images: list[Image],
    shape: Shape,
    min_cosine: float,
    progress: Progress,
) -> list[Photograph]:
    """Find the surface behind every pixel and select the usable ones.

    A photograph that sees nothing of the object, or has no usable pixel, is skipped with a warning;
    raises ``InputError`` when that leaves none.
    """
    response = _response(config)
    found = []
    for number, (frame, image) in enumerate(zip(capture.frames, images)):
        view = observe(frame.camera, shape)
        if not view.hit.any():
            progress.note(
                f"{frame.image_path}: warning: its camera does not see the object; skipped"
            )
            continue
        found.append(_photograph(config, frame, image, view, (response, min_cosine)))
        progress.advance((number + 1) / len(images))
    if not found:
        raise InputError(
            f"{config.transforms}: no camera sees the object: check the poses (camera-to-world, "
            "x right, y up, looking along -z) and the position and scale of capture.geometry"
        )
    if not any(photograph.selection.usable.any() for photograph in found):
        rules = _removed(found)
        raise InputError(
            f"{config.transforms}: the cameras see the object but no pixel is usable; "
            f"removed: {rules}; loosen capture.erode, capture.saturation, capture.black_level, "
            "samples.min_cosine or the masks"
        )
    return [photograph for photograph in found if _is_usable(photograph, progress)]


def camera_samples(view: SurfaceView) -> SurfaceSamples:
    """List what a camera sees of the surface, pixel by pixel."""
    return SurfaceSamples(view.normals[view.hit], view.outgoing[view.hit])


def observations_of(photographs: list[Photograph]) -> Observations:
    """Gather the usable pixels of all photographs."""
    pick = [photograph.selection.usable for photograph in photographs]
    counts = [int(np.count_nonzero(usable)) for usable in pick]
    views = [photograph.view for photograph in photographs]

    def gathered(images: list[np.ndarray]) -> np.ndarray:
        return np.concatenate([image[usable] for image, usable in zip(images, pick)])

    return Observations(
        SurfaceSamples(gathered([v.normals for v in views]), gathered([v.outgoing for v in views])),
        gathered([photograph.radiance for photograph in photographs]),
        np.repeat(np.arange(len(photographs)), counts),
        SurfacePlaces(
            gathered([v.points for v in views]), gathered([v.geometric_normals for v in views])
        ),
    )


def _photograph(
    config: CaptureConfig,
    frame: Frame,
    image: Image,
    view: SurfaceView,
    rules: tuple[Response, float],
) -> Photograph:
    response, min_cosine = rules
    covered = view.hit.copy()
    if image.alpha is not None:
        covered &= image.alpha >= _FULL_SCALE
    mask = read_mask(frame)
    if mask is not None:
        covered &= mask
    level = config.saturation
    if level is None:
        level = _FULL_SCALE if image.metadata.get("is_integer") else np.inf
    rejected = {
        "silhouette": ~erode(covered, config.erode),
        "invalid": image.invalid,
        "saturated": saturated(image.pixels, float(level), config.saturation_grow),
        "black": below_black(image.pixels, float(config.black_level)),
        "grazing": view.exit_cosines < min_cosine,
    }
    selection = usable_pixels(view.hit, rejected)
    exposure = frame.exposure
    if config.exposure == "metadata":
        exposure = image.metadata.get("exposure_time")
        if exposure is None:
            raise InputError(
                f"{frame.image_path}: no exposure time in its metadata; "
                "give frames[].exposure and capture.exposure: given"
            )
    radiance = _linearised(response, frame, image, selection.usable)
    if exposure is not None:
        radiance = to_radiance(radiance, float(exposure))
    return Photograph(frame, radiance, view, covered, selection)


def _is_usable(photograph: Photograph, progress: Progress) -> bool:
    """Whether any pixel is left; a photograph without could have no exposure of its own."""
    if photograph.selection.usable.any():
        return True
    progress.note(
        f"{photograph.frame.image_path}: warning: no pixel is usable (removed: "
        f"{_removed([photograph])}); skipped"
    )
    return False


def _check_response_stated(config: CaptureConfig, frame: Frame, image: Image) -> None:
    if image.metadata["is_integer"] and "response" not in config.model_fields_set:
        raise InputError(
            f"{frame.image_path}: integer pixel values are radiance only after the camera's "
            "response is undone; state capture.response: srgb (what cameras write), linear, or "
            "{curve: FILE}"
        )


def _linearised(
    response: Response, frame: Frame, image: Image, usable: Bool[np.ndarray, "row column"]
) -> Float[np.ndarray, "row column channel"]:
    """Undo the response; only what is measured must lie on a measured curve."""
    values = image.pixels
    if isinstance(response, Curve):
        low, high = response.values[0], response.values[-1]
        outside = usable & ((values < low) | (values > high)).any(axis=-1)
        if outside.any():
            row, column = np.argwhere(outside)[0]
            raise InputError(
                f"{frame.image_path}: pixel (row {row}, column {column}): the values "
                f"{values[row, column]} leave the response curve, which covers {low:g} to "
                f"{high:g}; {outside.sum()} of {usable.sum()} usable pixels do: extend the curve, "
                "or leave them out with capture.black_level and capture.saturation"
            )
        values = np.clip(values, low, high)
    return np.asarray(response.linearise(values), float)


def _response(config: CaptureConfig) -> Response:
    if isinstance(config.response, str):
        return response_named(config.response)
    return read_curve(config.response.curve)


def _removed(photographs: list[Photograph]) -> str:
    totals: dict[str, int] = {}
    for photograph in photographs:
        for rule, count in photograph.selection.removed.items():
            totals[rule] = totals.get(rule, 0) + count
    return ", ".join(f"{rule} {count}" for rule, count in totals.items() if count)
