"""Surfaces that light leaves through: places (u, v) in the unit square, points, frames and areas.

A surface maps (u, v) to points x'(u, v).  Its own frame at a point has the normal as +Z, which is
that of dx'/du x dx'/dv and points outwards, and +X along dx'/du.  Area is

    dA = |dx'/du x dx'/dv| du dv,

the Jacobian that L 6.7 leaves out (ERRATA 69).  For sampling (L 8.6) each surface draws places that
a point can see, if there is a simple way to, and knows the density with which it does: per
steradian at that point, r^2 / cos t_e times that per area, zero for places turned away from it.

Host side, NumPy float64, as all of ray tracing.  Rays start off the surface.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxrender.shapes import AnyArray, Bool, Float

Points = Float[np.ndarray, "point 3"]
Places = Float[np.ndarray, "point 2"]
Numbers = Float[np.ndarray, "point"]

# Crossings nearer than this part of the surface's size are the surface that a ray starts on.
_NEAREST = 1e-9
# Edges of a rectangle: the cosine of the angle between them.
_UPRIGHT = 1e-9


class SurfacePoints(NamedTuple):
    """Points of a surface, their frames, and the area of a unit of du dv."""

    points: Float[np.ndarray, "point 3"]
    frames: Float[np.ndarray, "point 3 3"]
    """``world_from_local``: columns along dx'/du, across it, and the outward normal."""
    area: Float[np.ndarray, "point"]

    @property
    def normals(self) -> Points:
        """Unit, outwards."""
        return self.frames[:, :, 2]


class Crossings(NamedTuple):
    """Where rays cross a surface first; infinitely far if nowhere."""

    distance: Float[np.ndarray, "ray"]
    places: Float[np.ndarray, "ray 2"]


class EmittingSurface(eqx.Module):
    """A surface over the unit square."""

    @property
    @abc.abstractmethod
    def convex(self) -> bool:
        """Whether no part of its outside is ever hidden by another."""

    @abc.abstractmethod
    def at(self, places: Places) -> SurfacePoints:
        """Evaluate points, frames and areas."""

    @abc.abstractmethod
    def crossings(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Crossings:
        """Find where rays of unit direction meet the surface first, from either side."""

    @abc.abstractmethod
    def importance(self, points: Points) -> Numbers:
        """Guess the solid angle it fills; positive wherever some of its outside may be seen."""

    @abc.abstractmethod
    def drawn(self, points: Points, uniforms: Places) -> Places:
        """Draw a place for each point from two uniform numbers."""

    @abc.abstractmethod
    def density(self, points: Points, places: Places) -> Numbers:
        """Evaluate the density of ``drawn`` per steradian; 0 for places turned away."""


class Rectangle(EmittingSurface):
    """x' = corner + u along_u + v along_v; it shines to the side of along_u x along_v.

    Raises ``ValueError`` for numbers that are not finite and for edges that are zero or not
    perpendicular.
    """

    corner: Float[np.ndarray, "3"]
    along_u: Float[np.ndarray, "3"]
    along_v: Float[np.ndarray, "3"]

    def __init__(
        self, corner: Float[AnyArray, "3"], along_u: Float[AnyArray, "3"], along_v: AnyArray
    ):
        self.corner, self.along_u, self.along_v = (
            np.asarray(v, np.float64) for v in (corner, along_u, along_v)
        )
        lengths = self.lengths
        if not np.isfinite(self.corner).all() or not (np.isfinite(lengths) & (lengths > 0)).all():
            raise ValueError(
                f"a rectangle at {self.corner} with edges {self.along_u} and {self.along_v}: give "
                "finite numbers and edges that are not zero"
            )
        if abs(self.along_u @ self.along_v) > _UPRIGHT * lengths.prod():
            raise ValueError(
                f"edges {self.along_u} and {self.along_v} are not perpendicular; use a "
                "`ParametricSurface` for other quadrilaterals"
            )

    @property
    def lengths(self) -> Float[np.ndarray, "2"]:
        """Of the edges."""
        return np.array([np.linalg.norm(self.along_u), np.linalg.norm(self.along_v)])

    @property
    def frame(self) -> Float[np.ndarray, "3 3"]:
        """``world_from_local``, the same everywhere."""
        x, y = self.along_u / self.lengths[0], self.along_v / self.lengths[1]
        return np.stack([x, y, np.cross(x, y)], axis=-1)

    @property
    def convex(self) -> bool:
        """Always."""
        return True

    def at(self, places: Places) -> SurfacePoints:
        """The map is linear."""
        points = self.corner + places @ np.stack([self.along_u, self.along_v])
        count = len(places)
        frames = np.broadcast_to(self.frame, (count, 3, 3))
        return SurfacePoints(points, frames, np.full(count, self.lengths.prod()))

    def crossings(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Crossings:
        """Cross the plane, then ask whether within the edges."""
        local, along = (origins - self.corner) @ self.frame, directions @ self.frame
        steep = along[:, 2] != 0
        distance = -local[:, 2] / np.where(steep, along[:, 2], 1)
        places = (local[:, :2] + distance[:, None] * along[:, :2]) / self.lengths
        within = ((places >= 0) & (places <= 1)).all(axis=1)
        return kept(steep & within, distance, places, float(self.lengths.max()))

    def importance(self, points: Points) -> Numbers:
        """Exactly its solid angle, by its corners; 0 behind it.

        Of the rectangle from the foot of the point to (x, y), seen from height z, it is
        arctan(x y / (z sqrt(x^2 + y^2 + z^2))).
        """
        local = (points - self.corner) @ self.frame
        height = local[:, 2]
        angle = np.zeros(len(points))
        for i, x in enumerate((-local[:, 0], self.lengths[0] - local[:, 0])):
            for j, y in enumerate((-local[:, 1], self.lengths[1] - local[:, 1])):
                reach = np.sqrt(x * x + y * y + height**2)
                angle += (-1) ** (i + j) * np.arctan2(x * y, np.abs(height) * reach)
        return np.where(height > 0, np.maximum(angle, 0), 0)

    def drawn(self, points: Points, uniforms: Places) -> Places:
        """Evenly over the area."""
        return uniforms

    def density(self, points: Points, places: Places) -> Numbers:
        """One over the area."""
        return per_solid_angle(points, self.at(places), 1 / self.lengths.prod())


def box_faces(
    lower: Float[AnyArray, "3"], upper: Float[AnyArray, "3"]
) -> tuple[Rectangle, Rectangle, Rectangle, Rectangle, Rectangle, Rectangle]:
    """Make the faces of a box, normals outwards, in the order -x, +x, -y, +y, -z, +z.

    Raises ``ValueError`` as ``Rectangle`` for a box without volume, and for corners exchanged.
    """
    lower, upper = np.asarray(lower, np.float64), np.asarray(upper, np.float64)
    if not (upper > lower).all():
        raise ValueError(f"a box from {lower} to {upper}; upper coordinates must be the larger")
    edges = np.diag(upper - lower)
    faces = []
    for axis in range(3):
        first, second = edges[(axis + 1) % 3], edges[(axis + 2) % 3]
        faces.append(Rectangle(lower, second, first))
        faces.append(Rectangle(lower + edges[axis], first, second))
    return tuple(faces)


def per_solid_angle(points: Points, on: SurfacePoints, per_area: Numbers | float) -> Numbers:
    """Turn a density per area into one per steradian seen from points; 0 for what faces away."""
    towards = points - on.points
    square = np.einsum("pi,pi->p", towards, towards)
    cosine = np.einsum("pi,pi->p", on.normals, towards)
    facing = cosine > 0
    return np.where(facing, per_area * square**1.5 / np.where(facing, cosine, 1), 0)


def kept(
    there: Bool[np.ndarray, "ray"],
    distance: Float[np.ndarray, "ray"],
    places: Float[np.ndarray, "ray 2"],
    size: float,
) -> Crossings:
    """Leave out crossings that are not there, behind the origin, or at it."""
    there = there & (distance > _NEAREST * size)
    return Crossings(np.where(there, distance, np.inf), np.where(there[:, None], places, 0))
