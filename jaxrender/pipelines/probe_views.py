"""Photographs of a chrome ball, or of the light itself, gathered by view and merged.

A *view* is one camera in one place, with its photographs at several exposures.  Photographs named
one by one are one view.  Those of a ``transforms.json`` are gathered by their pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry import (
    Camera,
    EquirectangularLens,
    FisheyeLens,
    Orthographic,
    Pinhole,
)
from jaxrender.imaging import (
    Bracket,
    Merged,
    Response,
    SensorNoise,
    Shift,
    aligned,
    check_shifts,
    measure_exposures,
    measure_shifts,
    merge_brackets,
    recover_response,
    response_named,
    rounding,
)
from jaxrender.io import Image, contradiction, read_capture, read_curve, read_image, read_mask
from jaxrender.shapes import Bool, Float

# Pictures of floating point are radiance already; their noise is not known, and taken for this.
_FLOAT_NOISE = 0.01
_NAMED = ("linear", "srgb")
RECOVER = "recover"
_FOUND = (None, RECOVER)
# x to the right, y up and z backwards of a camera that looks along the world's +Y.
POSE = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


class Reading(NamedTuple):
    """How photographs become radiance.

    ``response``: linear, srgb, recover (or None), or the path of a curve.  ``exposures`` in
    seconds, or None for those of the files; ``exposure`` measured: what the pixels tell replaces
    them.  ``align``: photographs that moved are moved back; else more than ``shift`` pixels are
    refused.  ``focal`` in pixels, or None for a distant camera.  ``lens``: the photographs show the
    light itself, through a fisheye whose picture is a circle, or as a panorama of all directions;
    None: a ball.  ``field`` is the angle of view of a fisheye in degrees.
    """

    response: str | None = None
    exposures: tuple[float, ...] | None = None
    exposure: str = "stated"
    align: bool = False
    shift: float = 0.5
    focal: float | None = None
    lens: Literal["fisheye", "panorama"] | None = None
    field: float = 360.0


class View(NamedTuple):
    """One camera, its pictures and their exposures, and where the ball is if a mask says so."""

    paths: tuple[Path, ...]
    images: tuple[Image, ...]
    exposures: tuple[float, ...]
    camera: Camera
    mask: Bool[np.ndarray, "row column"] | None


class MergedView(NamedTuple):
    """A view as radiance, and what was found about its photographs."""

    view: View
    merged: Merged
    account: dict


def read_views(photographs: Sequence[Path], reading: Reading) -> list[View]:
    """Read the pictures of one view, or all views of a ``transforms.json``."""
    if not photographs:
        raise InputError("no photographs: name pictures of a ball, or a transforms.json")
    if photographs[0].suffix.lower() == ".json":
        if len(photographs) > 1 or reading.focal is not None or reading.exposures is not None:
            raise InputError(
                f"{photographs[0]}: a capture is given alone: it has the cameras and exposures of "
                "all its photographs; leave out other photographs, --focal and --exposures"
            )
        return [_through(view, reading) for view in _views_of_capture(photographs[0])]
    images = tuple(read_image(path) for path in photographs)
    sizes = {image.pixels.shape[:2] for image in images}
    if len(sizes) > 1:
        raise InputError(
            f"{photographs[0]}: the photographs have sizes {sorted(sizes)} (rows, columns); those "
            "of one view have one size; views from several places need a transforms.json"
        )
    rows, columns = images[0].pixels.shape[:2]
    camera: Camera = Orthographic(columns, rows, POSE, scale=1.0)
    if reading.lens is not None:
        camera = _lens_camera(photographs[0], rows, columns, reading)
    elif reading.focal is not None:
        camera = Pinhole(columns, rows, POSE, fl_x=reading.focal)
    exposures = _exposures(photographs, images, reading.exposures)
    return [View(tuple(photographs), images, exposures, camera, None)]


def _lens_camera(path: Path, rows: int, columns: int, reading: Reading) -> Pinhole:
    """Make the camera of a photograph of the light itself."""
    if reading.focal is not None:
        raise InputError(f"--{reading.lens} has its own focal length: leave out --focal")
    if reading.lens == "fisheye":
        length = min(rows, columns) / math.radians(reading.field)
        return Pinhole(columns, rows, POSE, fl_x=length, lens=FisheyeLens(()))
    if columns != 2 * rows:
        raise InputError(
            f"{path}: the picture is {columns} x {rows} pixels (width x height); a panorama of all "
            "directions is twice as wide as high"
        )
    length = columns / (2 * math.pi)
    return Pinhole(columns, rows, POSE, fl_x=length, lens=EquirectangularLens())


def _through(view: View, reading: Reading) -> View:
    """Check that the camera of a capture has the lens that is asked for."""
    lens = view.camera.lens if isinstance(view.camera, Pinhole) else None
    wanted = {"fisheye": FisheyeLens, "panorama": EquirectangularLens}
    if reading.lens is not None and not isinstance(lens, wanted[reading.lens]):
        model = {"fisheye": "OPENCV_FISHEYE", "panorama": "lens: {kind: equirectangular}"}
        raise InputError(
            f"{view.paths[0]}: its camera is no {reading.lens}; state it in the capture, such as "
            f"{model[reading.lens]}"
        )
    return view


def merged_views(
    views: Sequence[View], reading: Reading, note: Callable[[str], None]
) -> tuple[list[MergedView], Response | None, str]:
    """Undo the response and merge the exposures of each view; the last is what is said of it."""
    _say_contradictions(views, reading, note)
    measured = any(image.metadata["is_integer"] for view in views for image in view.images)
    if not measured:
        text = f"pictures of radiance, whose noise is taken for {100 * _FLOAT_NOISE:g} %"
        return [_of_radiance(view) for view in views], None, text
    views = list(views)
    response, said = _response(views, reading)
    found = []
    for number, view in enumerate(views):
        brackets, shifts = _in_place(view, response, reading)
        if reading.response in _FOUND and number == 0 and any(s.pixels > 0.5 for s in shifts):
            # Once more, from photographs that lie on one another.
            response, said = _recovered(brackets, view)
            brackets, shifts = _in_place(view, response, reading)
        found.append(_merged(view, brackets, shifts, response, reading, note))
    return found, response, said


def _say_contradictions(
    views: Sequence[View], reading: Reading, note: Callable[[str], None]
) -> None:
    """Warn where the first picture contradicts the response that is stated."""
    if reading.response in _NAMED:
        said = contradiction(views[0].images[0].encoding, response_named(reading.response))
        if said:
            note(f"warning: {views[0].paths[0]}: {said} (--response)")


def _views_of_capture(path: Path) -> list[View]:
    capture, groups = read_capture(path), {}
    for frame in capture.frames:
        camera = frame.camera
        key = (camera.world_from_camera.tobytes(), camera.width, camera.height)
        groups.setdefault(key, []).append(frame)
    views = []
    for frames in groups.values():
        paths = tuple(frame.image_path for frame in frames)
        images = tuple(read_image(one) for one in paths)
        for frame, image in zip(frames, images):
            if image.pixels.shape[:2] != (frame.camera.height, frame.camera.width):
                raise InputError(
                    f"{frame.image_path}: the picture is not of the size of its camera, "
                    f"{frame.camera.width} x {frame.camera.height}; scale the one or the other"
                )
        given = [frame.exposure for frame in frames]
        stated = tuple(e for e in given if e is not None)
        whole = stated if len(stated) == len(given) else None
        exposures = _exposures(paths, images, whole)
        masks = [mask for mask in map(read_mask, frames) if mask is not None]
        views.append(View(paths, images, exposures, frames[0].camera, masks[0] if masks else None))
    return views


def _exposures(
    paths: Sequence[Path], images: Sequence[Image], stated: tuple[float, ...] | None
) -> tuple[float, ...]:
    """Take the exposures that are stated, or else those of the files; one alone may have none."""
    if stated is not None:
        if len(stated) != len(paths):
            raise InputError(f"{len(stated)} exposures for {len(paths)} photographs: give one each")
        return stated
    found = []
    for path, image in zip(paths, images):
        time = image.metadata.get("exposure_time")
        if time is None and len(paths) > 1:
            raise InputError(f"{path}: no exposure time in its metadata; give --exposures")
        found.append(1.0 if time is None or len(paths) == 1 else float(time))
    return tuple(found)


def _of_radiance(view: View) -> MergedView:
    image, *others = view.images
    if others:
        raise InputError(
            f"{view.paths[0]}: {len(view.images)} pictures of floating point of one view; give one "
            "merged picture, or photographs of 8 or 16 bits"
        )
    radiance = image.pixels / view.exposures[0]
    good = ~image.invalid
    account = {"photographs": [path.name for path in view.paths]}
    return MergedView(view, Merged(radiance, _FLOAT_NOISE * radiance, good), account)


def _response(views: Sequence[View], reading: Reading) -> tuple[Response, str]:
    """Make the response that is stated, or recover it from the first view of several exposures."""
    stated = reading.response
    if stated in _NAMED:
        return response_named(stated), f"response: {stated}"
    if stated is not None and stated != RECOVER:
        return read_curve(stated), f"response: {stated}"
    several = [view for view in views if len(set(view.exposures)) > 1]
    if not several:
        raise InputError(
            f"{views[0].paths[0]}: integer pixel values are radiance only after the camera's "
            "response is undone; give --response linear, srgb or the file of a curve, or several "
            "exposures to recover it from"
        )
    view = several[0]
    return _recovered(_brackets(view), view)


def _recovered(brackets: Sequence[Bracket], view: View) -> tuple[Response, str]:
    try:
        found = recover_response(brackets)
    except ValueError as error:
        raise InputError(f"{view.paths[0]}: {error}") from None
    return found.curve, found.said


def _brackets(view: View) -> list[Bracket]:
    return [Bracket(image.pixels, t) for image, t in zip(view.images, view.exposures)]


def _in_place(
    view: View, response: Response, reading: Reading
) -> tuple[list[Bracket], tuple[Shift, ...]]:
    """Check that the camera stood still, or move the photographs back."""
    brackets = _brackets(view)
    if len(brackets) == 1:
        return brackets, ()
    shifts = measure_shifts(brackets, response)
    if reading.align:
        return aligned(brackets, shifts), shifts
    try:
        check_shifts(shifts, [str(path) for path in view.paths], reading.shift)
    except ValueError as error:
        raise InputError(f"{error} (--align moves them back, --shift allows more)") from None
    return brackets, shifts


def _merged(
    view: View,
    brackets: list[Bracket],
    shifts: tuple[Shift, ...],
    response: Response,
    reading: Reading,
    note: Callable[[str], None],
) -> MergedView:
    names = [path.name for path in view.paths]
    account: dict = {"photographs": names, "exposures": [b.exposure for b in brackets]}
    if shifts:
        account["shifts_in_pixels"] = [[s.rows, s.columns] for s in shifts]
        measured = measure_exposures(brackets, response)
        account["measured_exposures"] = measured.measured.tolist()
        said = measured.said(names)
        if said and reading.exposure == "stated":
            note(f"warning: {view.paths[0].parent}: {said}; --exposure measured takes the pixels'")
        if reading.exposure == "measured":
            times = measured.measured.tolist()
            brackets = [b._replace(exposure=t) for b, t in zip(brackets, times)]
            account["exposures"] = times
    depth = min(int(image.metadata["bit_depth"]) for image in view.images)
    noise = SensorNoise(step=rounding(depth))
    return MergedView(view, merge_brackets(brackets, response, noise), account)


def luminance(view: MergedView) -> Float[np.ndarray, "row column"]:
    """The mean of the channels of a view, in which a ball is looked for."""
    return view.merged.radiance.mean(axis=-1)
