"""Any surface over the unit square that light leaves through (L 5.3.4), by its map alone.

Frames and areas come from the map's derivatives, taken by JAX.  Rays are traced against triangles
between a grid of places, and each crossing is then moved onto the surface itself by Newton's method
for x'(u, v) = origin + t direction, so that only silhouettes are those of the triangles.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import Mesh
from jaxrender.lighting.luminaires.surfaces import (
    Crossings,
    EmittingSurface,
    Numbers,
    Places,
    Points,
    SurfacePoints,
    per_solid_angle,
)
from jaxrender.shapes import AnyArray, Array, Float

# Each step of Newton's doubles the digits; triangles start with about two.
_STEPS = 3
# Where the map folds up its derivatives span no area: no direction is normal to it.
_FOLDED = 1e-12


class BilinearGrid(eqx.Module):
    """Points on a regular grid of places, u along rows, v along columns; bilinear in between."""

    points: Float[Array, "row column 3"]

    def __call__(self, place: Float[Array, "2"]) -> Float[Array, "3"]:
        """Evaluate the point of a place."""
        cells = np.array(self.points.shape[:2], np.int32) - 1
        scaled = place * jnp.asarray(cells, place.dtype)
        corner = jnp.clip(jnp.floor(jax.lax.stop_gradient(scaled)).astype(np.int32), 0, cells - 1)
        u, v = scaled - corner.astype(place.dtype)
        points = self.points.astype(place.dtype)
        i, j = corner[0], corner[1]
        near = (1 - v) * points[i, j] + v * points[i, j + 1]
        far = (1 - v) * points[i + 1, j] + v * points[i + 1, j + 1]
        return (1 - u) * near + u * far


class ParametricSurface(EmittingSurface):
    """``position`` maps a place (u, v) to a point; it is traced by JAX.

    ``cells`` are the triangles' pairs along u and v.  Raises ``ValueError`` for fewer than one, and
    as ``Mesh`` for a map without area.
    """

    position: Callable[[Array], Array]
    mesh: Mesh
    middle: Float[np.ndarray, "3"]
    area: float

    def __init__(self, position: Callable[[Array], Array], cells: tuple[int, int] = (32, 32)):
        if min(cells) < 1:
            raise ValueError(f"{cells[0]} x {cells[1]} cells of triangles; give at least one")
        self.position = position
        places = _grid(cells)
        points = _derivatives(position, places)[0]
        corners = _corners(cells)
        self.mesh = Mesh(points, corners, texture_coordinates=places[corners])
        self.middle = points.mean(axis=0)
        triangles = points[corners]
        across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        self.area = float(np.linalg.norm(across, axis=1).sum() / 2)

    @classmethod
    def of_grid(cls, points: Float[AnyArray, "row column 3"]) -> "ParametricSurface":
        """Join a grid of points by bilinear patches; four points are one patch.

        Raises ``ValueError`` for a grid of fewer than two points either way or not finite ones.
        """
        if min(points.shape[:2]) < 2 or not np.isfinite(np.asarray(points)).all():
            raise ValueError(
                f"a grid of {points.shape[0]} x {points.shape[1]} points; give two or more either "
                "way, all finite"
            )
        cells = points.shape[0] - 1, points.shape[1] - 1
        finer = max(8 // max(cells), 1)
        return cls(BilinearGrid(jnp.asarray(points)), (finer * cells[0], finer * cells[1]))

    @property
    def convex(self) -> bool:
        """Not known."""
        return False

    def at(self, places: Places) -> SurfacePoints:
        """Evaluate the map and its derivatives."""
        points, along_u, along_v = _derivatives(self.position, places)
        across = np.cross(along_u, along_v)
        area, length = np.linalg.norm(across, axis=1), np.linalg.norm(along_u, axis=1)
        whole = (area > _FOLDED * self.area) & (length > 0)
        normals = np.where(whole[:, None], across, [0, 0, 1]) / np.where(whole, area, 1)[:, None]
        x = np.where(whole[:, None], along_u, [1, 0, 0]) / np.where(whole, length, 1)[:, None]
        frames = np.stack([x, np.cross(normals, x), normals], axis=-1)
        return SurfacePoints(points, frames, np.where(whole, area, 0))

    def crossings(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Crossings:
        """By triangles, then on the surface."""
        hits = self.mesh.first_hits(origins, directions)
        distance, places = np.full(len(origins), np.inf), np.zeros((len(origins), 2))
        row = np.flatnonzero(hits.hit)
        corners = self.mesh.texture_coordinates
        if corners is None or not len(row):
            return Crossings(distance, places)
        place = np.einsum("rk,rki->ri", hits.barycentric[row], corners[hits.face[row]])
        reach = hits.distance[row]
        for _ in range(_STEPS):
            points, along_u, along_v = _derivatives(self.position, place)
            missing = origins[row] + reach[:, None] * directions[row] - points
            matrix = np.stack([along_u, along_v, -directions[row]], axis=-1)
            grazing = np.abs(np.linalg.det(matrix)) < _FOLDED * self.area
            matrix = np.where(grazing[:, None, None], np.eye(3), matrix)
            step = np.linalg.solve(matrix, missing[..., None])[..., 0]
            step[grazing] = 0
            place, reach = np.clip(place + step[:, :2], 0, 1), reach + step[:, 2]
        distance[row], places[row] = reach, place
        return Crossings(distance, places)

    def importance(self, points: Points) -> Numbers:
        """Its area over the squared distance, bounded near it."""
        towards = points - self.middle
        return self.area / (np.einsum("pi,pi->p", towards, towards) + self.area / np.pi)

    def drawn(self, points: Points, uniforms: Places) -> Places:
        """Evenly in (u, v), whichever way the place faces."""
        return uniforms

    def density(self, points: Points, places: Places) -> Numbers:
        """One over the area of du dv; its integral is the part of (u, v) that faces the point."""
        on = self.at(places)
        per_area = np.where(on.area > 0, 1 / np.where(on.area > 0, on.area, 1), 0)
        return per_solid_angle(points, on, per_area)


@eqx.filter_jit
def _map(position: Callable[[Array], Array], places: Array) -> tuple[Array, Array]:
    def one(place: Array) -> tuple[Array, Array]:
        return position(place), jax.jacfwd(position)(place)

    return jax.vmap(one)(places)


def _derivatives(
    position: Callable[[Array], Array], places: Places
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Evaluate points and their derivatives by u and v, in batches of few sizes."""
    wanted = max(64, 1 << max(len(places) - 1, 0).bit_length())
    padded = np.zeros((wanted, 2))
    padded[: len(places)] = places
    dtype = jax.dtypes.canonicalize_dtype(float)
    points, slopes = _map(position, jnp.asarray(padded, dtype))
    slopes = np.asarray(slopes, float)[: len(places)]
    return np.asarray(points, float)[: len(places)], slopes[..., 0], slopes[..., 1]


def _grid(cells: tuple[int, int]) -> Float[np.ndarray, "vertex 2"]:
    u, v = (np.linspace(0, 1, count + 1) for count in cells)
    return np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)


def _corners(cells: tuple[int, int]) -> np.ndarray:
    """Two triangles a cell, wound as dx'/du x dx'/dv points."""
    i, j = (part.ravel() for part in np.meshgrid(*map(np.arange, cells), indexing="ij"))
    first = i * (cells[1] + 1) + j
    across = first + cells[1] + 1
    lower = np.stack([first, across, across + 1], axis=-1)
    return np.concatenate([lower, np.stack([first, across + 1, first + 1], axis=-1)])
