"""``transforms.json`` of NeRF, Blender and Nerfstudio.

Poses are camera-to-world (x right, y up, looking along -z), pixel centres lie at half integers.
Intrinsics (``fl_x fl_y cx cy w h`` or ``camera_angle_x``; ``ortho_scale`` in world units a pixel
for ``"camera_model": "orthographic"``) and the distortion of the lens (``lens_keys``) stand at the
top and may be overridden frame by frame; keys of other programs are ignored.

Nerfstudio multiplies the poses that it was given by ``applied_transform``, and then positions by
``applied_scale``.  A mesh that was made with the original poses lies where ``Looking.original``
takes the cameras back to.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry.cameras import Camera, Orthographic, Pinhole
from jaxrender.io.captures.capture import Capture, Frame
from jaxrender.io.captures.contents import Contents
from jaxrender.io.captures.lens_keys import MODELS, PLAIN, lens_of
from jaxrender.io.captures.paths import Looking, frame_names
from jaxrender.io.captures.photo_headers import read_photo_header
from jaxrender.io.images import image_size
from jaxrender.io.jsonfiles import number, read_json
from jaxrender.limits import PIXELS
from jaxrender.shapes import Float

LOOKED_FOR = "transforms*.json with `frames`"


def find_transforms(folder: Path) -> list[Path]:
    """List the files of a folder that this format is known by; one of all photographs stands alone.

    Blender's data sets have one file each for training, validation and test.
    """
    whole = folder / "transforms.json"
    return [whole] if whole.is_file() else sorted(folder.glob("transforms*.json"))


def read_transforms(path: Path, looking: Looking) -> Contents:
    """Read cameras and paths.

    Raises InputError that names the file, the frame and the key.
    """
    document = read_json(path)
    entries = document.get("frames") if isinstance(document, dict) else None
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{path}: `frames` must be a list with at least one frame")
    top = {key: value for key, value in document.items() if key != "frames"}
    applied = _applied(path, top) if looking.original else None
    values = [_stated_path(path, i, entry) for i, entry in enumerate(entries)]
    names = frame_names(path, values, "file_path")
    assumed: dict[str, None] = {}
    frames = tuple(
        _frame(
            _Place(looking, f"{path}: frame {i} ({entry['file_path']})", applied, assumed),
            name,
            {**top, **entry},
        )
        for i, (name, entry) in enumerate(zip(names, entries, strict=True))
    )
    found = () if applied is None else (_UNDONE,)
    return Contents(Capture(frames, path), (path,), found=found, assumed=tuple(assumed))


_UNDONE = (
    "applied_transform and applied_scale were undone: cameras are where a mesh of the original "
    "reconstruction is (--frame file leaves them where the file has them)"
)
_FROM_EXIF = "the focal length is that of the photographs' EXIF (35 mm equivalent)"


class _Place:
    """Where a frame is read: its paths, the opening of messages, and what is said of all."""

    def __init__(
        self,
        looking: Looking,
        opening: str,
        applied: Float[np.ndarray, "4 4"] | None,
        assumed: dict[str, None],
    ):
        self.looking, self.opening, self.applied, self.assumed = looking, opening, applied, assumed

    def __str__(self) -> str:
        return self.opening


def _stated_path(path: Path, i: int, entry: Any) -> str:
    value = entry.get("file_path") if isinstance(entry, dict) else None
    if not isinstance(value, str) or not value:
        raise InputError(f"{path}: frame {i} has no `file_path`")
    return value


def _applied(path: Path, top: dict[str, Any]) -> Float[np.ndarray, "4 4"] | None:
    """Read what was done to the original poses: a similarity, or None."""
    if "applied_transform" not in top and "applied_scale" not in top:
        return None
    matrix = np.eye(4)
    if "applied_transform" in top:
        rows = _matrix(str(path), "applied_transform", top["applied_transform"], ((3, 4), (4, 4)))
        matrix[:3] = rows[:3]
    deviation = float(np.abs(matrix[:3, :3].T @ matrix[:3, :3] - np.eye(3)).max())
    if not deviation < 1e-6 or np.linalg.det(matrix[:3, :3]) < 0:
        raise InputError(f"{path}: `applied_transform` is no rotation with a shift; remove it")
    scale = number(str(path), top, "applied_scale") if "applied_scale" in top else 1.0
    if scale <= 0:
        raise InputError(f"{path}: `applied_scale` is {scale:g}; it must be positive")
    matrix[:3] *= scale
    return matrix


def _frame(place: _Place, name: str, keys: dict[str, Any]) -> Frame:
    looking, opening = place.looking, str(place)
    image_path = looking.resolve(opening, "file_path", keys["file_path"])
    mask = keys.get("mask_path")
    mask_path = None if mask is None else looking.resolve(opening, "mask_path", mask)
    exposure = None if keys.get("exposure") is None else number(opening, keys, "exposure")
    if exposure is not None and exposure <= 0:
        raise InputError(f"{opening}: `exposure` is {exposure:g}; it must be positive")
    return Frame(name, _camera(place, keys, image_path), image_path, mask_path, exposure)


def _camera(place: _Place, keys: dict[str, Any], image_path: Path) -> Camera:
    model = _model(keys)
    if model not in _CAMERA_MODELS:
        raise InputError(
            f"{place}: unknown camera_model {keys['camera_model']!r}; known are "
            f"{', '.join(_CAMERA_MODELS)}"
        )
    if "transform_matrix" not in keys:
        raise InputError(f"{place}: no `transform_matrix` (camera to world, 4 x 4)")
    pose = _matrix(str(place), "transform_matrix", keys["transform_matrix"], ((4, 4),))
    try:
        return _CAMERA_MODELS[model](place, keys, image_path, _taken_back(pose, place.applied))
    except InputError:
        raise
    except ValueError as error:
        # What a camera calls world_from_camera is `transform_matrix` in the file.
        message = str(error).replace("world_from_camera", "transform_matrix")
        raise InputError(f"{place}: {message}") from None


def _matrix(
    place: str, key: str, value: Any, shapes: tuple[tuple[int, int], ...]
) -> Float[np.ndarray, "row column"]:
    """Read a matrix of one of the shapes."""
    rows, columns = shapes[0]
    try:
        matrix = np.array(value, np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{place}: `{key}` must be {rows} rows of {columns} numbers") from None
    if matrix.shape not in shapes:
        raise InputError(f"{place}: `{key}` has shape {matrix.shape}; wanted {shapes[0]}")
    return matrix


def _taken_back(
    pose: Float[np.ndarray, "4 4"], applied: Float[np.ndarray, "4 4"] | None
) -> Float[np.ndarray, "4 4"]:
    """Undo a similarity: the rotation of a camera has no scale."""
    if applied is None:
        return pose
    back = np.linalg.inv(applied) @ pose
    back[:3, :3] *= np.cbrt(np.linalg.det(applied[:3, :3]))
    return back


def _pinhole(place: _Place, keys: dict[str, Any], image_path: Path, pose: np.ndarray) -> Pinhole:
    opening = str(place)
    width, height = _size(opening, keys, image_path)
    length = _focal_length(opening, keys, "x", width)
    if length is None:
        length = _length_of_photograph(image_path)
        if length is None:
            raise InputError(f"{place}: no focal length; give `fl_x` in pixels or `camera_angle_x`")
        place.assumed[_FROM_EXIF] = None
    return Pinhole(
        width,
        height,
        pose,
        fl_x=length,
        fl_y=_focal_length(opening, keys, "y", height),
        **_centre(opening, keys),
        lens=lens_of(opening, keys, _model(keys)),
    )


def _model(keys: dict[str, Any]) -> str:
    """Name the camera model; Instant-NGP has a key of its own for fisheyes."""
    plain = "opencv_fisheye" if keys.get("is_fisheye") is True else "perspective"
    return str(keys.get("camera_model", plain)).lower()


def _length_of_photograph(image_path: Path) -> float | None:
    return read_photo_header(image_path).focal_length if image_path.is_file() else None


def _orthographic(
    place: _Place, keys: dict[str, Any], image_path: Path, pose: np.ndarray
) -> Orthographic:
    opening = str(place)
    width, height = _size(opening, keys, image_path)
    if "ortho_scale" not in keys:
        raise InputError(f"{place}: no `ortho_scale` (world units a pixel)")
    if lens_of(opening, keys, "perspective") is not None:
        raise InputError(f"{place}: an orthographic camera has no lens; remove the distortion")
    scale = number(opening, keys, "ortho_scale")
    return Orthographic(width, height, pose, scale=scale, **_centre(opening, keys))


_CAMERA_MODELS: dict[str, Callable[[_Place, dict[str, Any], Path, np.ndarray], Camera]] = {
    **dict.fromkeys((*MODELS, *PLAIN), _pinhole),
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
