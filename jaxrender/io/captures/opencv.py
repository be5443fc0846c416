"""A calibration of OpenCV with poses: ``camera_matrix``, ``distortion_coefficients``, ``images``.

The names are those of OpenCV's calibration sample.  ``camera_model`` or ``fisheye_model`` says that
the coefficients are those of ``cv2.fisheye``.  Poses take the world to a camera that looks along
+z, y down: ``extrinsic_parameters``, a row of rvec and tvec for each photograph; ``rvecs`` and
``tvecs``; or ``poses``, 4 x 4 or 3 x 4 matrices.  Photographs are ``images`` or ``image_names``, a
list of paths in the order of the poses; without it those of the folder count, sorted by name.

OpenCV counts pixels from the middle of the first, half a pixel from where it begins.
"""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from jaxrender.errors import InputError
from jaxrender.geometry.cameras import Pinhole
from jaxrender.geometry.lens_models import LENS_MODELS, opencv_lens
from jaxrender.geometry.lenses import Lens
from jaxrender.io.captures.capture import Capture, Frame
from jaxrender.io.captures.contents import Contents
from jaxrender.io.captures.opencv_storage import read_storage
from jaxrender.io.captures.paths import IMAGE_SUFFIXES, Looking, frame_names
from jaxrender.io.images import image_size
from jaxrender.io.xmlfiles import root_name
from jaxrender.limits import PIXELS
from jaxrender.shapes import Float

LOOKED_FOR = "*.yml, *.yaml or *.xml of OpenCV's FileStorage with `camera_matrix`"
_MATRIX, _COEFFICIENTS = ("camera_matrix", "K"), ("distortion_coefficients", "dist_coeffs", "D")
_NAMES = ("images", "image_names", "image_paths")
# A matrix stands within the first bytes of a file of OpenCV.
_START = 2**16
_LENS_AXES = np.array([1.0, -1.0, -1.0])


def find_opencv(folder: Path) -> list[Path]:
    """List the calibration files of a folder."""
    found = [path for path in folder.glob("*.xml") if root_name(path) == "opencv_storage"]
    for path in (*folder.glob("*.yml"), *folder.glob("*.yaml")):
        with path.open("rb") as file:
            start = file.read(_START)
        if start.startswith(b"%YAML") and b"!!opencv-matrix" in start:
            found.append(path)
    return sorted(found)


def read_opencv(path: Path, looking: Looking) -> Contents:
    """Read a calibration and its poses; raises InputError that names the key."""
    keys = read_storage(path)
    poses = _poses(path, keys)
    stated = _list_of_texts(path, keys)
    assumed: tuple[str, ...] = ()
    if stated is None:
        stated = sorted(
            one.name
            for one in looking.folder.iterdir()
            if one.suffix.lower() in IMAGE_SUFFIXES and not one.stem.startswith("mask")
        )
        assumed = ("the photographs are those of the folder, sorted by name",)
    if len(stated) != len(poses):
        raise InputError(
            f"{path}: {len(poses)} poses for {len(stated)} photographs; give one pose of each, and "
            f"their paths as `images`"
        )
    names = frame_names(path, stated, "path")
    intrinsics = _intrinsics(path, keys)
    lens = _lens(path, keys)
    frames = []
    for i, (name, value, pose) in enumerate(zip(names, stated, poses)):
        place = f"{path}: photograph {i} ({value})"
        image_path = looking.resolve(place, "images", value)
        width, height = _size(place, keys, image_path)
        try:
            camera = Pinhole(width, height, pose, **intrinsics, lens=lens)
        except ValueError as error:
            raise InputError(f"{place}: {error}") from None
        frames.append(Frame(name, camera, image_path, None, None))
    kind = "without distortion" if lens is None else type(lens).__name__
    found = f"one camera of OpenCV ({kind}); half a pixel was added to its principal point"
    return Contents(Capture(tuple(frames), path), (path,), found=(found,), assumed=assumed)


def _first(keys: dict[str, Any], names: tuple[str, ...]) -> Any:
    return next((keys[name] for name in names if name in keys), None)


def _intrinsics(path: Path, keys: dict[str, Any]) -> dict[str, float]:
    matrix = _first(keys, _MATRIX)
    if not isinstance(matrix, np.ndarray) or matrix.shape != (3, 3):
        raise InputError(f"{path}: no `camera_matrix` of 3 x 3 numbers")
    if matrix[0, 1] or matrix[1, 0] or np.any(matrix[2] != [0, 0, 1]):
        raise InputError(f"{path}: `camera_matrix` is {matrix.tolist()}: no camera without skew")
    return {
        "fl_x": float(matrix[0, 0]),
        "fl_y": float(matrix[1, 1]),
        "cx": float(matrix[0, 2]) + 0.5,
        "cy": float(matrix[1, 2]) + 0.5,
    }


def _lens(path: Path, keys: dict[str, Any]) -> Lens | None:
    coefficients = _first(keys, _COEFFICIENTS)
    numbers: list[float] = []
    if isinstance(coefficients, np.ndarray):
        numbers = coefficients.ravel().tolist()
    elif coefficients is not None:
        raise InputError(f"{path}: `distortion_coefficients` must be a matrix")
    fisheye = keys.get("fisheye_model") == 1 or "fisheye" in str(keys.get("camera_model")).lower()
    try:
        if fisheye:
            if len(numbers) != 4:
                raise ValueError(f"{len(numbers)} coefficients of a fisheye: OpenCV has 4")
            return LENS_MODELS["OPENCV_FISHEYE"].lens(numbers)
        return opencv_lens(numbers)
    except ValueError as error:
        raise InputError(f"{path}: `distortion_coefficients`: {error}") from None


def _size(place: str, keys: dict[str, Any], image_path: Path) -> tuple[int, int]:
    width, height = keys.get("image_width"), keys.get("image_height")
    if isinstance(width, float) and isinstance(height, float):
        if not (width.is_integer() and height.is_integer()):
            raise InputError(f"{place}: image_width x image_height is {width:g} x {height:g}")
        PIXELS.check(f"{place}: image_width x image_height", int(width) * int(height))
        return int(width), int(height)
    if not image_path.is_file():
        raise InputError(
            f"{place}: no image_width and image_height, and no picture to take them of"
        )
    return image_size(image_path)


def _list_of_texts(path: Path, keys: dict[str, Any]) -> list[str] | None:
    names = _first(keys, _NAMES)
    if names is None:
        return None
    names = [names] if isinstance(names, str) else names
    if not isinstance(names, list) or not all(isinstance(one, str) for one in names):
        raise InputError(f"{path}: `images` must be a list of paths")
    return names


def _poses(path: Path, keys: dict[str, Any]) -> list[Float[np.ndarray, "4 4"]]:
    """Turn the poses that a file has into camera-to-world, y up and looking along -z."""
    if "poses" in keys:
        matrices = _rows(path, "poses", keys["poses"], (12, 16))
        wide = matrices.reshape(len(matrices), -1, 4)
        turns, shifts = wide[:, :3, :3], wide[:, :3, 3]
    elif "rvecs" in keys and "tvecs" in keys:
        vectors = _rows(path, "rvecs", keys["rvecs"], (3,))
        shifts = _rows(path, "tvecs", keys["tvecs"], (3,))
        if len(vectors) != len(shifts):
            raise InputError(f"{path}: {len(vectors)} rvecs and {len(shifts)} tvecs")
        turns = Rotation.from_rotvec(vectors).as_matrix()
    elif "extrinsic_parameters" in keys:
        both = _rows(path, "extrinsic_parameters", keys["extrinsic_parameters"], (6,))
        turns, shifts = Rotation.from_rotvec(both[:, :3]).as_matrix(), both[:, 3:]
    else:
        raise InputError(
            f"{path}: no poses; give `extrinsic_parameters` (rvec and tvec a row), `rvecs` and "
            "`tvecs`, or `poses` (4 x 4 matrices)"
        )
    poses = np.tile(np.eye(4), (len(turns), 1, 1))
    poses[:, :3, :3] = np.swapaxes(turns, 1, 2) * _LENS_AXES
    poses[:, :3, 3] = -np.einsum("pji,pj->pi", turns, shifts)
    return list(poses)


def _rows(
    path: Path, key: str, value: Any, sizes: tuple[int, ...]
) -> Float[np.ndarray, "pose number"]:
    """Read a matrix with a row for each pose, or a list of matrices."""
    try:
        rows = [np.ravel(np.asarray(one, np.float64)) for one in value]
        table = np.stack(rows)
    except (TypeError, ValueError):
        table = np.zeros((0, 0))
    if not len(table) or table.shape[1] not in sizes or not np.isfinite(table).all():
        wanted = " or ".join(map(str, sizes))
        raise InputError(f"{path}: `{key}` wants {wanted} finite numbers for each photograph")
    return table
