"""The ways in which a panorama may be meant: its layout, mirrored or not, turned about its up."""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from jaxrender.lighting import PANORAMAS, panorama_named, to_latlong
from jaxrender.shapes import Float, ImageArray

# Pictures are first averaged to so many times the rows that are wanted.
_FINER = 3


class Orientation(NamedTuple):
    """How a panorama is meant; ``yaw`` in degrees, as ``io.read_environment`` takes it."""

    convention: str = "z-up"
    mirrored: bool = False
    yaw: float = 0.0

    def turned(self, yaw: float) -> "Orientation":
        """Turn it to another yaw, kept above -180 and up to 180 degrees."""
        return self._replace(yaw=180 - (180 - yaw) % 360)

    def off(self, other: "Orientation") -> float:
        """By how many degrees the yaws differ."""
        return abs((self.yaw - other.yaw + 180) % 360 - 180)

    def changes(self, told: "Orientation") -> int:
        """Count what is other than told."""
        return sum(one != other for one, other in zip(self, told, strict=True))

    def words(self) -> str:
        """Say it in words."""
        mirrored = " mirrored," if self.mirrored else ""
        return f"environment `{self.convention}`,{mirrored} yaw {self.yaw:.3g}"


class Panoramas(NamedTuple):
    """A picture read in each layout that its shape allows: few rows of each."""

    images: dict[str, Float[np.ndarray, "row column channel"]]

    @classmethod
    def of(cls, picture: ImageArray, height: int) -> "Panoramas":
        """Resample the picture to so many rows.  ``ValueError`` if it is no panorama at all."""
        images = {}
        for convention, panorama in PANORAMAS.items():
            try:
                small = _blocks(np.asarray(picture, float), panorama.aspect, height)
                images[convention] = to_latlong(small, convention, height)
            except ValueError:
                continue
        if not images:
            rows, columns = np.shape(picture)[:2]
            raise ValueError(
                f"the picture is {columns} x {rows} (width x height), which no layout has: "
                f"give one of {', '.join(PANORAMAS)}"
            )
        return cls(images)

    @property
    def layouts(self) -> list[Orientation]:
        """List the layouts, each as it is and mirrored."""
        return [Orientation(name, mirror) for name in self.images for mirror in (False, True)]

    def radiance(
        self, orientation: Orientation, directions: Float[np.ndarray, "direction 3"]
    ) -> Float[np.ndarray, "direction channel"]:
        """Look up what comes from world directions."""
        panorama = panorama_named(orientation.convention)
        turn = Rotation.from_rotvec(orientation.yaw * panorama.up, degrees=True).as_matrix()
        unturned = directions @ turn
        if orientation.mirrored:
            # To the right in the middle of the picture is y of z-up, and x of all others.
            axis = 1 if orientation.convention == "z-up" else 0
            unturned = unturned * np.where(np.arange(3) == axis, -1, 1)
        image = self.images[orientation.convention]
        rows, columns = np.moveaxis(PANORAMAS["z-up"].pixels(unturned, len(image)) - 0.5, -1, 0)
        # The columns wrap, and nothing lies beyond a pole.
        wrapped = np.concatenate([image[:, -1:], image, image[:, :1]], axis=1)
        places = np.stack([np.clip(rows, 0, len(image) - 1), columns + 1])
        layers = [map_coordinates(c, places, order=1) for c in np.moveaxis(wrapped, -1, 0)]
        return np.stack(layers, axis=-1)


def _blocks(
    picture: Float[np.ndarray, "row column channel"], aspect: tuple[int, int], height: int
) -> Float[np.ndarray, "row column channel"]:
    """Average blocks of a picture that has many more rows than are wanted, keeping its aspect."""
    (rows, columns), (across, down) = picture.shape[:2], aspect
    most = rows // (_FINER * height)
    fits = (f for f in range(most, 1, -1) if not (rows % (f * down) or columns % (f * across)))
    factor = next(fits, 1)
    shape = (rows // factor, factor, columns // factor, factor, -1)
    return picture.reshape(shape).mean(axis=(1, 3))
