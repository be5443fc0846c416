"""Rectified photographs of a flat sample with the places of camera and flash (``parameters.json``).

Each picture is the sample alone, resampled to a square: columns along x, rows down along -y, z
towards the camera.  ``image_size`` is the sample's side, ``camera_pos`` and ``light_pos`` are a
place for each photograph, in the same unit; ``light_pow`` is the intensity in each channel.
``idx`` lists the numbers of the photographs, ``images_dir`` their folder.

A rectified picture is that of a pinhole camera which looks straight down, with its principal point
where it stands above the sample.
"""

from pathlib import Path
from typing import Any

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry.cameras import Pinhole
from jaxrender.io.captures.capture import Capture, Frame
from jaxrender.io.captures.contents import Contents, StatedLight, StatedPoint, StatedSquare
from jaxrender.io.captures.paths import IMAGE_SUFFIXES, Looking, frame_names
from jaxrender.io.images import image_size
from jaxrender.io.jsonfiles import read_json
from jaxrender.shapes import Float

LOOKED_FOR = "parameters.json"
_KEYS = ("image_size", "camera_pos", "light_pos", "light_pow")


def find_flash(folder: Path) -> list[Path]:
    """Find a list of places."""
    path = folder / LOOKED_FOR
    return [path] if path.is_file() else []


def read_flash(path: Path, looking: Looking) -> Contents:
    """Read photographs, places and lights; raises InputError with the file and the key."""
    stated = read_json(path)
    if not isinstance(stated, dict):
        raise InputError(f"{path}: wanted an object with the keys {', '.join(_KEYS)}")
    missing = [key for key in _KEYS if key not in stated]
    if missing:
        raise InputError(f"{path}: the key `{missing[0]}` is missing")
    side = _numbers(path, stated, "image_size", ())
    if not side > 0:
        raise InputError(f"{path}: `image_size` is {float(side):g}; give the side of the sample")
    eyes = _numbers(path, stated, "camera_pos", (None, 3))
    lamps = _numbers(path, stated, "light_pos", (len(eyes), 3))
    power = _numbers(path, stated, "light_pow", (3,))
    if (power < 0).any():
        raise InputError(f"{path}: `light_pow` {power.tolist()} is negative")
    for key, places in (("camera_pos", eyes), ("light_pos", lamps)):
        low = np.flatnonzero(places[:, 2] <= 0)
        if low.size:
            raise InputError(f"{path}: `{key}` {low[0]} lies below the sample: z must be above 0")
    names = _names(path, stated, len(eyes), looking)
    images = [looking.resolve(f"{path}: photograph {i}", "name", n) for i, n in enumerate(names)]
    frames = tuple(
        Frame(name, _above(image, eye, float(side)), image, None, None)
        for name, image, eye in zip(frame_names(path, names, "name"), images, eyes)
    )
    intensity = tuple(map(float, power))
    per_frame = tuple((StatedPoint(tuple(map(float, place)), intensity),) for place in lamps)
    same = np.array_equal(eyes, lamps)
    return Contents(
        Capture(frames, path),
        (path,),
        square=StatedSquare(float(side)),
        light=StatedLight(per_frame=per_frame),
        head_on=same,
        found=(
            f"a flat sample of side {float(side):g} about the origin, z towards the camera",
            "one flash a photograph, " + ("where the camera stands" if same else "with its place"),
            *(["facets are met head on: mu cannot be told (brdf.mu: none)"] if same else []),
        ),
    )


def _above(image: Path, eye: Float[np.ndarray, "3"], side: float) -> Pinhole:
    """Make the camera that sees the rectified sample from its place."""
    width, height = image_size(image)
    pose = np.eye(4)
    pose[:3, 3] = eye
    across, down = width / side, height / side
    return Pinhole(
        width,
        height,
        pose,
        fl_x=float(eye[2] * across),
        fl_y=float(eye[2] * down),
        cx=float((side / 2 + eye[0]) * across),
        cy=float((side / 2 - eye[1]) * down),
    )


def _names(path: Path, stated: dict[str, Any], count: int, looking: Looking) -> list[str]:
    """List the photographs: those with the numbers of ``idx`` for names, in their folder."""
    numbers = stated.get("idx", list(range(count)))
    whole = isinstance(numbers, list) and all(type(number) is int for number in numbers)
    if not whole or len(numbers) != count:
        raise InputError(f"{path}: `idx` is {numbers!r}; wanted {count} whole numbers")
    inside = stated.get("images_dir", "")
    if not isinstance(inside, str):
        raise InputError(f"{path}: `images_dir` is {inside!r}; wanted the name of a folder")
    # The folder of the photographs may have been left out when they were copied.
    folder = inside if inside and (looking.folder / inside).is_dir() else ""
    pictures = {
        int(one.stem): f"{folder}/{one.name}" if folder else one.name
        for one in sorted((looking.folder / folder).iterdir())
        if one.suffix.lower() in IMAGE_SUFFIXES and one.stem.isdecimal()
    }
    absent = [number for number in numbers if number not in pictures]
    if absent:
        place = looking.folder / folder
        raise InputError(f"{path}: photograph {absent[0]} (`idx`) is not in {place}")
    return [pictures[number] for number in numbers]


def _numbers(
    path: Path, stated: dict[str, Any], key: str, shape: tuple[int | None, ...]
) -> Float[np.ndarray, "..."]:
    """Read an array of finite numbers of a shape, in which None is any length above 0."""
    try:
        found = np.array(stated[key], float)
    except (TypeError, ValueError):
        found = np.full((0, 0, 0, 0), np.nan)
    fits = found.ndim == len(shape) and all(
        size > 0 if wanted is None else size == wanted for size, wanted in zip(found.shape, shape)
    )
    if not fits or not np.isfinite(found).all():
        words = {
            (): "a number",
            (3,): "three numbers",
        }.get(shape, "a list of places, three numbers each, one for every photograph")
        raise InputError(f"{path}: `{key}` is {str(stated[key])[:60]}; wanted {words}")
    return found
