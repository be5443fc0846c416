"""Objects With Lighting: tone-mapped photographs with cameras, masks and one panorama.

A folder ``test`` of an object has ``inputs/`` with ``image_xxxx.png``, ``camera_xxxx.txt`` and
``mask_xxxx.png``, and ``exposure.txt``, the e of the stored values (x 2^e)^(1 / 2.2) of radiance x.
Beside it are ``env.hdr`` with ``world_to_env.txt``, and ``env_512_rotated.hdr``, the same in the
axes of the world.

A camera is K (3 x 3), R (3 x 3), t and ``width height channels``, and projects X to K (R X + t), y
down and z ahead; pixel centres lie at half integers.  Of a panorama +z is at the top, +x in the
middle and +y at a quarter of the width.
"""

from pathlib import Path

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry.cameras import Pinhole
from jaxrender.imaging.response import Curve
from jaxrender.io.captures.capture import Capture, Frame
from jaxrender.io.captures.contents import Contents, StatedEnvironment, StatedLight
from jaxrender.io.captures.paths import Looking, frame_names
from jaxrender.io.jsonfiles import read_text
from jaxrender.limits import PIXELS
from jaxrender.shapes import Float

LOOKED_FOR = "inputs/camera_*.txt beside inputs/exposure.txt"
_EXPOSURE, _WHOLE, _ROTATED, _MATRIX = (
    "exposure.txt", "env.hdr", "env_512_rotated.hdr", "world_to_env.txt",
)  # fmt: skip
_GAMMA = 2.2
_LARGEST = 1e12
# Exposures beyond this many stops are damage.
_MOST_STOPS = 64
_FLIP = np.diag([1.0, -1.0, -1.0])
# What a mirrored z-up panorama has at its left edge, this has in the middle.
_YAW = 180.0
_HALF_TURN = np.diag([-1.0, -1.0, 1.0])


def find_objects_with_lighting(folder: Path) -> list[Path]:
    """Find the exposure of the inputs, in the folder or in its ``inputs``."""
    places = [folder / "inputs", folder]
    return [
        place / _EXPOSURE
        for place in places
        if (place / _EXPOSURE).is_file() and any(place.glob("camera_*.txt"))
    ]


def read_objects_with_lighting(path: Path, looking: Looking) -> Contents:
    """Read cameras, photographs, masks, tone curve and light; raises InputError."""
    folder = path.parent
    exposure = float(_numbers(path, (1,))[0])
    if abs(exposure) > _MOST_STOPS:
        raise InputError(f"{path}: an exposure of {exposure:g} stops; mend the number")
    stated = sorted(folder.glob("camera_*.txt"))
    looking = looking._replace(folder=folder)
    values = [one.stem.replace("camera_", "image_") for one in stated]
    frames = tuple(
        _frame(one, name, value, looking)
        for one, name, value in zip(stated, frame_names(path, values, "camera"), values)
    )
    panorama, files = _panorama(folder.parent)
    found = ["an approximate mask of each photograph"] * all(f.mask_path for f in frames)
    found.append(f"tone-mapped pixels, (x 2^{exposure:g})^(1 / 2.2) of radiance x")
    if panorama is not None:
        found.append(
            f"the light is {panorama.path.name}, which the benchmark keeps from methods: take "
            "`lighting` out and say `task: factorize` to compare with them"
        )
    return Contents(
        Capture(frames, path),
        (path, *stated, *files),
        light=StatedLight(panorama),
        curve=_tone_curve(exposure),
        found=tuple(found),
    )


def _tone_curve(exposure: float) -> Curve:
    """Undo the tone mapping, exactly at the values of 8 bits."""
    values = np.arange(256) / 255
    return Curve(values, values**_GAMMA / 2**exposure)


def _frame(path: Path, name: str, value: str, looking: Looking) -> Frame:
    numbers = _numbers(path, (24,))
    matrix, turn = numbers[:9].reshape(3, 3), numbers[9:18].reshape(3, 3)
    width, height = int(numbers[21]), int(numbers[22])
    PIXELS.check(f"{path}: width x height", max(width, 0) * max(height, 0))
    if abs(matrix[0, 1]) > 1e-6 * abs(matrix[0, 0]):
        raise InputError(f"{path}: the camera has a skew of {matrix[0, 1]:g}, which is not read")
    _check_rotation(path, turn)
    pose = np.eye(4)
    pose[:3, :3] = turn.T @ _FLIP
    pose[:3, 3] = -turn.T @ numbers[18:21]
    fl_x, fl_y, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    try:
        camera = Pinhole(width, height, pose, fl_x=fl_x, fl_y=fl_y, cx=cx, cy=cy)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    image = looking.resolve(str(path), "image", value)
    mask = path.with_name(path.stem.replace("camera_", "mask_") + ".png")
    return Frame(name, camera, image, mask if mask.is_file() else None, None)


def _panorama(folder: Path) -> tuple[StatedEnvironment | None, list[Path]]:
    """State the light: in the axes of the world, or turned to them."""
    rotated, whole, matrix = (folder / name for name in (_ROTATED, _WHOLE, _MATRIX))
    if rotated.is_file():
        return StatedEnvironment(rotated, "z-up", mirrored=True, yaw=_YAW), [rotated]
    if not (whole.is_file() and matrix.is_file()):
        return None, []
    turn = _numbers(matrix, (16, 12)).reshape(-1, 4)[:3, :3]
    _check_rotation(matrix, turn)
    return (
        StatedEnvironment(whole, "z-up", turn=turn.T @ _HALF_TURN, mirrored=True),
        [whole, matrix],
    )


def _check_rotation(path: Path, turn: Float[np.ndarray, "3 3"]) -> None:
    if not np.abs(turn @ turn.T - np.eye(3)).max() < 1e-4 or np.linalg.det(turn) < 0:
        raise InputError(f"{path}: its 3 x 3 numbers are no rotation")


def _numbers(path: Path, counts: tuple[int, ...]) -> Float[np.ndarray, "number"]:
    """Read so many numbers; raises InputError for other text."""
    try:
        numbers = np.array([float(word) for word in read_text(path).split()])
    except ValueError:
        numbers = np.zeros(0)
    # What is larger has no square in floating point.
    if numbers.size not in counts or not (np.abs(numbers) < _LARGEST).all():
        wanted = " or ".join(map(str, counts))
        raise InputError(f"{path}: wanted {wanted} finite numbers, none above {_LARGEST:g}")
    return numbers
