"""Captures: photographs with their cameras, read from a ``transforms.json``.

The file is the NeRF and Blender convention: poses are camera-to-world (x right, y up, looking along
-z), pixel centres lie at half integers.  Intrinsics (``fl_x fl_y cx cy w h`` or ``camera_angle_x``;
``ortho_scale`` in world units a pixel for ``"camera_model": "orthographic"``) stand at the top and
may be overridden frame by frame; keys of other programs are ignored.

Paths inside the file come from whoever wrote it: they must stay below the file's own folder (or
the folder of pictures that the user names) unless the user allows more.
"""

import json
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool

from jaxrender.errors import InputError
from jaxrender.geometry.cameras import Camera, Orthographic, Pinhole
from jaxrender.io.images import MEND, Image, image_size, read_image
from jaxrender.io.jsonfiles import number, read_json
from jaxrender.limits import PIXELS

# What file_path may leave out, in the order of preference: linear formats first.
IMAGE_SUFFIXES = (".exr", ".hdr", ".pfm", ".png", ".jpg", ".jpeg", ".tga", ".tiff", ".tif")

_DISTORTION = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")


class Frame(NamedTuple):
    """One photograph: its camera, its files and its exposure (a factor, None where not given)."""

    name: str
    camera: Camera
    image_path: Path
    mask_path: Path | None
    exposure: float | None


class Capture(NamedTuple):
    """The photographs of one object, and what their cameras were read from."""

    frames: tuple[Frame, ...]
    source: Path = Path("cameras")

    def numbers_of(self, names: Iterable[str]) -> list[int]:
        """Find frames by their names."""
        known = [frame.name for frame in self.frames]
        return [known.index(name) for name in names]


def read_capture(
    path: str | Path,
    images: str | Path | None = None,
    *,
    allow_outside: bool = False,
    require_images: bool = True,
) -> Capture:
    """Read the cameras and the paths of a capture, not yet its pixels.

    ``images``: the folder in which paths are looked up instead of the file's own.
    ``require_images=False``: the cameras alone are wanted, the pictures need not exist.
    A frame is named by its file without folder and suffix; where two would share that name, by the
    whole path with ``_`` between folders; where that does not help, by number and file.
    Raises InputError that names the file, the frame and the key.
    """
    path = Path(path)
    document = read_json(path)
    entries = document.get("frames") if isinstance(document, dict) else None
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{path}: `frames` must be a list with at least one frame")
    source = _Source(path, Path(images) if images else path.parent, allow_outside, require_images)
    top = {key: value for key, value in document.items() if key != "frames"}
    names = _names(path, entries)
    return Capture(
        tuple(
            _frame(source, f"{path}: frame {i} ({entry['file_path']})", name, {**top, **entry})
            for i, (name, entry) in enumerate(zip(names, entries, strict=True))
        ),
        path,
    )


def read_photograph(frame: Frame, invalid: str = "refuse") -> Image:
    """Read a frame's picture; InputError if its size is not that of the frame's camera."""
    image = read_image(frame.image_path, invalid)
    _check_size(frame, frame.image_path, image)
    return image


def read_mask(frame: Frame) -> Bool[np.ndarray, "row column"] | None:
    """Read a frame's mask file, True where the mean of the channels exceeds one half."""
    if frame.mask_path is None:
        return None
    image = read_image(frame.mask_path, remedy=MEND)
    _check_size(frame, frame.mask_path, image)
    return image.pixels.mean(axis=-1) > 0.5


class _Source(NamedTuple):
    """Where the paths of a capture lead."""

    path: Path
    folder: Path
    allow_outside: bool
    require_images: bool

    def resolve(self, place: str, key: str, value: Any, suffixes: tuple[str, ...]) -> Path:
        """Find the file that a frame names, adding a suffix where it has none."""
        if not isinstance(value, str) or not value:
            raise InputError(f"{place}: `{key}` is {value!r}; wanted the path of a picture")
        try:
            return self._found(place, key, self.folder / value, suffixes)
        except InputError:
            raise
        except (OSError, ValueError):
            # A zero byte, half a surrogate pair, or more letters than a name may have.
            raise InputError(
                f"{place}: `{key}` is {value!r}; no file can be named so: mend the path"
            ) from None

    def _found(self, place: str, key: str, wanted: Path, suffixes: tuple[str, ...]) -> Path:
        # Before anything is looked at: even whether a file exists is told only below the folder.
        self._check_inside(place, key, wanted)
        candidates = [wanted]
        if wanted.suffix.lower() not in suffixes:
            candidates += [wanted.with_name(wanted.name + suffix) for suffix in suffixes]
        for candidate in candidates:
            if candidate.is_file():
                self._check_inside(place, key, candidate)
                return candidate
        if self.require_images:
            tried = f", nor with one of {', '.join(suffixes)}" if len(candidates) > 1 else ""
            raise InputError(
                f"{place}: `{key}`: {wanted} does not exist{tried}; mend the path, or name the "
                "folder that it starts from as `images`"
            )
        return wanted

    def _check_inside(self, place: str, key: str, path: Path) -> None:
        if not self.allow_outside and not _below(path, self.folder):
            raise InputError(
                f"{place}: `{key}` leads outside {self.folder}; move the file, name its folder as "
                "`images`, or allow paths outside (allow_outside)"
            )


def _below(path: Path, folder: Path) -> bool:
    """Whether a path, its symbolic links followed, stays inside a folder."""
    return path.resolve().is_relative_to(folder.resolve())


def _names(path: Path, entries: list[Any]) -> list[str]:
    """Name each frame, and refuse frames without a path or with the path of another."""
    paths: list[Path] = []
    for i, entry in enumerate(entries):
        value = entry.get("file_path") if isinstance(entry, dict) else None
        if not isinstance(value, str) or not value:
            raise InputError(f"{path}: frame {i} has no `file_path`")
        stem = Path(value)
        if stem.suffix.lower() in IMAGE_SUFFIXES:
            stem = stem.with_suffix("")
        if stem in paths:
            raise InputError(
                f"{path}: frame {i} ({value}) repeats the file_path of frame {paths.index(stem)}"
            )
        paths.append(stem)
    short = [stem.name for stem in paths]
    whole = ["_".join(stem.relative_to(stem.anchor).parts) for stem in paths]
    numbered = [f"{i}_{name}" for i, name in enumerate(short)]
    return next(names for names in (short, whole, numbered) if len(set(names)) == len(names))


def _frame(source: _Source, place: str, name: str, keys: dict[str, Any]) -> Frame:
    image_path = source.resolve(place, "file_path", keys["file_path"], IMAGE_SUFFIXES)
    mask = keys.get("mask_path")
    mask_path = None if mask is None else source.resolve(place, "mask_path", mask, IMAGE_SUFFIXES)
    exposure = None if keys.get("exposure") is None else number(place, keys, "exposure")
    if exposure is not None and exposure <= 0:
        raise InputError(f"{place}: `exposure` is {exposure:g}; it must be positive")
    return Frame(name, _camera(place, keys, image_path), image_path, mask_path, exposure)


def _camera(place: str, keys: dict[str, Any], image_path: Path) -> Camera:
    model = str(keys.get("camera_model", "pinhole")).lower()
    if model not in _CAMERA_MODELS:
        raise InputError(
            f"{place}: unknown camera_model {keys['camera_model']!r}; known are "
            f"{', '.join(_CAMERA_MODELS)}"
        )
    for key in _DISTORTION:
        if keys.get(key):
            raise InputError(
                f"{place}: `{key}` is {keys[key]}: lens distortion is not modelled; undistort the "
                "photographs first"
            )
    if "transform_matrix" not in keys:
        raise InputError(f"{place}: no `transform_matrix` (camera to world, 4 x 4)")
    try:
        pose = np.array(keys["transform_matrix"], np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{place}: `transform_matrix` must be 4 rows of 4 numbers") from None
    if pose.shape != (4, 4):
        raise InputError(f"{place}: `transform_matrix` has shape {pose.shape}; wanted (4, 4)")
    try:
        return _CAMERA_MODELS[model](place, keys, image_path, pose)
    except InputError:
        raise
    except ValueError as error:
        # What a camera calls world_from_camera is `transform_matrix` in the file.
        message = str(error).replace("world_from_camera", "transform_matrix")
        raise InputError(f"{place}: {message}") from None


def _pinhole(place: str, keys: dict[str, Any], image_path: Path, pose: np.ndarray) -> Pinhole:
    width, height = _size(place, keys, image_path)
    if "fl_x" not in keys and "camera_angle_x" not in keys:
        raise InputError(f"{place}: no focal length; give `fl_x` in pixels or `camera_angle_x`")
    return Pinhole(
        width,
        height,
        pose,
        fl_x=_focal_length(place, keys, "x", width) or 0.0,
        fl_y=_focal_length(place, keys, "y", height),
        **_centre(place, keys),
    )


def _orthographic(
    place: str, keys: dict[str, Any], image_path: Path, pose: np.ndarray
) -> Orthographic:
    width, height = _size(place, keys, image_path)
    if "ortho_scale" not in keys:
        raise InputError(f"{place}: no `ortho_scale` (world units a pixel)")
    scale = number(place, keys, "ortho_scale")
    return Orthographic(width, height, pose, scale=scale, **_centre(place, keys))


_CAMERA_MODELS: dict[str, Callable[[str, dict[str, Any], Path, np.ndarray], Camera]] = {
    "pinhole": _pinhole,
    "perspective": _pinhole,
    "simple_pinhole": _pinhole,
    "opencv": _pinhole,
    "orthographic": _orthographic,
}


def _size(place: str, keys: dict[str, Any], image_path: Path) -> tuple[int, int]:
    """Width and height as stated, or else those of the picture."""
    if "w" in keys and "h" in keys:
        width, height = number(place, keys, "w"), number(place, keys, "h")
        if width != int(width) or height != int(height):
            raise InputError(f"{place}: `w` x `h` is {width} x {height}; wanted whole numbers")
        PIXELS.check(f"{place}: `w` x `h`", int(width) * int(height))
        return int(width), int(height)
    if not image_path.is_file():
        raise InputError(f"{place}: no `w` and `h`, and no picture to take them from")
    return image_size(image_path)


def _focal_length(place: str, keys: dict[str, Any], axis: str, pixels: int) -> float | None:
    """Focal length in pixels along one axis, f = pixels / 2 / tan(angle / 2) from an angle."""
    if f"fl_{axis}" in keys:
        return number(place, keys, f"fl_{axis}")
    # A stated fl_x describes square pixels; then a stray camera_angle_y would contradict it.
    if f"camera_angle_{axis}" not in keys or (axis == "y" and "fl_x" in keys):
        return None
    angle = number(place, keys, f"camera_angle_{axis}")
    if not 0 < angle < math.pi:
        raise InputError(
            f"{place}: `camera_angle_{axis}` is {angle:g}; wanted radians between 0 and pi"
        )
    return pixels / 2 / math.tan(angle / 2)


def _centre(place: str, keys: dict[str, Any]) -> dict[str, float | None]:
    return {key: number(place, keys, key) if key in keys else None for key in ("cx", "cy")}


def _check_size(frame: Frame, path: Path, image: Image) -> None:
    height, width = image.pixels.shape[:2]
    if (width, height) != (frame.camera.width, frame.camera.height):
        raise InputError(
            f"{path}: frame {frame.name}: the picture is {width} x {height} pixels, its camera "
            f"says {frame.camera.width} x {frame.camera.height}; scale the one or the other"
        )


def write_capture(path: Path, capture: Capture) -> None:
    """Write cameras and exposures as ``read_capture`` reads them.

    Pictures keep the paths that they have in the folder of ``capture.source``.
    """
    folder = capture.source.parent
    frames = []
    for frame in capture.frames:
        entry: dict[str, Any] = {"file_path": _relative(frame.image_path, folder)}
        if frame.mask_path is not None:
            entry["mask_path"] = _relative(frame.mask_path, folder)
        if frame.exposure is not None:
            entry["exposure"] = float(frame.exposure)
        camera = frame.camera
        entry |= {"w": camera.width, "h": camera.height}
        if isinstance(camera, Orthographic):
            entry |= {"camera_model": "orthographic", "ortho_scale": camera.scale}
            entry |= {"cx": camera.cx, "cy": camera.cy}
        else:
            assert isinstance(camera, Pinhole)
            entry |= {name: getattr(camera, name) for name in ("fl_x", "fl_y", "cx", "cy")}
        frames.append(entry | {"transform_matrix": camera.world_from_camera.tolist()})
    path.write_text(json.dumps({"frames": frames}, indent=1) + "\n", encoding="utf-8")


def _relative(path: Path, folder: Path) -> str:
    """Say where a file is from a folder, or where it is at all."""
    try:
        return path.resolve().relative_to(folder.resolve()).as_posix()
    except ValueError:
        return str(path.resolve())
