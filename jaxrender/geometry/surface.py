"""What a camera sees of a shape: the geometry behind every pixel, traced once and kept."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxrender.geometry.cameras import Camera
from jaxrender.geometry.hits import Shape

# Neighbouring pixels see normals that differ by less than this, in degrees, where the pixels are
# fine enough for the surface.  Of a ball 16 pixels wide all but those at its rim do.
CONTOUR = 30.0


class SurfaceView(NamedTuple):
    """Surface points behind the pixels of one photograph; all zero where ``hit`` is False.

    ``face`` is -1 there, and everywhere on shapes without faces.
    """

    hit: Bool[np.ndarray, "row column"]
    points: Float[np.ndarray, "row column 3"]
    normals: Float[np.ndarray, "row column 3"]
    outgoing: Float[np.ndarray, "row column 3"]  # unit, from the point to the camera
    exit_cosines: Float[np.ndarray, "row column"]  # N.V, positive where hit
    geometric_normals: Float[np.ndarray, "row column 3"]  # of the face, not interpolated
    face: Int[np.ndarray, "row column"]
    barycentric: Float[np.ndarray, "row column 3"]  # weights of the face's three corners


def observe(camera: Camera, shape: Shape) -> SurfaceView:
    """The first surface point of every pixel's central ray.

    A pixel that sees the back of a face (a hole in a scan), or whose interpolated normal faces away
    although the face does not (silhouettes of coarse meshes), counts as not hit: no reflection
    model has a value there.  Nor is a pixel hit to which the lens shows nothing.
    """
    rays = camera.rays()
    image = rays.directions.shape[:2]
    outgoing = -rays.directions.reshape(-1, 3)
    shown = np.all(np.isfinite(outgoing), axis=1, keepdims=True)
    # No tracer is asked for what is no direction.
    outgoing = np.where(shown, outgoing, [0.0, 0.0, 1.0])
    hits = shape.first_hits(rays.origins.reshape(-1, 3), -outgoing)
    cosines = np.einsum("ri,ri->r", hits.normals, outgoing)
    front = np.einsum("ri,ri->r", hits.geometric_normals, outgoing) > 0
    usable = shown.ravel() & hits.hit & front & (cosines > 0)

    def seen(vectors: Float[np.ndarray, "ray 3"]) -> Float[np.ndarray, "row column 3"]:
        return np.where(usable[:, None], vectors, 0).reshape(*image, 3)

    return SurfaceView(
        usable.reshape(image),
        seen(hits.points),
        seen(hits.normals),
        seen(outgoing),
        np.where(usable, cosines, 0).reshape(image),
        seen(hits.geometric_normals),
        np.where(usable, hits.face, -1).reshape(image),
        seen(hits.barycentric),
    )


def contours(view: SurfaceView, angle: float = CONTOUR) -> Bool[np.ndarray, "row column"]:
    """Find the pixels beside which the surface breaks off or bends sharply.

    One part ends there before another, or a fold is smaller than a pixel.  Such a pixel shows a
    mean over surfaces, and its central ray meets only one of them.  Two neighbours that see the
    object are found where their normals differ by more than ``angle`` (degrees), and where the
    line between their points leaves the tangent plane of either by more than that.
    """
    found = np.zeros(view.hit.shape, bool)
    least, most = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        one, other = _neighbours(view.hit.shape, down, right)
        normals, others = view.normals[one], view.normals[other]
        chord = view.points[other] - view.points[one]
        length = np.linalg.norm(chord, axis=-1)
        leaves = np.maximum(
            np.abs(np.einsum("rci,rci->rc", chord, normals)),
            np.abs(np.einsum("rci,rci->rc", chord, others)),
        )
        sharp = (np.einsum("rci,rci->rc", normals, others) < least) | (leaves > most * length)
        sharp &= view.hit[one] & view.hit[other]
        found[one] |= sharp
        found[other] |= sharp
    return found


def _neighbours(
    shape: tuple[int, ...], down: int, right: int
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Cut an image so that each pixel of one part has its neighbour in the other."""
    rows, columns = shape
    first = slice(max(0, -right), columns - max(0, right))
    second = slice(max(0, right), columns - max(0, -right))
    return (slice(0, rows - down), first), (slice(down, rows), second)
