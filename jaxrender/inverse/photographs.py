"""Photographs into observations: read, traced, linearised, every unusable pixel accounted for.

Messages call the rules of reading by the keys that a config has for them.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import equinox as eqx
import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry import (
    Shape,
    SurfacePlaces,
    SurfaceSamples,
    SurfaceView,
    camera_from,
    contours,
    observe,
)
from jaxrender.imaging import (
    Linear,
    Response,
    Selection,
    below_black,
    dilate,
    erode,
    response_named,
    saturated,
    to_radiance,
    usable_pixels,
)
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.stored_values import (
    FULL_SCALE,
    clipped_sentence,
    linearised,
    rounding_of,
    saturation_of,
)
from jaxrender.io import (
    Capture,
    Frame,
    Image,
    contradiction,
    read_capture,
    read_mask,
    read_photograph,
)
from jaxrender.shapes import Bool, Float


class Reading(NamedTuple):
    """How pixels become radiance, and which are left out.

    ``response`` None: none is stated, so that pictures of integers are refused and all others taken
    to be linear.  ``invalid``: what is done with pixels that are negative or not finite.  Pixels at
    or above ``saturation`` (None: those at full scale of pictures of integers; "auto": these, and
    those at a value that many pixels have at the top) are left out, with ``saturation_grow`` pixels
    around them; and those below ``black_level``, ``erode`` pixels at
    silhouettes and at contours within the object (``geometry.contours``), and views more grazing
    than ``min_cosine``.  ``exposure``: whether exposures are
    those given with the cameras, or of the pictures' metadata.  ``mirrored``: photographs and masks
    are turned left for right.
    """

    response: Response | None = None
    invalid: Literal["refuse", "mask"] = "refuse"
    saturation: float | Literal["auto"] | None = None
    saturation_grow: int = 0
    black_level: float = 0.0
    erode: int = 2
    exposure: Literal["given", "metadata"] = "given"
    min_cosine: float = 0.15
    mirrored: bool = False


class Listener(NamedTuple):
    """Who is told what is done: in words, and how much of it is done, from 0 to 1."""

    note: Callable[[str], None] = lambda text: None
    advance: Callable[[float], None] = lambda part: None


SILENT = Listener()


class Photograph(NamedTuple):
    """One photograph as radiance, the surface behind its pixels, and which of them are usable.

    ``capture`` is the one that it is of, with cameras as they were told.  ``saturation`` are the
    stored values from which its channels are left out, infinite where none is; ``rounding`` is the
    standard deviation of the radiance that the rounding of stored values adds to a usual pixel.
    """

    capture: Capture
    frame: Frame
    radiance: Float[np.ndarray, "row column channel"]
    view: SurfaceView
    covered: Bool[np.ndarray, "row column"]
    selection: Selection
    saturation: Float[np.ndarray, "channel"]
    rounding: float = 0.0


def read_photographs(
    capture: Capture, reading: Reading, listener: Listener = SILENT
) -> list[Image]:
    """Read every photograph; invalid pixels are refused or masked as the reading says."""
    images = []
    for number, frame in enumerate(capture.frames):
        image = read_photograph(frame, reading.invalid)
        if image.metadata["is_integer"] and reading.response is None:
            raise InputError(
                f"{frame.image_path}: integer pixel values are radiance only after the camera's "
                "response is undone; state capture.response: srgb (what cameras write), linear, or "
                "{curve: FILE}"
            )
        if reading.mirrored:
            image = mirrored_image(image)
        masked = int(np.count_nonzero(image.invalid))
        if masked:
            listener.note(
                f"{frame.image_path}: masked {masked} of {image.invalid.size} pixels that are "
                "negative or not finite"
            )
        images.append(image)
        listener.advance((number + 1) / len(capture.frames))
    _say_contradictions(capture, images, reading, listener)
    return images


def _say_contradictions(
    capture: Capture, images: list[Image], reading: Reading, listener: Listener
) -> None:
    """Warn once of each way in which pictures contradict the stated response."""
    if reading.response is None:
        return
    found: dict[str, list[Path]] = {}
    for frame, image in zip(capture.frames, images):
        said = contradiction(image.encoding, reading.response)
        if said and image.metadata["is_integer"]:
            found.setdefault(said, []).append(frame.image_path)
    for said, paths in found.items():
        more = f", and of {len(paths) - 1} more" if len(paths) > 1 else ""
        listener.note(f"{paths[0]}{more}: warning: {said} (capture.response)")


def posed(capture: Capture, axes: str) -> Capture:
    """Read the poses of a capture in the named axes (``geometry.CAMERA_AXES``)."""
    frames = (f._replace(camera=camera_from(f.camera, axes)) for f in capture.frames)
    return capture._replace(frames=tuple(frames))


def mask_of(frame: Frame, reading: Reading) -> Bool[np.ndarray, "row column"] | None:
    """Read a photograph's mask as the photograph is read; None where it has none."""
    mask = read_mask(frame)
    return mask[:, ::-1] if mask is not None and reading.mirrored else mask


def mirrored_image(image: Image) -> Image:
    """Turn a picture left for right."""
    alpha = None if image.alpha is None else image.alpha[:, ::-1]
    pixels, invalid = image.pixels[:, ::-1], image.invalid[:, ::-1]
    return image._replace(pixels=pixels, alpha=alpha, invalid=invalid)


def trace_photographs(
    capture: Capture,
    images: list[Image],
    shape: Shape,
    reading: Reading,
    listener: Listener = SILENT,
) -> list[Photograph]:
    """Find the surface behind every pixel and select the usable ones.

    A photograph that sees nothing of the object, or has no usable pixel, is skipped with a warning;
    raises ``InputError`` when that leaves none.
    """
    found, before = [], None
    levels = saturation_of(images, reading.saturation)
    if reading.saturation == "auto":
        listener.note(f"{capture.source}: {clipped_sentence(images, levels)}")
    for number, (frame, image) in enumerate(zip(capture.frames, images)):
        # A camera on a tripod sees the same again.
        if before is None or not eqx.tree_equal(frame.camera, before[0]):
            before = frame.camera, observe(frame.camera, shape)
        view = before[1]
        if not view.hit.any():
            listener.note(
                f"{frame.image_path}: warning: its camera does not see the object; skipped"
            )
            continue
        found.append(_photograph(capture, reading, frame, image, view, levels[number]))
        listener.advance((number + 1) / len(images))
    place = capture.source
    if not found:
        raise InputError(
            f"{place}: no camera sees the object: check the poses (camera-to-world, "
            "x right, y up, looking along -z) and the position and scale of capture.geometry"
        )
    if not any(photograph.selection.usable.any() for photograph in found):
        rules = _removed(found)
        raise InputError(
            f"{place}: the cameras see the object but no pixel is usable; "
            f"removed: {rules}; loosen capture.erode, capture.saturation, capture.black_level, "
            "samples.min_cosine or the masks"
        )
    return [photograph for photograph in found if _is_usable(photograph, listener)]


class LoadedCapture(NamedTuple):
    """A capture with its pictures, to be seen on a shape."""

    capture: Capture
    images: list[Image]
    reading: Reading

    def photographs(self, shape: Shape, listener: Listener = SILENT) -> list[Photograph]:
        """Find the surface behind every pixel; raises ``InputError`` as ``trace_photographs``."""
        return trace_photographs(self.capture, self.images, shape, self.reading, listener)

    def observations(self, shape: Shape) -> Observations:
        """Gather all usable pixels; raises ``InputError`` as ``trace_photographs`` does."""
        return observations_of(self.photographs(shape))


def load_capture(
    transforms: str | Path,
    images: str | Path | None = None,
    *,
    response: str | Response | None = None,
    allow_outside: bool = False,
    camera_axes: str = "opengl",
    **rules: Any,
) -> LoadedCapture:
    """Read photographs and their cameras from a ``transforms.json``.

    A file or a folder of another format of ``io.captures`` does as well.  ``images`` is the folder
    in which they are looked up instead of the file's own.  ``response`` is ``linear``, ``srgb`` or
    a measured ``Curve``; pictures of integers need it.  ``camera_axes`` are those of the poses
    (``geometry.CAMERA_AXES``).  ``rules`` are the other fields of ``Reading``.  Raises
    ``InputError`` that names the file, and what is wrong with it, and ``ValueError`` for a response
    that there is none of.
    """
    known = response_named(response) if isinstance(response, str) else response
    reading = Reading(known, **rules)
    capture = posed(read_capture(transforms, images, allow_outside=allow_outside), camera_axes)
    return LoadedCapture(capture, read_photographs(capture, reading), reading)


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
        pixel=np.concatenate([np.argwhere(usable) for usable in pick]),
        eyes=np.stack([photograph.frame.camera.position for photograph in photographs]),
        rounding=float(np.median(np.repeat([one.rounding for one in photographs], counts))),
    )


def _photograph(
    capture: Capture,
    reading: Reading,
    frame: Frame,
    image: Image,
    view: SurfaceView,
    levels: Float[np.ndarray, "channel"],
) -> Photograph:
    covered = view.hit.copy()
    if image.alpha is not None:
        covered &= image.alpha >= FULL_SCALE
    mask = mask_of(frame, reading)
    if mask is not None:
        covered &= mask
    rejected = {
        "silhouette": ~erode(covered, reading.erode),
        "contour": _near_contours(view, reading.erode),
        "invalid": image.invalid,
        "saturated": saturated(image.pixels, levels, reading.saturation_grow),
        "black": below_black(image.pixels, float(reading.black_level)),
        "grazing": view.exit_cosines < reading.min_cosine,
    }
    selection = usable_pixels(view.hit, rejected)
    exposure = frame.exposure
    if reading.exposure == "metadata":
        exposure = image.metadata.get("exposure_time")
        if exposure is None:
            raise InputError(
                f"{frame.image_path}: no exposure time in its metadata; "
                "give frames[].exposure and capture.exposure: given"
            )
    radiance = linearised(reading.response or Linear(), frame, image, selection.usable)
    rounded = rounding_of(image, reading.response, radiance[selection.usable])
    if exposure is not None:
        radiance = to_radiance(radiance, float(exposure))
        rounded /= float(exposure)
        frame = frame._replace(exposure=float(exposure))
    return Photograph(capture, frame, radiance, view, covered, selection, levels, rounded)


def _near_contours(view: SurfaceView, pixels: int) -> Bool[np.ndarray, "row column"]:
    """Find so many pixels on either side of where the surface breaks off or bends sharply.

    The last pixel before a silhouette sees a surface that turns away: it goes with the silhouette.
    """
    if not pixels:
        return np.zeros(view.hit.shape, bool)
    return dilate(contours(view) & erode(view.hit, 1), pixels - 1)


def _is_usable(photograph: Photograph, listener: Listener) -> bool:
    """Whether any pixel is left; a photograph without could have no exposure of its own."""
    if photograph.selection.usable.any():
        return True
    listener.note(
        f"{photograph.frame.image_path}: warning: no pixel is usable (removed: "
        f"{_removed([photograph])}); skipped"
    )
    return False


def _removed(photographs: list[Photograph]) -> str:
    totals: dict[str, int] = {}
    for photograph in photographs:
        for rule, count in photograph.selection.removed.items():
            totals[rule] = totals.get(rule, 0) + count
    return ", ".join(f"{rule} {count}" for rule, count in totals.items() if count)
