"""Texture coordinates for a mesh that has none: charts that lie side by side in an image.

A chart is a patch of faces that look along one axis, seen along it, so that areas shrink by at most
a factor of 5.  Where a patch lies over itself the lower faces become charts of their own.  Charts
keep a margin, so that lookups between texels, and those of the next coarser images, stay with them.
The number of charts grows with the bumps of a scan; nothing is needed of its topology.

Host side, NumPy float64.
"""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from jaxrender.geometry.mesh import Mesh, angle_weighted_normals
from jaxrender.geometry.texels import covering_faces
from jaxrender.shapes import Bool, Float, Int

# Texels to the mean edge of a face, where the image may be large enough.
_TEXELS = 8.0
# And how few of them are too few.
_FEWEST = 0.02
# Texels around a chart that are its own.
_MARGIN = 2
# A face's normal has at least this part along the axis that its neighbours choose for it.
_LEAST_COSINE = 0.2
# Of a triangle, how far inside of it two faces must share a texel to lie over one another.
_INSIDE = 1e-6
_SHRINKING, _WIDER = 0.97, 1.05


class Unwrapped(NamedTuple):
    """A mesh with coordinates, and an image of (rows, columns) that suits them.

    ``density`` is the number of texels to the mean edge, and ``charts`` how many there are.
    """

    mesh: Mesh
    image: tuple[int, int]
    density: float
    charts: int


def unwrapped(mesh: Mesh, most: int) -> Unwrapped:
    """Give a mesh texture coordinates, for images of at most so many rows or columns.

    Vertices, faces and normals stay as they are.  Raises ``ValueError`` where even charts of
    a few texels have no room.
    """
    edges = mesh.vertices[mesh.faces] - mesh.vertices[np.roll(mesh.faces, 1, axis=1)]
    density = _TEXELS
    unit = float(np.linalg.norm(edges, axis=-1).mean())
    axis = _axes(mesh)
    places, heights = _seen_along(mesh, axis)
    layer = np.zeros(len(axis), int)
    pairs = _neighbours(mesh)
    while True:
        chart = _patches(pairs, 6 * layer + axis)
        packed = _packed(places * density / unit, chart)
        if max(packed.image) > most:
            if density < _FEWEST:
                raise ValueError(f"{chart.max() + 1} charts have no room in {most} x {most} texels")
            density *= _SHRINKING * min(most / max(packed.image), 1.0)
            continue
        rows, columns = packed.image
        across, down = np.moveaxis(packed.places, -1, 0)
        coordinates = np.stack([across / columns, 1 - down / rows], axis=-1)
        found = Mesh(mesh.vertices, mesh.faces, mesh.normals, coordinates)
        below = _overlaid(found, packed.image, heights)
        if not below.any():
            return Unwrapped(found, packed.image, density, int(chart.max()) + 1)
        layer[below] += 1


def _axes(mesh: Mesh) -> Int[np.ndarray, "face"]:
    """Choose one of the directions +x +y +z -x -y -z for each face, alike for neighbours."""
    own = mesh.face_normals()
    # The vertices' own normals may be anything; these are about the faces.
    smooth = angle_weighted_normals(mesh.vertices, mesh.faces)[mesh.faces].sum(axis=1)
    both = [np.concatenate([one, -one], axis=1) for one in (own, smooth)]
    chosen = both[1].argmax(axis=1)
    cosine = np.take_along_axis(both[0], chosen[:, None], axis=1)[:, 0]
    return np.where(cosine >= _LEAST_COSINE, chosen, both[0].argmax(axis=1))


def _seen_along(
    mesh: Mesh, axis: Int[np.ndarray, "face"]
) -> tuple[Float[np.ndarray, "face 3 2"], Float[np.ndarray, "face"]]:
    """Find where corners lie in the plane of each face's axis, not mirrored, and how high faces do.

    Places count to the right and downwards.
    """
    sign, along = np.where(axis < 3, 1.0, -1.0), axis % 3
    corners = mesh.vertices[mesh.faces]

    def part(number: np.ndarray) -> np.ndarray:
        return np.take_along_axis(corners, number[:, None, None], axis=2)[..., 0]

    right, up = sign[:, None] * part((along + 1) % 3), part((along + 2) % 3)
    return np.stack([right, -up], axis=-1), sign * part(along).mean(axis=1)


def _neighbours(mesh: Mesh) -> Int[np.ndarray, "pair 2"]:
    """List pairs of faces that share an edge; vertices at one place are one."""
    places = np.unique(mesh.vertices, axis=0, return_inverse=True)[1].ravel()[mesh.faces]
    edges = np.sort(np.concatenate([places[:, [0, 1]], places[:, [1, 2]], places[:, [2, 0]]]), 1)
    face = np.tile(np.arange(len(places)), 3)
    order = np.lexsort(edges.T)
    same = (np.diff(edges[order], axis=0) == 0).all(axis=1)
    return np.stack([face[order][:-1][same], face[order][1:][same]], axis=1)


def _patches(
    pairs: Int[np.ndarray, "pair 2"], label: Int[np.ndarray, "face"]
) -> Int[np.ndarray, "face"]:
    """Number the patches of connected faces with one label."""
    first, second = pairs[label[pairs[:, 0]] == label[pairs[:, 1]]].T
    graph = coo_matrix((np.ones(len(first), bool), (first, second)), (len(label), len(label)))
    return connected_components(graph, directed=False)[1].astype(int)


class _Packed(NamedTuple):
    """Where corners lie in an image, in texels to the right and downwards."""

    places: Float[np.ndarray, "face 3 2"]
    image: tuple[int, int]


def _packed(places: Float[np.ndarray, "face 3 2"], chart: Int[np.ndarray, "face"]) -> _Packed:
    """Put charts on shelves, the highest first."""
    count = int(chart.max()) + 1
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, chart, places.min(axis=1))
    np.maximum.at(high, chart, places.max(axis=1))
    size = np.maximum(np.ceil(high - low), 1).astype(int) + 2 * _MARGIN
    width = int(max(size[:, 0].max(), np.ceil(_WIDER * np.sqrt(np.prod(size, axis=1).sum()))))
    corner, across, down, shelf = np.zeros((count, 2), int), 0, 0, 0
    for number in np.argsort(-size[:, 1], kind="stable"):
        if across + size[number, 0] > width:
            across, down, shelf = 0, down + shelf, 0
        shelf = max(shelf, int(size[number, 1]))
        corner[number] = across, down
        across += int(size[number, 0])
    moved = corner + _MARGIN - low
    return _Packed(places + moved[chart][:, None], (down + shelf, width))


def _overlaid(
    mesh: Mesh, image: tuple[int, int], heights: Float[np.ndarray, "face"]
) -> Bool[np.ndarray, "face"]:
    """Find faces that share a texel with a higher one."""
    found = covering_faces(mesh, image)
    inside = found.weights.min(axis=1) > _INSIDE
    face, texel = found.face[inside], found.texel[inside]
    # The highest faces of a texel come first; of equal ones the first.
    rank = np.empty(len(heights), int)
    rank[np.lexsort([np.arange(len(heights)), -heights])] = np.arange(len(heights))
    order = np.lexsort([rank[face], texel])
    lower = np.diff(texel[order], prepend=-1) == 0
    below = np.zeros(len(heights), bool)
    below[face[order][lower]] = True
    return below
