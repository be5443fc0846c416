"""A patch repeated for ever in x and y, as a surface that rays can hit.

A block of three by three periods is traced.  Within one period of the middle one, less what leans
over the sides, the block is complete; a ray that leaves this part between the lowest and the
highest point of the patch goes on in the middle period, at the same place of it.  So rays at
grazing angles meet every neighbour in their way, however far, and there are no borders.

``Hits.points`` lie where the ray met the endless surface; ``Hits.face`` counts the faces of one
period.
"""

import numpy as np

from jaxrender.geometry.height_fields import Patch
from jaxrender.geometry.hits import Hits, Shape, no_hits, unit_rays
from jaxrender.geometry.mesh import Mesh
from jaxrender.shapes import Bool, Float, checked

# A ray goes on this part of a period before where it left, lest it slip through at the seam.
_OVERLAP = 1e-4
# Rays parallel to the plane, in a gap that goes on for ever, are given up after so many blocks.
_MOST_BLOCKS = 2000
# Room above and below, as part of the block's size.
_ROOM = 1e-3


class PeriodicSurface(Shape):
    """A patch and all its neighbours."""

    patch: Patch
    block: Mesh
    _faces: int
    _slab: tuple[float, float]
    _box: Float[np.ndarray, "2 2"]

    def __init__(self, patch: Patch):
        self.patch = patch
        mesh, size = patch.mesh, patch.size
        shifts = np.array([[i, j] for j in (0, -1, 1) for i in (0, -1, 1)])
        vertices = [mesh.vertices + np.append(shift * size, 0) for shift in shifts]
        count = len(mesh.vertices)
        faces = [mesh.faces + copy * count for copy in range(len(shifts))]
        normals = np.tile(mesh.normals, (len(shifts), 1))
        self.block = Mesh(np.concatenate(vertices), np.concatenate(faces), normals)
        self._faces = len(mesh.faces)
        lower, upper = mesh.bounds()
        room = _ROOM * float(size.max())
        self._slab = float(lower[2]) - room, float(upper[2]) + room
        corners = patch.rectangle
        over = np.maximum(np.max([corners[0] - lower[:2], upper[:2] - corners[1]], axis=0), 0)
        self._box = np.stack([corners[0] - size + over, corners[1] + size - over])

    @checked
    def first_hits(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Hits:
        """Nearest intersections with the endless surface."""
        origins, directions = unit_rays(origins, directions)
        found = no_hits(len(origins))
        start, ray = self._entered(origins, directions)
        for _ in range(_MOST_BLOCKS):
            if not len(ray):
                break
            here, shift = self._wrapped(start)
            towards = directions[ray]
            hits = self.block.first_hits(here, towards)
            ends, leaves = self._reach(here, towards)
            # Beyond its end the block lacks what leans in from farther away.
            met = hits.hit & (hits.distance <= ends + _OVERLAP * self.patch.size.max())
            rows = ray[met]
            for name in ("normals", "geometric_normals", "barycentric"):
                getattr(found, name)[rows] = getattr(hits, name)[met]
            found.hit[rows] = True
            found.face[rows] = hits.face[met] % self._faces
            found.points[rows] = hits.points[met] + shift[met]
            offset = found.points[rows] - origins[rows]
            found.distance[rows] = np.einsum("ri,ri->r", offset, directions[rows])
            on = ~met & ~leaves
            start, ray = self._advanced(start[on], towards[on], ends[on]), ray[on]
        return found

    @checked
    def occluded(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Bool[np.ndarray, "ray"]:
        """Whether rays meet the endless surface at all."""
        origins, directions = unit_rays(origins, directions)
        blocked = np.zeros(len(origins), bool)
        start, ray = self._entered(origins, directions)
        for _ in range(_MOST_BLOCKS):
            if not len(ray):
                break
            here, _ = self._wrapped(start)
            towards = directions[ray]
            met = self.block.occluded(here, towards)
            blocked[ray[met]] = True
            ends, leaves = self._reach(here, towards)
            on = ~met & ~leaves
            start, ray = self._advanced(start[on], towards[on], ends[on]), ray[on]
        return blocked

    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Those of one period."""
        return self.patch.mesh.bounds()

    def is_convex(self) -> bool:
        """Never: even a plane has no inside."""
        return False

    def _entered(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, ...]:
        """Where rays first are between the lowest and the highest point, and which ever are."""
        low, high = self._slab
        z, slope = origins[:, 2], directions[:, 2]
        outside = np.where(z > high, z - high, np.where(z < low, z - low, 0))
        comes = (outside == 0) | (outside * slope < 0)
        ray = np.flatnonzero(comes)
        safe = np.where(outside[ray] == 0, 1, -slope[ray])
        return origins[ray] + (outside[ray] / safe)[:, None] * directions[ray], ray

    def _wrapped(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same places in the middle period, and how far away that is."""
        corner, size = self.patch.rectangle[0], self.patch.size
        shift = np.zeros_like(points)
        shift[:, :2] = np.floor((points[:, :2] - corner) / size) * size
        return points - shift, shift

    def _reach(self, points: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far rays stay where the block is complete, and whether they then leave the patch."""
        low, high = self._slab
        across = _distance(points[:, :2], directions[:, :2], self._box).min(axis=1)
        slab = np.array([[low], [high]])
        through = _distance(points[:, 2:], directions[:, 2:], slab)[:, 0]
        return np.minimum(across, through), through <= across

    def _advanced(self, start: np.ndarray, towards: np.ndarray, ends: np.ndarray) -> np.ndarray:
        step = np.maximum(ends - _OVERLAP * self.patch.size.min(), ends / 2)
        return start + step[:, None] * towards


def _distance(points: np.ndarray, directions: np.ndarray, box: np.ndarray) -> np.ndarray:
    """How far it is to the far side of a box along each axis, infinite for parallel rays."""
    side = np.where(directions > 0, box[1], box[0])
    moving = directions != 0
    ratio = (side - points) / np.where(moving, directions, 1)
    return np.where(moving, np.maximum(ratio, 0), np.inf)
