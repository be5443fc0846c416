"""Spheres and cylinders that light leaves through (L 5.3.1, 5.3.4; sampling as L 8.6 cites it).

Both have u = azimuth / 2 pi about +Z or the cylinder's axis, and v upwards along it: on a sphere
v = 1 - polar angle / pi, so that area is 2 pi^2 r^2 sin(pi v) du dv, and a table is denser at the
poles.  Normals point outwards.  Seen from a point outside, the sphere is drawn evenly by solid
angle, within the cone that it fills; the cylinder evenly over the part of its side that can be
seen.  Points inside see nothing: light leaves outwards.
"""

import numpy as np

from jaxrender.lighting.luminaires.surfaces import (
    Crossings,
    EmittingSurface,
    Numbers,
    Places,
    Points,
    SurfacePoints,
    kept,
    per_solid_angle,
)
from jaxrender.shapes import AnyArray, Float


class SphereSurface(EmittingSurface):
    """A sphere; raises ``ValueError`` for a centre or a radius that is none."""

    center: Float[np.ndarray, "3"]
    radius: float

    def __init__(self, center: Float[AnyArray, "3"], radius: float):
        self.center, self.radius = np.asarray(center, np.float64), float(radius)
        _check("sphere", self.center, self.radius)

    @property
    def convex(self) -> bool:
        """Always."""
        return True

    def at(self, places: Places) -> SurfacePoints:
        """(cos p sin t, sin p sin t, -cos t) of azimuth p = 2 pi u and t = pi v."""
        azimuth, rise = 2 * np.pi * places[:, 0], np.pi * places[:, 1]
        sine = np.sin(rise)
        normals = np.stack([np.cos(azimuth) * sine, np.sin(azimuth) * sine, -np.cos(rise)], axis=-1)
        frames = _frames(normals, np.stack([-np.sin(azimuth), np.cos(azimuth), 0 * rise], axis=-1))
        area = 2 * np.pi**2 * self.radius**2 * sine
        return SurfacePoints(self.center + self.radius * normals, frames, area)

    def crossings(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Crossings:
        """The nearer root in front of the origin."""
        from_center = origins - self.center
        along = np.einsum("ri,ri->r", from_center, directions)
        closest = from_center - along[:, None] * directions
        inside = self.radius**2 - np.einsum("ri,ri->r", closest, closest)
        root = np.sqrt(np.maximum(inside, 0))
        near, far = -along - root, -along + root
        distance = np.where(near > 1e-9 * self.radius, near, far)
        normals = from_center + distance[:, None] * directions
        return kept(inside >= 0, distance, self._places(normals), self.radius)

    def importance(self, points: Points) -> Numbers:
        """Its solid angle, 2 pi (1 - cos of half the angle it fills)."""
        return 2 * np.pi * self._cone(points)[1]

    def drawn(self, points: Points, uniforms: Places) -> Places:
        """Evenly by solid angle."""
        towards, below = self._cone(points)
        length = np.maximum(np.linalg.norm(towards, axis=1), 1e-300)
        # 1 - cosine, and from it the sine, keep their digits for a sphere far away.
        missing = uniforms[:, 0] * below
        sine = np.sqrt(missing * (2 - missing))
        reach = np.sqrt(np.maximum(self.radius**2 - (length * sine) ** 2, 0))
        distance = length * (1 - missing) - reach
        frames = _any_frames(towards / length[:, None])
        azimuth = 2 * np.pi * uniforms[:, 1]
        local = np.stack([np.cos(azimuth) * sine, np.sin(azimuth) * sine, 1 - missing], axis=-1)
        directions = np.einsum("pij,pj->pi", frames, local)
        return self._places(distance[:, None] * directions - towards)

    def density(self, points: Points, places: Places) -> Numbers:
        """One over the solid angle."""
        below = self._cone(points)[1]
        on = self.at(places)
        facing = np.einsum("pi,pi->p", on.normals, points - on.points) > 0
        return np.where(facing & (below > 0), 1 / (2 * np.pi * np.where(below > 0, below, 1)), 0)

    def _cone(self, points: Points) -> tuple[Points, Numbers]:
        """Return vectors to the centre, and 1 - the cosine of half the cone; 0 from inside."""
        towards = self.center - points
        square = np.einsum("pi,pi->p", towards, towards)
        outside = square > self.radius**2
        sine = np.where(outside, self.radius**2 / np.where(outside, square, 1), 0)
        return towards, sine / (1 + np.sqrt(1 - sine))

    def _places(self, vectors: Points) -> Places:
        """Find (u, v) of vectors from the centre."""
        flat = np.hypot(vectors[:, 0], vectors[:, 1])
        rise = np.arctan2(flat, -vectors[:, 2]) / np.pi
        return np.stack([_turns(vectors[:, 1], vectors[:, 0]), rise], axis=-1)


class CylinderSurface(EmittingSurface):
    """The side of a cylinder, without its ends: from ``base`` along ``axis``, its whole length.

    Azimuth 0 is that of ``world_from_local`` about the axis.  Raises ``ValueError`` for a base, an
    axis or a radius that is none.
    """

    base: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    radius: float

    def __init__(self, base: Float[AnyArray, "3"], axis: Float[AnyArray, "3"], radius: float):
        self.base, self.axis = np.asarray(base, np.float64), np.asarray(axis, np.float64)
        self.radius = float(radius)
        _check("cylinder", np.concatenate([self.base, self.axis]), self.radius)
        if not self.axis.any():
            raise ValueError("the cylinder's axis is zero: give its whole length as a vector")

    @property
    def height(self) -> float:
        """Length of the axis."""
        return float(np.linalg.norm(self.axis))

    @property
    def convex(self) -> bool:
        """From outside, always."""
        return True

    def at(self, places: Places) -> SurfacePoints:
        """Area is the same everywhere, 2 pi r h."""
        frame = self._frame()
        azimuth = 2 * np.pi * places[:, 0]
        cosine, sine, none = np.cos(azimuth), np.sin(azimuth), 0 * azimuth
        normals = np.stack([cosine, sine, none], axis=-1) @ frame.T
        points = self.base + self.radius * normals + places[:, 1:] * self.axis
        frames = _frames(normals, np.stack([-sine, cosine, none], axis=-1) @ frame.T)
        area = 2 * np.pi * self.radius * self.height
        return SurfacePoints(points, frames, np.full(len(places), area))

    def crossings(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Crossings:
        """Roots in the plane across the axis; the nearer one that is in front and on the side."""
        local, along = (origins - self.base) @ self._frame(), directions @ self._frame()
        steep = np.einsum("ri,ri->r", along[:, :2], along[:, :2])
        parallel = steep == 0
        steep = np.where(parallel, 1, steep)
        half = np.einsum("ri,ri->r", local[:, :2], along[:, :2])
        rest = np.einsum("ri,ri->r", local[:, :2], local[:, :2]) - self.radius**2
        inside = half * half - steep * rest
        root = np.sqrt(np.maximum(inside, 0))
        found = []
        for distance in ((-half - root) / steep, (-half + root) / steep):
            at = local + distance[:, None] * along
            height = at[:, 2] / self.height
            places = np.stack([_turns(at[:, 1], at[:, 0]), height], axis=-1)
            there = (inside >= 0) & ~parallel & (height >= 0) & (height <= 1)
            found.append(kept(there, distance, places, self.radius))
        nearer = np.isfinite(found[0].distance)
        return Crossings(
            np.where(nearer, found[0].distance, found[1].distance),
            np.where(nearer[:, None], found[0].places, found[1].places),
        )

    def importance(self, points: Points) -> Numbers:
        """The area of its shadow over the squared distance, bounded near it; 0 from inside."""
        from_middle = points - self.base - self.axis / 2
        square = np.einsum("pi,pi->p", from_middle, from_middle)
        outside = self._across(points)[0] > self.radius
        nearest = self.radius**2 + square
        return np.where(outside, 2 * self.radius * self.height / nearest, 0)

    def drawn(self, points: Points, uniforms: Places) -> Places:
        """Evenly over the part of the side that faces the point."""
        distance, azimuth = self._across(points)
        half = np.arccos(np.minimum(self.radius / np.maximum(distance, self.radius), 1))
        turned = azimuth + (2 * uniforms[:, 0] - 1) * half
        return np.stack([(turned / (2 * np.pi)) % 1, uniforms[:, 1]], axis=-1)

    def density(self, points: Points, places: Places) -> Numbers:
        """One over the area of that part."""
        distance = self._across(points)[0]
        outside = distance > self.radius
        half = np.arccos(np.where(outside, self.radius / np.where(outside, distance, 1), 0))
        per_area = np.where(outside, 1 / (2 * half * self.radius * self.height), 0)
        return per_solid_angle(points, self.at(places), per_area)

    def _across(self, points: Points) -> tuple[Numbers, Numbers]:
        """Return distances from the axis, and azimuths about it."""
        local = (points - self.base) @ self._frame()
        return np.hypot(local[:, 0], local[:, 1]), np.arctan2(local[:, 1], local[:, 0])

    def _frame(self) -> Float[np.ndarray, "3 3"]:
        return _any_frames((self.axis / self.height)[None])[0]


def _check(name: str, place: np.ndarray, radius: float) -> None:
    if not np.isfinite(place).all() or not (np.isfinite(radius) and radius > 0):
        raise ValueError(
            f"a {name} at {place} of radius {radius}: give finite numbers and a positive radius"
        )


def _turns(y: Numbers, x: Numbers) -> Numbers:
    """Azimuths as parts of a turn in [0, 1)."""
    turns = np.arctan2(y, x) / (2 * np.pi) % 1
    # A tiny negative azimuth rounds up to a whole turn.
    return np.where(turns < 1, turns, 0)


def _frames(normals: Points, tangents: Points) -> Float[np.ndarray, "point 3 3"]:
    return np.stack([tangents, np.cross(normals, tangents), normals], axis=-1)


def _any_frames(normals: Points) -> Float[np.ndarray, "point 3 3"]:
    """Frames about unit normals, as ``geometry.world_from_local`` but on the host."""
    x, y, z = normals.T
    sign = np.where(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    first = np.stack([1 + sign * x * x * a, sign * x * y * a, -sign * x], axis=-1)
    return _frames(normals, first)
