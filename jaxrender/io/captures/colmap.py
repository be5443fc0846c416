"""COLMAP's sparse models: ``cameras`` and ``images`` as text or binary files.

A pose in these files takes the world to a camera that looks along +z, y down; quaternions are
(w, x, y, z).  Pixel centres lie at half integers.  Photographs lie in ``images`` beside the model's
folder, or in the folder itself.  A mask is ``masks/NAME.png``, and a mesh ``meshed-poisson.ply`` or
``meshed-delaunay.ply``.
"""

import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from jaxrender.errors import InputError
from jaxrender.geometry.cameras import Pinhole
from jaxrender.geometry.lens_models import LENS_MODELS
from jaxrender.io.captures.capture import Capture, Frame
from jaxrender.io.captures.contents import Contents
from jaxrender.io.captures.paths import Looking, frame_names
from jaxrender.io.jsonfiles import read_text
from jaxrender.limits import MESH_BYTES, PIXELS
from jaxrender.shapes import Float

LOOKED_FOR = "cameras.bin or cameras.txt, there or in sparse/0, sparse, colmap/sparse/0"
_PLACES = (".", "sparse/0", "sparse", "colmap/sparse/0", "colmap/sparse")
_IMAGE_FOLDERS = ("images", ".", "input")
_MESHES = ("meshed-poisson.ply", "meshed-delaunay.ply")
_MESH_FOLDERS = (".", "dense", "dense/0")
# By the numbers that binary files have for them.
_MODELS = (
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE",
    "FULL_OPENCV", "FOV", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE",
    "RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION", "DIVISION", "SIMPLE_FISHEYE", "FISHEYE",
    "EUCM", "EQUIRECTANGULAR",
)  # fmt: skip
_LENS_AXES = np.array([1.0, -1.0, -1.0])
_POINT_BYTES = 24
_LARGEST = 1e12


class _Camera(NamedTuple):
    """A camera as its file has it, and where it stands there."""

    place: str
    model: str
    width: int
    height: int
    numbers: tuple[float, ...]


class _Image(NamedTuple):
    """A photograph as its file has it."""

    place: str
    pose: tuple[float, ...]
    camera: int
    name: str


def find_colmap(folder: Path) -> list[Path]:
    """List the camera files of a folder's first model."""
    for place in _PLACES:
        for suffix in ("bin", "txt"):
            path = folder / place / f"cameras.{suffix}"
            if path.is_file() and path.with_name(f"images.{suffix}").is_file():
                return [path]
    return []


def read_colmap(path: Path, looking: Looking) -> Contents:
    """Read a model by its camera file.

    Raises InputError that names the file, the line or the byte, and the photograph.
    """
    images_path = path.with_name(f"images{path.suffix}")
    if path.suffix == ".bin":
        cameras, images = _binary_cameras(path), list(_binary_images(images_path))
    else:
        cameras, images = _text_cameras(path), list(_text_images(images_path))
    if not images:
        raise InputError(f"{images_path}: no photographs; register some in COLMAP first")
    images.sort(key=lambda image: image.name)
    names = frame_names(images_path, [image.name for image in images], "name")
    where = _image_folder(looking, images)
    frames = tuple(
        _frame(looking, where, name, image, cameras) for name, image in zip(names, images)
    )
    mesh = next(
        (
            looking.folder / folder / name
            for folder in _MESH_FOLDERS
            for name in _MESHES
            if (looking.folder / folder / name).is_file()
        ),
        None,
    )
    models = sorted({camera.model for camera in cameras.values()})
    found = [f"{len(cameras)} camera(s) of COLMAP: {', '.join(models)}"]
    masked = sum(frame.mask_path is not None for frame in frames)
    if masked:
        found.append(f"masks of {masked} photographs in masks/")
    return Contents(Capture(frames, path), (path, images_path), mesh=mesh, found=tuple(found))


def _image_folder(looking: Looking, images: list[_Image]) -> str:
    """Find the folder that the names of photographs start from."""
    first = images[0].name
    for folder in _IMAGE_FOLDERS:
        try:
            if (looking.folder / folder / first).is_file():
                return folder
        except (OSError, ValueError):
            # No name of a file; the message is made where the photograph is looked up.
            break
    return _IMAGE_FOLDERS[0] if (looking.folder / _IMAGE_FOLDERS[0]).is_dir() else "."


def _frame(
    looking: Looking, where: str, name: str, image: _Image, cameras: dict[int, _Camera]
) -> Frame:
    path = looking.resolve(image.place, "name", f"{where}/{image.name}")
    if image.camera not in cameras:
        raise InputError(f"{image.place}: there is no camera {image.camera}; mend CAMERA_ID")
    mask = looking.folder / "masks" / f"{image.name}.png"
    mask_path = looking.resolve(image.place, "mask", str(mask)) if mask.is_file() else None
    return Frame(name, _pinhole(image, cameras[image.camera]), path, mask_path, None)


def _pinhole(image: _Image, camera: _Camera) -> Pinhole:
    model = LENS_MODELS[camera.model]
    named, pose = model.pinhole(camera.numbers), _world_from_camera(image)
    try:
        return Pinhole(
            camera.width,
            camera.height,
            pose,
            fl_x=named["fl_x"],
            fl_y=named.get("fl_y"),
            cx=named["cx"],
            cy=named["cy"],
            lens=model.lens(camera.numbers[model.intrinsics :]),
        )
    except ValueError as error:
        raise InputError(f"{camera.place} ({camera.model}), of {image.name}: {error}") from None


def _world_from_camera(image: _Image) -> Float[np.ndarray, "4 4"]:
    pose = np.array(image.pose)
    # What is larger has no square in floating point.
    plain = np.isfinite(pose).all() and np.abs(pose).max() < _LARGEST
    length = np.linalg.norm(pose[:4]) if plain else 0.0
    if not length > 1 / _LARGEST:
        raise InputError(f"{image.place}: the pose {list(image.pose)} has no rotation; mend it")
    camera_from_world = Rotation.from_quat(pose[:4] / length, scalar_first=True).as_matrix()
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = camera_from_world.T * _LENS_AXES
    world_from_camera[:3, 3] = -camera_from_world.T @ pose[4:]
    return world_from_camera


def _checked(camera: _Camera) -> _Camera:
    if camera.model not in LENS_MODELS:
        raise InputError(
            f"{camera.place}: the camera model {camera.model} is not known here; known are "
            f"{', '.join(LENS_MODELS)}: undistort the photographs with COLMAP first"
        )
    wanted = LENS_MODELS[camera.model].parameters
    if len(camera.numbers) != len(wanted):
        raise InputError(
            f"{camera.place}: {len(camera.numbers)} numbers; {camera.model} has "
            f"{len(wanted)}: {', '.join(wanted)}"
        )
    if not all(map(math.isfinite, camera.numbers)):
        raise InputError(f"{camera.place}: {list(camera.numbers)} are not all finite numbers")
    PIXELS.check(f"{camera.place}: its photographs", camera.width * camera.height)
    return camera


def _text_cameras(path: Path) -> dict[int, _Camera]:
    cameras: dict[int, _Camera] = {}
    for i, line in enumerate(read_text(path, MESH_BYTES).splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        place = f"{path}:{i}"
        try:
            number, model, width, height, *numbers = words
            camera = _Camera(
                place, model, int(width), int(height), tuple(float(word) for word in numbers)
            )
            cameras[int(number)] = _checked(camera)
        except InputError:
            raise
        except ValueError:
            raise InputError(
                f"{place}: wanted CAMERA_ID MODEL WIDTH HEIGHT and numbers, found {line!r}"
            ) from None
    return cameras


def _text_images(path: Path) -> Iterator[_Image]:
    """Read every other line: those between list the points, and may be empty."""
    lines = iter(enumerate(read_text(path, MESH_BYTES).splitlines(), 1))
    for i, line in lines:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        place, words = f"{path}:{i}", line.split(maxsplit=9)
        try:
            pose = tuple(float(word) for word in words[1:8])
            yield _Image(place, pose, int(words[8]), words[9].strip())
        except (ValueError, IndexError):
            raise InputError(
                f"{place}: wanted IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, found {line!r}"
            ) from None
        next(lines, None)


class _Bytes:
    """A binary file, read from its start to its end."""

    def __init__(self, path: Path):
        MESH_BYTES.check(str(path), path.stat().st_size, "give a smaller model")
        self.path, self.content, self.at = path, path.read_bytes(), 0

    def take(self, layout: str) -> tuple:
        """Read numbers of a layout of ``struct``."""
        size = struct.calcsize(layout)
        self.need(size)
        found = struct.unpack_from(layout, self.content, self.at)
        self.at += size
        return found

    def word(self) -> str:
        """Read a text that ends with a zero byte."""
        end = self.content.find(b"\0", self.at)
        self.need(end - self.at if end >= 0 else len(self.content))
        found, self.at = self.content[self.at : end], end + 1
        try:
            return found.decode()
        except UnicodeDecodeError:
            raise InputError(f"{self.path}: byte {self.at}: a name that is no UTF-8") from None

    def need(self, size: int) -> None:
        """Refuse to read beyond the end."""
        if self.at + size > len(self.content):
            raise InputError(
                f"{self.path}: damaged or cut short at byte {self.at}; export the model again"
            )


def _binary_cameras(path: Path) -> dict[int, _Camera]:
    file, cameras = _Bytes(path), {}
    (count,) = file.take("<Q")
    for _ in range(count):
        number, code, width, height = file.take("<IiQQ")
        place = f"{path}: camera {number}"
        model = _MODELS[code] if 0 <= code < len(_MODELS) else f"number {code}"
        wanted = LENS_MODELS[model].parameters if model in LENS_MODELS else ()
        numbers = file.take(f"<{len(wanted)}d")
        cameras[number] = _checked(_Camera(place, model, width, height, numbers))
    return cameras


def _binary_images(path: Path) -> Iterator[_Image]:
    file = _Bytes(path)
    (count,) = file.take("<Q")
    for _ in range(count):
        (number, *pose, camera), name = file.take("<I7dI"), file.word()
        (points,) = file.take("<Q")
        file.need(points * _POINT_BYTES)
        file.at += points * _POINT_BYTES
        yield _Image(f"{path}: image {number} ({name})", tuple(pose), camera, name)
