"""Which texel or vertex each pixel shows, and which material each of them belongs to."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry import Mesh, Shape, Sphere, SurfacePlaces, SurfaceView
from jaxrender.geometry.texels import (
    mesh_coordinates,
    neighbouring_texels,
    neighbouring_vertices,
    sphere_coordinates,
    surface_sites,
    texel_coordinates,
    texel_sites,
    vertex_sites,
)
from jaxrender.inverse.photographs import Photograph
from jaxrender.io import read_image
from jaxrender.shapes import Bool, Float, Int

# Pixels that an automatic size leaves to a texel on average, and the sizes that it chooses from.
_PIXELS_PER_TEXEL, _SMALLEST, _LARGEST = 12, 4, 1024
# A mask of more colours than this is a photograph, or was smoothed or compressed.
_MOST_REGIONS = 16
# A place is looked for from this part of the shape's diagonal above it.
_OFF = 1e-4


class Regions(NamedTuple):
    """The materials of a surface: the number of each site's material, and what each is called."""

    of_site: Int[np.ndarray, "site"]
    names: tuple[str, ...]


class SurfaceSites(NamedTuple):
    """The texels or vertices of a surface, and where photographs show them.

    ``of_observation`` numbers the site of each usable pixel of all photographs, one after the
    other; -1 stands for no site.  ``image`` is (rows, columns), None where the sites are a mesh's
    vertices.  ``places`` are the means of the points that were seen of each site, NaN where none
    was.
    """

    of_observation: Int[np.ndarray, "sample"]
    count: int
    image: tuple[int, int] | None
    shape: Shape
    places: Float[np.ndarray, "site 3"]
    regions: Regions

    @property
    def kind(self) -> str:
        """What a site is called."""
        return "vertices" if self.image is None else "texels"

    @property
    def sentence(self) -> str:
        """Say what a site is, and why."""
        if self.image is None:
            return f"{self.count} vertices: the mesh has no texture coordinates, or not everywhere"
        what = f"{self.image[1]} x {self.image[0]} texels"
        if isinstance(self.shape, Sphere):
            return f"{what} by latitude and longitude of the sphere"
        return f"{what} of the mesh's texture coordinates"

    @property
    def wraps(self) -> bool:
        """Whether the last column's neighbour is the first."""
        return self.image is not None and isinstance(self.shape, Sphere)

    def of_view(self, view: SurfaceView) -> Int[np.ndarray, "row column"]:
        """Find the site of every pixel of a view; -1 beside the object."""
        # Vertices ask for no image.
        return surface_sites(self.shape, view, self.image or (1, 1)).of_pixel

    def showing(self, places: SurfacePlaces) -> Int[np.ndarray, "sample"]:
        """Find the site of places on the surface; -1 beside it."""
        if isinstance(self.shape, Sphere):
            assert self.image is not None
            away = (places.points - self.shape.center) / self.shape.radius
            return texel_sites(sphere_coordinates(away), self.image)
        assert isinstance(self.shape, Mesh)
        off = _OFF * self.shape.diagonal() * places.geometric_normals
        hits = self.shape.first_hits(places.points + off, -places.geometric_normals)
        hit = hits.hit & (hits.distance < 2 * np.linalg.norm(off, axis=1))
        found = np.full(len(hit), -1)
        seen = hits.face[hit], hits.barycentric[hit]
        if self.image is None:
            found[hit] = vertex_sites(self.shape, *seen)
        else:
            found[hit] = texel_sites(mesh_coordinates(self.shape, *seen), self.image)
        return found

    def neighbours(self, used: Bool[np.ndarray, "site"]) -> Int[np.ndarray, "pair 2"]:
        """List the pairs of used sites that touch."""
        if self.image is None:
            assert isinstance(self.shape, Mesh)
            return neighbouring_vertices(self.shape, used)
        return neighbouring_texels(self.image, used, self.wraps)

    def of_region(self, number: int) -> Int[np.ndarray, "sample"]:
        """Number the site of each observation of one region; -1 for all others."""
        site = self.of_observation
        own = (site >= 0) & (self.regions.of_site[site] == number)
        return np.where(own, site, -1)

    def with_regions(self, picture: str | Path) -> "SurfaceSites":
        """Tell materials apart by the colours of a picture over the texture coordinates.

        Raises ``ValueError`` where sites are vertices, ``InputError`` for a picture that cannot be
        read or has more than 16 colours.
        """
        if self.image is None:
            raise ValueError(
                "a picture of regions needs texture coordinates, which the mesh has not; give a "
                "mesh with texture coordinates, or leave the picture out"
            )
        pixels = read_image(Path(picture)).pixels
        colours, label = np.unique(pixels.reshape(-1, 3), axis=0, return_inverse=True)
        if len(colours) > _MOST_REGIONS:
            raise InputError(
                f"{picture}: {len(colours)} colours; a picture of regions has one flat colour for "
                f"each material, at most {_MOST_REGIONS}: save it without smoothing, as PNG"
            )
        of_site = texel_sites(texel_coordinates(self.image), pixels.shape[:2])
        names = tuple(
            "#" + "".join(f"{round(255 * min(c, 1.0)):02x}" for c in colour) for colour in colours
        )
        return self._replace(regions=Regions(label.reshape(-1)[of_site], names))


def sites_of(
    shape: Shape, photographs: Sequence[Photograph], rows: int | None = None
) -> SurfaceSites:
    """Find the site of every pixel of every photograph; all sites are of one material.

    A sphere has texels by latitude and longitude, a mesh those of its texture coordinates, or its
    vertices where it has none.  ``rows`` of texels are made; None: as many as leave every texel a
    dozen pixels on average.  A sphere's texture is twice as wide as high, a mesh's is square.
    Raises ``ValueError`` for other shapes.
    """
    image = _image_size(shape, photographs, rows)
    found = [surface_sites(shape, photograph.view, image) for photograph in photographs]
    usable = [s.of_pixel[p.selection.usable] for s, p in zip(found, photographs)]
    site, count = np.concatenate(usable), found[0].count
    points = np.concatenate([p.view.points[p.selection.usable] for p in photographs])
    return SurfaceSites(
        site,
        count,
        found[0].image,
        shape,
        middles(points, site, count),
        Regions(np.zeros(count, int), ("",)),
    )


def middles(
    points: Float[np.ndarray, "sample 3"], site: Int[np.ndarray, "sample"], count: int
) -> Float[np.ndarray, "site 3"]:
    """Find the middle of the points that were seen of each site; NaN where none was."""
    own = site >= 0
    seen = np.bincount(site[own], minlength=count)
    sums = [np.bincount(site[own], points[own, axis], minlength=count) for axis in range(3)]
    with np.errstate(invalid="ignore"):
        return np.stack(sums, axis=-1) / seen[:, None]


def _image_size(
    shape: Shape, photographs: Sequence[Photograph], rows: int | None
) -> tuple[int, int]:
    aspect = 2 if isinstance(shape, Sphere) else 1
    if rows is None:
        usable = sum(int(np.count_nonzero(p.selection.usable)) for p in photographs)
        wanted = np.sqrt(max(usable, 1) / (_PIXELS_PER_TEXEL * aspect))
        rows = int(np.clip(2.0 ** np.floor(np.log2(max(wanted, 1))), _SMALLEST, _LARGEST))
    return rows, aspect * rows
