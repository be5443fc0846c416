"""Sites: the places of a surface that have a material of their own, and which one a pixel shows.

A site is a texel of an image wrapped around the surface, numbered row by row from the top left, or
a vertex where a mesh has no texture coordinates.  Texture coordinates are u to the right and v
upwards in the unit square, so row 0 lies at v = 1; beyond the square the image repeats.  A sphere
has those of a latitude-longitude image: u = azimuth / 2 pi, v = 1 - polar angle / pi.

Host side, NumPy float64.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxrender.geometry.directions import angles_from_direction
from jaxrender.geometry.hits import Shape
from jaxrender.geometry.mesh import Mesh
from jaxrender.geometry.sphere import Sphere
from jaxrender.geometry.surface import SurfaceView

# How far outside of a triangle a texel's centre may be, as a share of the triangle.
_EDGE = 1e-9
# Twice an area in texels, below which a face covers none.
_NO_AREA = 1e-20
# Pairs of a face and a texel that are looked at together.
_AT_ONCE = 2_000_000


class Sites(NamedTuple):
    """The site of every pixel (-1: none), how many there are, and the image that they fill.

    ``image`` is (rows, columns), or None where sites are the vertices of a mesh.
    """

    of_pixel: Int[np.ndarray, "row column"]
    count: int
    image: tuple[int, int] | None

    @property
    def sentence(self) -> str:
        """What a site is."""
        if self.image is None:
            return f"{self.count} vertices: the mesh has no texture coordinates, or not everywhere"
        return f"{self.image[1]} x {self.image[0]} texels"


class Splat(NamedTuple):
    """The four texels about each point, and how much of the point belongs to each (sums to 1)."""

    site: Int[np.ndarray, "sample 4"]
    share: Float[np.ndarray, "sample 4"]


def surface_sites(shape: Shape, view: SurfaceView, image: tuple[int, int]) -> Sites:
    """Find the site behind every pixel of a view: texels of an image of (rows, columns).

    A mesh without texture coordinates has its vertices for sites, whatever the image.
    Raises ``ValueError`` for shapes that are neither sphere nor mesh.
    """
    of_pixel = np.full(view.hit.shape, -1)
    if isinstance(shape, Mesh) and shape.texture_coordinates is None:
        of_pixel[view.hit] = vertex_sites(shape, view.face[view.hit], view.barycentric[view.hit])
        return Sites(of_pixel, len(shape.vertices), None)
    of_pixel[view.hit] = texel_sites(view_coordinates(shape, view), image)
    return Sites(of_pixel, image[0] * image[1], image)


def view_coordinates(shape: Shape, view: SurfaceView) -> Float[np.ndarray, "sample 2"]:
    """Find the texture coordinates behind the pixels that are hit, in the order of ``view.hit``."""
    if isinstance(shape, Sphere):
        return sphere_coordinates((view.points[view.hit] - shape.center) / shape.radius)
    if isinstance(shape, Mesh):
        return mesh_coordinates(shape, view.face[view.hit], view.barycentric[view.hit])
    raise ValueError(f"a {type(shape).__name__} has no texture coordinates: use a mesh or a sphere")


def mesh_coordinates(
    mesh: Mesh, face: Int[np.ndarray, "sample"], barycentric: Float[np.ndarray, "sample 3"]
) -> Float[np.ndarray, "sample 2"]:
    """Interpolate a mesh's texture coordinates; ``ValueError`` where it has none."""
    if mesh.texture_coordinates is None:
        raise ValueError("the mesh has no texture coordinates: use its vertices (vertex_sites)")
    corners = mesh.texture_coordinates[_checked(face)]
    return np.einsum("sk,ski->si", barycentric, corners)


def sphere_coordinates(
    directions: Float[np.ndarray, "sample 3"],
) -> Float[np.ndarray, "sample 2"]:
    """Find the latitude-longitude coordinates of directions from a sphere's centre."""
    polar, azimuth = (np.asarray(a, np.float64) for a in angles_from_direction(directions))
    return np.stack([azimuth / (2 * np.pi), 1 - polar / np.pi], axis=-1)


def texel_sites(
    coordinates: Float[np.ndarray, "sample 2"], image: tuple[int, int]
) -> Int[np.ndarray, "sample"]:
    """Find the texel that holds each point."""
    rows, columns = _checked_image(image)
    u, v = _repeated(coordinates).T
    row = np.clip(np.floor((1 - v) * rows), 0, rows - 1)
    column = np.clip(np.floor(u * columns), 0, columns - 1)
    return (row * columns + column).astype(int)


def texel_coordinates(image: tuple[int, int]) -> Float[np.ndarray, "site 2"]:
    """List the texture coordinates of the texels' centres."""
    rows, columns = _checked_image(image)
    v = 1 - (np.arange(rows) + 0.5) / rows
    u = (np.arange(columns) + 0.5) / columns
    return np.stack(np.broadcast_arrays(u[None, :], v[:, None]), axis=-1).reshape(-1, 2)


def splat(
    coordinates: Float[np.ndarray, "sample 2"], image: tuple[int, int], wrap: bool = False
) -> Splat:
    """Share each point among the four texels about it, bilinearly.

    At the border of the image the shares of texels outside go to those inside; with ``wrap`` the
    columns go round, as those of a sphere do.
    """
    rows, columns = _checked_image(image)
    u, v = _repeated(coordinates).T
    down, across = (1 - v) * rows - 0.5, u * columns - 0.5
    row, column = np.floor(down).astype(int), np.floor(across).astype(int)
    sites, shares = [], []
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        share_down = np.abs(1 - i - (down - row))
        share_across = np.abs(1 - j - (across - column))
        along = column + j
        along = along % columns if wrap else np.clip(along, 0, columns - 1)
        sites.append(np.clip(row + i, 0, rows - 1) * columns + along)
        shares.append(share_down * share_across)
    return Splat(np.stack(sites, axis=1), np.stack(shares, axis=1))


def vertex_sites(
    mesh: Mesh, face: Int[np.ndarray, "sample"], barycentric: Float[np.ndarray, "sample 3"]
) -> Int[np.ndarray, "sample"]:
    """Find the nearest corner of each point's face, by weight."""
    nearest = np.argmax(barycentric, axis=1)
    return mesh.faces[_checked(face), nearest]


class Covering(NamedTuple):
    """Faces over the centres of texels, and where in them those lie; a texel may have several."""

    face: Int[np.ndarray, "pair"]
    texel: Int[np.ndarray, "pair"]
    weights: Float[np.ndarray, "pair 3"]


def covering_faces(mesh: Mesh, image: tuple[int, int]) -> Covering:
    """Pair faces with the texels whose centres they cover, in the order of the faces.

    Faces beyond the unit square come back in.  Raises ``ValueError`` for a mesh without texture
    coordinates.
    """
    if mesh.texture_coordinates is None:
        raise ValueError("the mesh has no texture coordinates: no texel lies on a face")
    rows, columns = _checked_image(image)
    places = _in_texels(mesh.texture_coordinates, image)
    low = np.ceil(places.min(axis=1) - _EDGE).astype(int)
    size = np.maximum(np.floor(places.max(axis=1) + _EDGE).astype(int) - low + 1, 0)
    many = size.prod(axis=1)
    found = []
    ends = np.searchsorted(np.cumsum(many), np.arange(_AT_ONCE, many.sum(), _AT_ONCE)) + 1
    for part in np.split(np.arange(len(many)), ends):
        face = np.repeat(part, many[part])
        number = np.arange(len(face)) - np.repeat(np.cumsum(many[part]) - many[part], many[part])
        texel = low[face] + np.stack(np.divmod(number, size[face, 0])[::-1], axis=-1)
        weights = _weights(places[face], texel.astype(float))
        with np.errstate(invalid="ignore"):
            kept = weights.min(axis=1) >= -_EDGE
        across, down = texel[kept].T
        found.append(Covering(face[kept], down % rows * columns + across % columns, weights[kept]))
    return Covering(*(np.concatenate(parts) for parts in zip(*found)))


def weights_in_faces(
    mesh: Mesh, image: tuple[int, int], face: Int[np.ndarray, "row column"]
) -> Float[np.ndarray, "row column 3"]:
    """Find where every texel's centre lies in the plane of a face, also outside of the face.

    Coordinates must lie in the unit square.  A face without area there has NaN.
    """
    assert mesh.texture_coordinates is not None
    texel = np.stack(np.meshgrid(*(np.arange(size) for size in image[::-1])), axis=-1)
    return _weights(_in_texels(mesh.texture_coordinates, image)[face], texel.astype(float))


def _in_texels(
    coordinates: Float[np.ndarray, "face 3 2"], image: tuple[int, int]
) -> Float[np.ndarray, "face 3 2"]:
    """Count places to the right and downwards in texels from the centre of the first one."""
    places = coordinates - np.floor(coordinates.mean(axis=1, keepdims=True))
    rows, columns = image
    return np.stack([places[..., 0] * columns, (1 - places[..., 1]) * rows], axis=-1) - 0.5


def _weights(
    corners: Float[np.ndarray, "*batch 3 2"], place: Float[np.ndarray, "*batch 2"]
) -> Float[np.ndarray, "*batch 3"]:
    """Weigh the corners of triangles so that places are their means; NaN for a line."""
    first, second = corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    own = place - corners[..., 0, :]
    area = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    area = np.where(np.abs(area) < _NO_AREA, np.nan, area)
    one = (own[..., 0] * second[..., 1] - own[..., 1] * second[..., 0]) / area
    two = (first[..., 0] * own[..., 1] - first[..., 1] * own[..., 0]) / area
    return np.stack([1 - one - two, one, two], axis=-1)


def neighbouring_texels(
    image: tuple[int, int], used: Bool[np.ndarray, "site"], wrap: bool = False
) -> Int[np.ndarray, "pair 2"]:
    """List the pairs of used texels that share an edge; with ``wrap`` across the sides, too."""
    rows, columns = _checked_image(image)
    number = np.arange(rows * columns).reshape(rows, columns)
    pairs = [
        np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1),
        np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1),
    ]
    if wrap and columns > 2:
        pairs.append(np.stack([number[:, -1], number[:, 0]], axis=1))
    found = np.concatenate(pairs)
    return found[used[found].all(axis=1)]


def neighbouring_vertices(mesh: Mesh, used: Bool[np.ndarray, "site"]) -> Int[np.ndarray, "pair 2"]:
    """List the pairs of used vertices that share an edge of the mesh."""
    edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    return edges[used[edges].all(axis=1)]


def _repeated(coordinates: Float[np.ndarray, "sample 2"]) -> Float[np.ndarray, "sample 2"]:
    """Bring coordinates into the unit square; its own far edges stay where they are."""
    coordinates = np.asarray(coordinates, np.float64)
    inside = (coordinates >= 0) & (coordinates <= 1)
    return np.where(inside, coordinates, coordinates - np.floor(coordinates))


def _checked(face: Int[np.ndarray, "sample"]) -> Int[np.ndarray, "sample"]:
    if (np.asarray(face) < 0).any():
        raise ValueError("a sample has no face (-1): keep the pixels that hit the mesh (view.hit)")
    return face


def _checked_image(image: tuple[int, int]) -> tuple[int, int]:
    if min(image) < 1:
        raise ValueError(f"a texture of {image[1]} x {image[0]} texels: give one texel or more")
    return image
