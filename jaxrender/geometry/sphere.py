"""The sphere, intersected exactly."""

import math

import numpy as np
from jaxtyping import Bool, Float

from jaxrender.geometry.hits import Hits, Shape, no_hits, unit_rays
from jaxrender.shapes import AnyArray, checked

# Hits nearer than this fraction of the radius are the surface that the ray starts on.
_NEAREST = 1e-10


class Sphere(Shape):
    """A sphere given by its centre and radius in world units."""

    center: Float[np.ndarray, "3"]
    radius: float

    def __init__(self, center: Float[AnyArray, "3"] | None = None, radius: float = 1.0):
        self.center = np.zeros(3) if center is None else np.asarray(center, np.float64)
        self.radius = float(radius)
        if not np.isfinite(self.center).all():
            raise ValueError(f"the sphere's centre is {self.center}: give three finite numbers")
        if not (math.isfinite(self.radius) and self.radius > 0):
            raise ValueError(f"the sphere's radius is {radius}: give a positive, finite length")

    @checked
    def first_hits(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Hits:
        """Roots of |f + t d|^2 = r^2, f = origin - centre, nearest first.

        The discriminant is r^2 - |f - (f.d) d|^2, from the point of closest approach, and the
        smaller root is (|f|^2 - r^2) / larger: neither cancels for a distant or a touching ray.
        """
        origins, directions = unit_rays(origins, directions)
        from_center = origins - self.center
        along = -np.einsum("ri,ri->r", from_center, directions)
        closest = from_center + along[:, None] * directions
        discriminant = self.radius**2 - np.einsum("ri,ri->r", closest, closest)
        reach = np.linalg.norm(from_center, axis=1)
        power = (reach - self.radius) * (reach + self.radius)
        larger = along + np.copysign(np.sqrt(np.maximum(discriminant, 0)), along)
        other = power / np.where(larger == 0, np.inf, larger)
        near, far = np.minimum(larger, other), np.maximum(larger, other)

        nearest = _NEAREST * self.radius
        distance = np.where(near > nearest, near, far)
        hit = (discriminant >= 0) & (distance > nearest)
        hits = no_hits(len(origins))
        hits.hit[:] = hit
        hits.distance[hit] = distance[hit]
        offsets = from_center[hit] + distance[hit, None] * directions[hit]
        normals = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
        hits.normals[hit] = normals
        hits.geometric_normals[hit] = normals
        # From the normal, not along the ray: on the surface even for a far-away origin.
        hits.points[hit] = self.center + self.radius * normals
        return hits

    @checked
    def occluded(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Bool[np.ndarray, "ray"]:
        """Whether the larger root lies in front of the origin."""
        return self.first_hits(origins, directions).hit

    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """The cube around the sphere."""
        return np.stack([self.center - self.radius, self.center + self.radius])

    def is_convex(self) -> bool:
        """Always."""
        return True
