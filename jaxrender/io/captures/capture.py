"""Photographs with their cameras, and their pixels."""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from jaxrender.errors import InputError
from jaxrender.geometry.cameras import Camera
from jaxrender.io.images import MEND, Image, read_image


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


def _check_size(frame: Frame, path: Path, image: Image) -> None:
    height, width = image.pixels.shape[:2]
    if (width, height) != (frame.camera.width, frame.camera.height):
        raise InputError(
            f"{path}: frame {frame.name}: the picture is {width} x {height} pixels, its camera "
            f"says {frame.camera.width} x {frame.camera.height}; scale the one or the other"
        )
