"""What a surface answers: where does each ray meet it first and facing where, or does it at all?

Host side, NumPy float64.  Shapes are two-sided: a ray that starts inside meets the surface from
behind, and the normals stay those of the surface (outwards), so that callers can tell.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxrender.shapes import checked


class Hits(NamedTuple):
    """First intersections of rays: rows without one are zero, their distance infinite."""

    hit: Bool[np.ndarray, "ray"]
    distance: Float[np.ndarray, "ray"]
    points: Float[np.ndarray, "ray 3"]
    normals: Float[np.ndarray, "ray 3"]  # unit, smooth: for shading
    geometric_normals: Float[np.ndarray, "ray 3"]  # unit, of the face that was hit: for offsets
    face: Int[np.ndarray, "ray"]  # -1 for a miss, or where the shape has no faces
    barycentric: Float[np.ndarray, "ray 3"]  # weights of the face's corners, zero without one


class Shape(eqx.Module):
    """A surface that rays can hit."""

    @abc.abstractmethod
    def first_hits(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Hits:
        """Nearest intersections in front of the origins, distances in world units.

        Directions may have any length but zero.  Origins that lie on the surface must be moved off
        it along the geometric normal first, by about 1e-4 of the shape's diagonal.
        """

    @abc.abstractmethod
    def occluded(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Bool[np.ndarray, "ray"]:
        """Whether rays meet the surface at all; rays as in ``first_hits``, but cheaper."""

    @checked
    def occluded_pairs(
        self,
        origins: Float[np.ndarray, "place 3"],
        directions: Float[np.ndarray, "direction 3"],
        asked: Bool[np.ndarray, "place direction"],
    ) -> Bool[np.ndarray, "place direction"]:
        """The same for those pairs of a place and a direction that are asked for; False elsewhere.

        One thread's portion of work: ``visible`` divides a large one up.
        """
        blocked = np.zeros(asked.shape, bool)
        place, direction = np.nonzero(asked)
        blocked[place, direction] = self.occluded(origins[place], directions[direction])
        return blocked

    @abc.abstractmethod
    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Lower and upper corner of the axis-aligned bounding box."""

    @abc.abstractmethod
    def is_convex(self) -> bool:
        """Whether the surface bounds a convex body, which never shadows or occludes itself."""

    def diagonal(self) -> float:
        """Length of the bounding box's diagonal: the scale for offsets and tolerances."""
        lower, upper = self.bounds()
        return float(np.linalg.norm(upper - lower))


def no_hits(rays: int) -> Hits:
    """A table of that many misses, to be filled in."""
    return Hits(
        np.zeros(rays, bool),
        np.full(rays, np.inf),
        np.zeros((rays, 3)),
        np.zeros((rays, 3)),
        np.zeros((rays, 3)),
        np.full(rays, -1),
        np.zeros((rays, 3)),
    )


def unit_rays(
    origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
) -> tuple[Float[np.ndarray, "ray 3"], Float[np.ndarray, "ray 3"]]:
    """Rays in float64 with unit directions; ValueError for a zero or non-finite one."""
    origins = np.asarray(origins, np.float64)
    directions = np.asarray(directions, np.float64)
    lengths = np.sqrt(np.einsum("ri,ri->r", directions, directions))
    bad = ~(np.isfinite(lengths) & (lengths > 0) & np.isfinite(origins).all(axis=1))
    if bad.any():
        ray = int(np.argmax(bad))
        raise ValueError(
            f"ray {ray} has origin {origins[ray]} and direction {directions[ray]}: "
            "give finite origins and finite, non-zero directions"
        )
    return origins, directions / lengths[:, None]
