"""What leaves: a material on a shape, in a light, seen by cameras.  And what a file of it is."""

import re
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import BRDF, MetallicRoughness
from jaxrender.geometry import Mesh, Shape, Sphere
from jaxrender.io.captures import Frame
from jaxrender.lighting import DirectionalSources, Environment, Light, PointSources
from jaxrender.shapes import Bool, Float

# How finely a sphere becomes triangles: 20 * 4^5 of them, .04 % from the sphere.
_SUBDIVISIONS = 5
# Of a textured one: so many rows of twice as many cells.
_PARALLELS = 64


class MaterialMaps(NamedTuple):
    """A material of T 6.2 for every site; ``mean`` is that of all seen sites.

    Sites are the texels of an image, row 0 at v = 1, or the vertices of a mesh.  ``ks`` has
    channels where it has a colour.  ``sigma`` is None where all sites have the mean's.  ``offset``
    is what sites add to the shape's unit normals, in the world's axes; only the part along the
    surface counts.  Sites that nobody saw are black.
    """

    mean: BRDF
    kd: Float[np.ndarray, "*site 3"]
    ks: Float[np.ndarray, "*site_channel"]
    sigma: Float[np.ndarray, "*site"] | None = None
    offset: Float[np.ndarray, "*site 3"] | None = None

    @property
    def of_vertices(self) -> bool:
        """Whether sites are vertices."""
        return self.kd.ndim == 2

    @property
    def seen(self) -> Bool[np.ndarray, "*site"]:
        """Whether there is a material."""
        return np.any(self.kd > 0, axis=-1)

    @property
    def coloured_ks(self) -> Float[np.ndarray, "*site channel"]:
        """``ks`` with an axis of channels, one where it has no colour."""
        return self.ks if self.ks.ndim == self.kd.ndim else self.ks[..., None]


class MetallicMaps(NamedTuple):
    """glTF's material for every site, as of ``MaterialMaps``; ``mean`` is that of all seen sites.

    Sites that nobody saw are black.
    """

    mean: MetallicRoughness
    base_color: Float[np.ndarray, "*site 3"]
    roughness: Float[np.ndarray, "*site"]
    metallic: Float[np.ndarray, "*site"]

    @property
    def seen(self) -> Bool[np.ndarray, "*site"]:
        """Whether there is a material."""
        return np.any(self.base_color > 0, axis=-1)

    @property
    def of_vertices(self) -> bool:
        """Whether sites are vertices."""
        return self.base_color.ndim == 2

    @property
    def offset(self) -> None:
        """No site has a normal of its own."""


class Contents(NamedTuple):
    """What a result holds, in the world's axes (z up), its units, and linear RGB.

    The light is that of the photographs, its scale applied.  None stands for what there is none of.
    """

    name: str
    material: BRDF | None = None
    shape: Shape | None = None
    environment: Environment | None = None
    sources: DirectionalSources = DirectionalSources.none()
    cameras: tuple[Frame, ...] = ()
    maps: MaterialMaps | MetallicMaps | None = None
    points: PointSources | None = None

    @property
    def is_lit(self) -> bool:
        """Whether there is any light."""
        lit = self.environment is not None or self.points is not None
        return lit or bool(np.any(np.asarray(self.sources.irradiance)))

    @property
    def all_distant(self) -> Light:
        """The sources, and those with a place as the middle of the shape sees them."""
        if self.points is None:
            return self.sources
        middle = np.zeros(3) if self.shape is None else self.shape.bounds().mean(axis=0)
        return self.sources + self.points.seen_from(middle)


class Part(NamedTuple):
    """A file that was written, and what it is: axes, units, colour space."""

    file: str
    about: str


def plain_name(text: str) -> str:
    """Make a name that every program takes: letters, digits, ``-`` and ``_``, never empty."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", text).strip("_") or "unnamed"


def lamp_pose(direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """Turn a lamp that shines along its own -z to stand in a unit direction: world from lamp."""
    aside = np.cross([0.0, 0, 1] if abs(direction[2]) < np.sqrt(0.5) else [1.0, 0, 0], direction)
    aside /= np.linalg.norm(aside)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([aside, np.cross(direction, aside), direction], axis=-1)
    return pose


def mesh_of(shape: Shape, textured: bool = False) -> Mesh:
    """Make the triangles of a shape; a sphere gets its own normals at every vertex.

    A ``textured`` sphere has the coordinates of a latitude-longitude image.  Raises ``ValueError``
    for a shape that has no triangles.
    """
    if isinstance(shape, Mesh):
        return shape
    if isinstance(shape, Sphere):
        if textured:
            return _globe(shape)
        ball = Mesh.icosphere(_SUBDIVISIONS)
        return Mesh(ball.vertices * shape.radius + shape.center, ball.faces, ball.vertices)
    raise ValueError(f"a {type(shape).__name__} has no triangles: use a mesh or a sphere")


def _globe(sphere: Sphere) -> Mesh:
    """Make a sphere of meridians and parallels, u = azimuth / 2 pi and v = 1 - polar / pi."""
    rows, columns = _PARALLELS, 2 * _PARALLELS
    down, along = np.meshgrid(np.arange(rows + 1), np.arange(columns + 1), indexing="ij")
    polar, azimuth = down * np.pi / rows, along * 2 * np.pi / columns
    sine = np.sin(polar)
    normals = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)], axis=-1)
    places = np.stack([along / columns, 1 - down / rows], axis=-1).reshape(-1, 2)
    number = (down * (columns + 1) + along).astype(int)
    corner, below = number[:-1, :-1], number[1:, :-1]
    right, across = number[:-1, 1:], number[1:, 1:]
    # At the poles one of the two triangles of a cell is a line, and left out.
    upper = np.stack([corner, below, right], axis=-1)[1:].reshape(-1, 3)
    lower = np.stack([right, below, across], axis=-1)[:-1].reshape(-1, 3)
    faces = np.concatenate([upper, lower])
    flat = normals.reshape(-1, 3)
    return Mesh(flat * sphere.radius + sphere.center, faces, flat, places[faces])
