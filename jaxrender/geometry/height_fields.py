"""Patches of micro-geometry: what a surface looks like where a BRDF has become geometry (L 3.1.1).

A patch is a mesh over a rectangle of the plane, by default the unit square, that repeats itself in
x and y for ever; +Z is the normal of the mean plane.  Each face names its material, an index into
whatever list of facet BRDFs it is measured with.  Parts may lean over the rectangle's sides, as
threads do: they then belong to the neighbour's air space too.

``height_field`` takes heights, ``gaussian_surface`` draws them at random, ``sawtooth`` makes the
ridges of L figure 3.2 and ``velvet`` the cut threads of L figure 3.3.  Lengths are in units of the
rectangle's side, angles in radians.  Host side, NumPy float64.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.geometry.mesh import Mesh
from jaxrender.shapes import AnyArray, Float, Int, checked

UNIT_SQUARE = np.array([[0.0, 0.0], [1.0, 1.0]])

# Parts may reach over the rectangle by less than this much of it.
_LARGEST_OVERHANG = 0.9


class Patch(NamedTuple):
    """One period of a surface; ``Patch.of`` makes a checked one."""

    mesh: Mesh
    material: Int[np.ndarray, "face"]
    rectangle: Float[np.ndarray, "2 2"]
    """Lower and upper corner (x, y) of one period."""
    level: float
    """Height of the mean plane."""

    @classmethod
    @checked
    def of(
        cls,
        mesh: Mesh,
        material: Int[AnyArray, "face"] | None = None,
        rectangle: Float[AnyArray, "2 2"] | None = None,
        level: float | None = None,
    ) -> "Patch":
        """Take any mesh; its bounding box gives the rectangle and half its height the level.

        Raises ``ValueError`` for materials that are negative or not one a face, for an empty
        rectangle, and for a mesh that reaches nearly a whole period over the rectangle.
        """
        lower, upper = mesh.bounds()
        chosen = np.zeros(len(mesh.faces), int) if material is None else np.asarray(material, int)
        if len(chosen) != len(mesh.faces) or chosen.min() < 0:
            raise ValueError(
                f"{len(chosen)} materials, the least {chosen.min(initial=0)}, for "
                f"{len(mesh.faces)} faces: give each face an index from 0"
            )
        corners = np.stack([lower[:2], upper[:2]]) if rectangle is None else rectangle
        corners = np.array(corners, float)
        size = corners[1] - corners[0]
        if not (np.isfinite(corners).all() and (size > 0).all()):
            raise ValueError(f"rectangle is {corners.tolist()}: give its lower and upper corner")
        over = np.max([corners[0] - lower[:2], upper[:2] - corners[1]] / size)
        if over > _LARGEST_OVERHANG:
            raise ValueError(
                f"the mesh reaches {over:.3g} periods over its rectangle {corners.tolist()}: give "
                f"a larger one; up to {_LARGEST_OVERHANG} is possible"
            )
        middle = (lower[2] + upper[2]) / 2 if level is None else level
        return cls(mesh, chosen, corners, float(middle))

    @property
    def materials(self) -> int:
        """How many facet BRDFs the patch wants."""
        return int(self.material.max()) + 1

    @property
    def size(self) -> Float[np.ndarray, "2"]:
        """The sides of the rectangle."""
        return self.rectangle[1] - self.rectangle[0]


@checked
def height_field(
    heights: Float[AnyArray, "row column"], size: tuple[float, float] = (1.0, 1.0)
) -> Patch:
    """Triangulate heights z at x = column / columns, y = row / rows of a rectangle of that size.

    The field goes on periodically: behind the last row comes the first.  Every cell is two
    triangles.  Raises ``ValueError`` for heights that are not finite and for an empty field.
    """
    heights = np.asarray(heights, float)
    if min(heights.shape) < 1 or not np.isfinite(heights).all():
        raise ValueError(f"heights of shape {heights.shape}: give finite ones, at least one")
    rows, columns = heights.shape
    around = np.pad(heights, ((0, 1), (0, 1)), mode="wrap")
    y, x = np.meshgrid(
        size[1] * np.arange(rows + 1) / rows, size[0] * np.arange(columns + 1) / columns,
        indexing="ij",
    )  # fmt: skip
    vertices = np.stack([x, y, around], axis=-1).reshape(-1, 3)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    right, above = corner + 1, corner + columns + 1
    lower = np.stack([corner, right, above + 1], axis=-1)
    upper = np.stack([corner, above + 1, above], axis=-1)
    faces = np.stack([lower, upper], axis=1).reshape(-1, 3)
    corners = np.array([[0.0, 0.0], size])
    return Patch.of(Mesh(vertices, faces), None, corners, float(heights.mean()))


def gaussian_surface(
    rms_slope: float, cells: int = 128, correlation: float = 0.05, seed: int = 0
) -> Patch:
    """Draw a periodic random surface of Gaussian heights and autocorrelation exp(-r^2 / c^2).

    ``rms_slope`` is the root mean square of |grad z| over the facets (scaled to be so exactly):
    the m of Beckmann's distribution.  ``correlation`` c is in units of the side.  Raises
    ``ValueError`` for a negative slope and for a correlation that the cells do not resolve.
    """
    if not rms_slope >= 0 or cells < 4 or not 1.5 / cells <= correlation <= 0.3:
        raise ValueError(
            f"rms_slope {rms_slope}, correlation {correlation} on {cells} cells: give a slope "
            "from 0 and a correlation of at least 1.5 cells, at most .3 of the side"
        )
    noise = np.random.default_rng(seed).normal(size=(cells, cells))
    frequency = 2 * np.pi * np.fft.fftfreq(cells, 1 / cells)
    square = frequency[:, None] ** 2 + frequency[None, :] ** 2
    spectrum = np.fft.fft2(noise) * np.exp(-square * correlation**2 / 8)
    spectrum[0, 0] = 0
    heights = np.real(np.fft.ifft2(spectrum))
    normals = height_field(heights).mesh.face_normals()
    found = np.sqrt(np.mean((normals[:, 0] ** 2 + normals[:, 1] ** 2) / normals[:, 2] ** 2))
    return height_field(heights * (rms_slope / found))


def sawtooth(teeth: int = 4, rising: float = np.pi / 4, falling: float = np.pi / 4) -> Patch:
    """Lay ridges along y whose sides rise and fall (in x) at these angles to the mean plane.

    Rising sides, which face -x, have material 0, falling ones material 1 (L figure 3.2).  Raises
    ``ValueError`` for no teeth and for angles outside (0, pi/2].
    """
    if teeth < 1 or not all(0 < angle <= np.pi / 2 for angle in (rising, falling)):
        raise ValueError(
            f"{teeth} teeth, angles {rising:.4g} and {falling:.4g}: give at least one tooth and "
            "angles in (0, pi/2]"
        )
    runs = 1 / np.tan([rising, falling])
    runs = np.maximum(runs, 0)
    height = 1 / (teeth * runs.sum()) if runs.sum() > 1e-9 else np.inf
    if not np.isfinite(height):
        raise ValueError("both sides upright enclose nothing: make an angle smaller")
    foot = np.arange(teeth + 1) / teeth
    crest = foot[:-1] + height * runs[0]
    x = np.empty(2 * teeth + 1)
    x[::2], x[1::2] = foot, crest
    z = np.where(np.arange(len(x)) % 2, height, 0.0)
    vertices = np.concatenate([np.stack([x, np.full_like(x, y), z], axis=-1) for y in (0.0, 1.0)])
    near = np.arange(2 * teeth)
    far = near + len(x)
    faces = np.stack(
        [np.stack([near, near + 1, far + 1], -1), np.stack([near, far + 1, far], -1)], axis=1
    )
    material = np.repeat(near % 2, 2)
    return Patch.of(Mesh(vertices, faces.reshape(-1, 3)), material, UNIT_SQUARE, height / 2)


def velvet(
    threads: int = 600,
    length: float = 0.3,
    radius: float = 0.008,
    lean: float = 0.35,
    *,
    spread: float = 0.15,
    azimuth: float = 0.0,
    sides: int = 6,
    seed: int = 0,
) -> Patch:
    """Set cut threads (material 1) at random places of a flat base (material 0; L figure 3.3).

    Each is a prism with a lid, ``length`` along its axis, whose axis leans from the normal by
    ``lean`` towards ``azimuth``, scattered normally by ``spread`` in both tangents.  Raises
    ``ValueError`` for fewer than one thread or three sides, and for lengths that are not positive.
    """
    if threads < 1 or sides < 3 or not (length > 0 and radius > 0 and 0 <= lean < np.pi / 2):
        raise ValueError(
            f"{threads} threads of {sides} sides, length {length}, radius {radius}, lean {lean}: "
            "give at least one thread of three sides, positive lengths and a lean in [0, pi/2)"
        )
    rng = np.random.default_rng(seed)
    feet = np.concatenate([rng.uniform(size=(threads, 2)), np.zeros((threads, 1))], axis=1)
    tilt = np.tan(lean) * np.array([np.cos(azimuth), np.sin(azimuth)])
    tilts = tilt + spread * rng.normal(size=(threads, 2))
    axes = np.concatenate([tilts, np.ones((threads, 1))], axis=1)
    axes *= length / np.linalg.norm(axes, axis=1, keepdims=True)
    turns = rng.uniform(0, 2 * np.pi, (threads, 1)) + 2 * np.pi * np.arange(sides) / sides
    ring = radius * np.stack([np.cos(turns), np.sin(turns), np.zeros_like(turns)], axis=-1)
    bottom = feet[:, None, :] + ring
    vertices = np.concatenate([bottom, bottom + axes[:, None, :]], axis=1).reshape(-1, 3)
    base = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    offsets = 4 + 2 * sides * np.arange(threads)
    faces = (_prism(sides)[None] + offsets[:, None, None]).reshape(-1, 3)
    faces = np.concatenate([[[0, 1, 2], [0, 2, 3]], faces])
    material = np.minimum(np.arange(len(faces)) // 2, 1)
    return Patch.of(Mesh(np.concatenate([base, vertices]), faces), material, UNIT_SQUARE, 0.0)


def _prism(sides: int) -> Int[np.ndarray, "face 3"]:
    """The walls and the lid over a ring of vertices and its copy, wound outwards."""
    ring = np.arange(sides)
    following = (ring + 1) % sides
    walls = [
        np.stack([ring, following, following + sides], axis=-1),
        np.stack([ring, following + sides, ring + sides], axis=-1),
    ]
    inner = np.arange(1, sides - 1)
    lid = np.stack([np.zeros_like(inner), inner, inner + 1], axis=-1) + sides
    return np.concatenate([*walls, lid])
