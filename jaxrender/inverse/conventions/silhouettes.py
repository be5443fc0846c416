"""Silhouettes of the object in its photographs, and how much of them a shape overlaps.

Overlap is intersection over union, of one photograph.  Shapes are traced at a low resolution.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.geometry import Camera, Placement, Shape, camera_from, shrunk_camera
from jaxrender.inverse.conventions.framings import Framing
from jaxrender.inverse.conventions.outlines import outlined
from jaxrender.inverse.photographs import Reading, mask_of
from jaxrender.io import Capture, Image
from jaxrender.shapes import Bool, Float

# The opacity from which on a pixel shows the object.
_OPAQUE = 0.5


class Silhouettes(NamedTuple):
    """What is seen of the object: cameras and masks as the files have them.

    ``guessed`` are the photographs whose silhouette was found without a mask.  Photographs in which
    nothing was found are left out; ``names`` are those of the others.
    """

    names: tuple[str, ...]
    cameras: tuple[Camera, ...]
    masks: tuple[Bool[np.ndarray, "_ _"], ...]
    guessed: tuple[str, ...] = ()

    @classmethod
    def of(cls, capture: Capture, images: list[Image], reading: Reading) -> "Silhouettes":
        """Take masks, alpha channels, or what stands out from a photograph's border.

        The images are as the files have them, whatever the reading says of mirrors.
        """
        found, guessed = [], []
        for frame, image in zip(capture.frames, images, strict=True):
            mask = mask_of(frame, reading._replace(mirrored=False))
            if image.alpha is not None and image.alpha.min() < _OPAQUE:
                opaque = image.alpha >= _OPAQUE
                mask = opaque if mask is None else mask & opaque
            if mask is None:
                mask = outlined(np.asarray(image.pixels, float))
                guessed.append(frame.name)
            if mask.any():
                found.append((frame.name, frame.camera, mask))
        names, cameras, masks = zip(*found) if found else ((), (), ())
        return cls(names, cameras, masks, tuple(name for name in guessed if name in names))

    def shrunk(self, longest: int) -> "Silhouettes":
        """Make pixels larger, until the longest side has at most so many."""
        cameras, masks = [], []
        for camera, mask in zip(self.cameras, self.masks):
            factor = -(-max(mask.shape) // longest)
            small = shrunk_camera(camera, factor)
            cut = mask[: small.height * factor, : small.width * factor].astype(float)
            blocks = cut.reshape(small.height, factor, small.width, factor).mean(axis=(1, 3))
            cameras.append(small)
            # What is thinner than a pixel is where most of it is.
            masks.append((blocks >= min(0.5, float(blocks.max()))) & (blocks > 0))
        return self._replace(cameras=tuple(cameras), masks=tuple(masks))

    def some(self, count: int) -> "Silhouettes":
        """Keep so many of them, evenly."""
        kept = np.unique(np.linspace(0, len(self.names) - 1, min(count, len(self.names))).round())
        parts = ((part[int(k)] for k in kept) for part in self[:3])
        names, cameras, masks = (tuple(part) for part in parts)
        return Silhouettes(names, cameras, masks)  # pyright: ignore[reportArgumentType]

    def meant(self, framing: Framing) -> "Silhouettes":
        """Read cameras and masks as a framing means them."""
        masks = self.masks
        if framing.mirrored:
            masks = tuple(mask[:, ::-1] for mask in masks)
        cameras = tuple(camera_from(camera, framing.axes) for camera in self.cameras)
        return self._replace(cameras=cameras, masks=masks)

    def overlaps(
        self, shape: Shape, placement: Placement | None = None
    ) -> Float[np.ndarray, "photograph"]:
        """Trace a shape, and say how much it overlaps each photograph's silhouette."""
        pairs = zip(self.cameras, self.masks)
        return np.array(
            [overlap(mask, covered(camera, shape, placement)) for camera, mask in pairs]
        )


def covered(
    camera: Camera, shape: Shape, placement: Placement | None = None
) -> Bool[np.ndarray, "row column"]:
    """Say where a camera sees a shape, which may be placed elsewhere."""
    rays = camera.rays()
    origins, directions = rays.origins.reshape(-1, 3), rays.directions.reshape(-1, 3)
    if placement is not None:
        # The rays are moved instead, so that no tree of triangles is built anew.
        back = placement.inverse
        origins, directions = back.points(origins), directions @ back.rotation.T
    hit = shape.occluded(np.ascontiguousarray(origins), np.ascontiguousarray(directions))
    return hit.reshape(rays.directions.shape[:2])


def overlap(one: Bool[np.ndarray, "row column"], other: Bool[np.ndarray, "row column"]) -> float:
    """Divide the intersection by the union; nothing in common of nothing is 0."""
    union = np.count_nonzero(one | other)
    return float(np.count_nonzero(one & other) / union) if union else 0.0
