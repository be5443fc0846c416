"""Which texel or vertex each pixel shows, and which material each of them belongs to."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry import Mesh, Shape, Sphere
from jaxrender.geometry.texels import (
    neighbouring_texels,
    neighbouring_vertices,
    surface_sites,
    texel_coordinates,
    texel_sites,
)
from jaxrender.inverse.photographs import Photograph
from jaxrender.io import read_image
from jaxrender.pipelines.config import TextureConfig
from jaxrender.shapes import Bool, Float, Int

# Pixels that an automatic size leaves to a texel on average, and the sizes that it chooses from.
_PIXELS_PER_TEXEL, _SMALLEST, _LARGEST = 12, 4, 1024
# A mask of more colours than this is a photograph, or was smoothed or compressed.
_MOST_REGIONS = 16


class SurfaceSites(NamedTuple):
    """The sites of a capture: of each observation, of every pixel by photograph, and their image.

    ``image`` is (rows, columns), None where the sites are a mesh's vertices; -1 stands for no site.
    ``places`` are the means of the points that were seen of each site, NaN where none was.
    """

    of_observation: Int[np.ndarray, "sample"]
    of_photograph: tuple[Int[np.ndarray, "row column"], ...]
    count: int
    image: tuple[int, int] | None
    shape: Shape
    places: Float[np.ndarray, "site 3"]

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

    def neighbours(self, used: Bool[np.ndarray, "site"]) -> Int[np.ndarray, "pair 2"]:
        """List the pairs of used sites that touch."""
        if self.image is None:
            assert isinstance(self.shape, Mesh)
            return neighbouring_vertices(self.shape, used)
        return neighbouring_texels(self.image, used, self.wraps)


def sites_of(shape: Shape, photographs: list[Photograph], config: TextureConfig) -> SurfaceSites:
    """Find the site of every pixel of every photograph.

    Raises ``InputError`` for settings of texels where the sites are a mesh's vertices.
    """
    image = _image_size(shape, photographs, config)
    found = [surface_sites(shape, photograph.view, image) for photograph in photographs]
    if found[0].image is None:
        _refuse_what_needs_texels(config)
    usable = [s.of_pixel[p.selection.usable] for s, p in zip(found, photographs)]
    site, count = np.concatenate(usable), found[0].count
    points = np.concatenate([p.view.points[p.selection.usable] for p in photographs])
    pictures = tuple(one.of_pixel for one in found)
    places = _middles(points, site, count)
    return SurfaceSites(site, pictures, count, found[0].image, shape, places)


def _refuse_what_needs_texels(config: TextureConfig) -> None:
    for name in ("size", "regions", "dilate"):
        value = getattr(config, name)
        if value != TextureConfig.model_fields[name].default:
            raise InputError(
                f"texture.{name}: found {value}, but the mesh has no texture coordinates, so that "
                "each vertex has a material; remove it, or give a mesh with texture coordinates"
            )


def _middles(
    points: Float[np.ndarray, "sample 3"], site: Int[np.ndarray, "sample"], count: int
) -> Float[np.ndarray, "site 3"]:
    own = site >= 0
    seen = np.bincount(site[own], minlength=count)
    sums = [np.bincount(site[own], points[own, axis], minlength=count) for axis in range(3)]
    with np.errstate(invalid="ignore"):
        return np.stack(sums, axis=-1) / seen[:, None]


def regions_of(path: Path | None, sites: SurfaceSites) -> tuple[Int[np.ndarray, "site"], list[str]]:
    """Number the material of every site by the colours of a picture; also what to call each."""
    if path is None:
        return np.zeros(sites.count, int), [""]
    assert sites.image is not None
    pixels = read_image(path).pixels
    colours, label = np.unique(pixels.reshape(-1, 3), axis=0, return_inverse=True)
    if len(colours) > _MOST_REGIONS:
        raise InputError(
            f"{path}: {len(colours)} colours; a picture of regions has one flat colour for each "
            f"material, at most {_MOST_REGIONS}: save it without smoothing, as PNG"
        )
    of_site = texel_sites(texel_coordinates(sites.image), pixels.shape[:2])
    names = ["#" + "".join(f"{round(255 * min(c, 1.0)):02x}" for c in colour) for colour in colours]
    return label.reshape(-1)[of_site], names


def _image_size(
    shape: Shape, photographs: list[Photograph], config: TextureConfig
) -> tuple[int, int]:
    aspect = 2 if isinstance(shape, Sphere) else 1
    rows = config.size
    if rows == "auto":
        usable = sum(int(np.count_nonzero(p.selection.usable)) for p in photographs)
        wanted = np.sqrt(max(usable, 1) / (_PIXELS_PER_TEXEL * aspect))
        rows = int(np.clip(2.0 ** np.floor(np.log2(max(wanted, 1))), _SMALLEST, _LARGEST))
    return rows, aspect * rows
