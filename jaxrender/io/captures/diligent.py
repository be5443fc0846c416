"""Photometric stereo in the manner of DiLiGenT: one camera, one distant light a photograph.

``light_directions.txt`` has a direction to the light a line, ``light_intensities.txt`` (optional)
its strength in each channel; ``filenames.txt`` names the photographs, or else they are those with
numbers for names; ``mask.png`` is the object.  Directions are x right, y up, z towards the camera.

``K.txt`` (3 x 3) or ``camera.txt`` states a perspective camera at the origin; without one it is
orthographic, with world units of a pixel and the origin in the middle of the picture.
"""

from pathlib import Path

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry.cameras import Camera, Orthographic, Pinhole
from jaxrender.io.captures.capture import Capture, Frame
from jaxrender.io.captures.contents import Contents, StatedLight, StatedSource
from jaxrender.io.captures.paths import IMAGE_SUFFIXES, Looking, frame_names
from jaxrender.io.images import image_size
from jaxrender.io.jsonfiles import read_text
from jaxrender.io.lights import read_per_frame_lights

LOOKED_FOR = "light_directions.txt"
_INTENSITIES, _NAMES, _MASK = "light_intensities.txt", "filenames.txt", "mask.png"
_MATRICES = ("K.txt", "camera.txt")
# Rays of an orthographic camera start this many picture sizes before the object's middle.
_AWAY = 10


def find_diligent(folder: Path) -> list[Path]:
    """Find the directions of lights."""
    path = folder / LOOKED_FOR
    return [path] if path.is_file() else []


def read_diligent(path: Path, looking: Looking) -> Contents:
    """Read photographs, their lights and their camera; raises InputError with file and line."""
    folder, files = path.parent, [path]
    names = _stated_names(folder, looking, files)
    intensities = folder / _INTENSITIES
    has_intensities = intensities.is_file()
    lights = read_per_frame_lights(path, names, intensities if has_intensities else None)
    if has_intensities:
        files.append(intensities)
    mask = looking.resolve(str(path), "mask", _MASK) if (looking.folder / _MASK).is_file() else None
    paths = [looking.resolve(f"{path}: photograph {i}", "name", n) for i, n in enumerate(names)]
    camera, said = _camera(folder, paths[0], files)
    frames = tuple(
        Frame(name, camera, image, mask, None)
        for name, image in zip(frame_names(path, names, "name"), paths)
    )
    per_frame = tuple(
        tuple(
            StatedSource(tuple(map(float, direction)), tuple(map(float, irradiance)))
            for direction, irradiance in zip(*(np.asarray(part) for part in one.nodes()))
        )
        for one in lights
    )
    brightness = "their intensities as irradiance" if has_intensities else "an irradiance of 1"
    found = [f"one distant light a photograph, with {brightness}"]
    found += ["the object is where mask.png is white"] if mask else []
    return Contents(
        Capture(frames, path),
        tuple(files),
        light=StatedLight(per_frame=per_frame),
        response="linear",
        found=tuple(found),
        assumed=(said,),
    )


def _stated_names(folder: Path, looking: Looking, files: list[Path]) -> list[str]:
    """List the photographs: as they are named, or those with numbers for names."""
    stated = folder / _NAMES
    if stated.is_file():
        files.append(stated)
        return [line.strip() for line in read_text(stated).splitlines() if line.strip()]
    numbered = [
        one.name
        for one in looking.folder.iterdir()
        if one.suffix.lower() in IMAGE_SUFFIXES and one.stem.isdecimal()
    ]
    if not numbered:
        raise InputError(f"{folder}: no {_NAMES}, and no photographs with numbers for names")
    return sorted(numbered, key=lambda name: int(Path(name).stem))


def _camera(folder: Path, image: Path, files: list[Path]) -> tuple[Camera, str]:
    width, height = image_size(image)
    pose = np.eye(4)
    for name in _MATRICES:
        path = folder / name
        if path.is_file():
            files.append(path)
            k = _matrix(path)
            lengths = {"fl_x": k[0, 0], "fl_y": k[1, 1]}
            try:
                camera = Pinhole(width, height, pose, **lengths, cx=k[0, 2] + 0.5, cy=k[1, 2] + 0.5)
            except ValueError as error:
                raise InputError(f"{path}: {error}") from None
            return camera, (
                f"a perspective camera at the origin that looks along -z ({name}); its principal "
                "point is counted from the middle of the first pixel"
            )
    pose[2, 3] = _AWAY * max(width, height)
    return Orthographic(width, height, pose, scale=1.0), (
        "an orthographic camera that looks along -z: a pixel is a world unit, and the origin is in "
        "the middle of the picture"
    )


def _matrix(path: Path) -> np.ndarray:
    words = read_text(path).replace(",", " ").split()
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        numbers = np.zeros(0)
    if numbers.size != 9 or not np.isfinite(numbers).all():
        raise InputError(f"{path}: wanted 3 x 3 numbers, the matrix of a camera")
    return numbers.reshape(3, 3)
