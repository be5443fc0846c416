"""Luminaires: the light that leaves a surface, in every direction from every point (L chapter 5).

A source is replaced by the light through its boundary (L 5.1).  The boundary is one patch or
several, and each has a tree of the radiance

    L_e(u, v, kappa, lambda)      W m^-2 sr^-1,      axes in this order                     (L 5.5)

at its place (u, v), in the direction that Nusselt's map puts at (kappa, lambda) in the patch's own
frame there (``surfaces``): the normal, outwards, is +Z.  Nothing leaves inwards, and seen
from behind a patch is dark.  A window is one rectangle (L 5.3.2), a bounding box six (L 5.3.3) of
which a point outside sees at most three; any other surface over (u, v) will do (L 5.3.4).

Power leaves as dPhi = L cos t dw dA = 4 L dkappa dlambda |dx'/du x dx'/dv| du dv.

Trees that were thresholded are a little negative in places.  They stay so: radiance is linear in
the coefficients, and what is left out has no mean.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.lighting.luminaires.surfaces import (
    EmittingSurface,
    Places,
    Points,
    SurfacePoints,
)
from jaxrender.shapes import AnyArray, Array, Float, Int
from jaxrender.wavelets.cells import CellForest
from jaxrender.wavelets.filters import haar
from jaxrender.wavelets.nodes import Entries
from jaxrender.wavelets.supports import is_stepwise
from jaxrender.wavelets.traversal import evaluate
from jaxrender.wavelets.tree import CoefficientTree

# Batches of lookups are padded to powers of two, at least this, so that few sizes are compiled.
_LEAST_BATCH = 64
# Nodes along u and v of a cell for its area.
_AREA_NODES = 3


class LuminaireCrossings(NamedTuple):
    """Where rays meet a luminaire first; infinitely far and patch -1 if nowhere."""

    distance: Float[np.ndarray, "ray"]
    patch: Int[np.ndarray, "ray"]
    places: Float[np.ndarray, "ray 2"]


class Seen(NamedTuple):
    """What rays see of a luminaire: zero, infinitely far, where they do not meet it."""

    radiance: Float[Array, "ray channel"]
    distance: Float[np.ndarray, "ray"]


class Luminaire(eqx.Module):
    """Patches with a tree each; all Haar trees of one size are looked up quickly.

    Raises ``ValueError`` for no patch, another number of trees, trees that have not four axes, and
    trees of different channels.
    """

    patches: tuple[EmittingSurface, ...]
    trees: tuple[CoefficientTree, ...]
    convex: bool = eqx.field(static=True)
    """Whether no part of the outside hides another, so that none is looked for."""
    forest: CellForest | None

    def __init__(
        self,
        patches: Sequence[EmittingSurface],
        trees: Sequence[CoefficientTree],
        *,
        convex: bool | None = None,
    ):
        """``convex`` is by default that of a single patch, else False; say True for a box."""
        if not patches or len(patches) != len(trees):
            raise ValueError(f"{len(patches)} patches and {len(trees)} trees; give one for each")
        for tree in trees:
            if tree.axes != 4 or tree.channels != trees[0].channels:
                raise ValueError(
                    f"a tree of {tree.axes} axes and {tree.channels} channels; give axes u, v, "
                    f"kappa, lambda and {trees[0].channels} channels as the first has"
                )
        self.patches, self.trees = tuple(patches), tuple(trees)
        self.convex = (len(patches) == 1 and patches[0].convex) if convex is None else convex
        alike = len({tree.size for tree in trees}) == 1
        quick = alike and all(is_stepwise(tree.wavelet) for tree in trees)
        self.forest = CellForest.of(trees) if quick else None

    @classmethod
    def uniform(
        cls,
        patches: Sequence[EmittingSurface],
        radiance: Float[AnyArray, "channel"],
        *,
        convex: bool | None = None,
    ) -> "Luminaire":
        """Make one with the same radiance everywhere, in every direction."""
        radiance = np.asarray(radiance)
        none = np.zeros(0, np.int64)
        empty = Entries(none, none, none, np.zeros((0, len(radiance)), radiance.dtype))
        tree = CoefficientTree.of_entries(haar(), 2, 4, empty, radiance)
        return cls(patches, (tree,) * len(patches), convex=convex)

    @property
    def channels(self) -> int:
        """Of the radiance."""
        return self.trees[0].channels

    @property
    def size(self) -> int:
        """How many cells the finest tree has along each axis."""
        return max(tree.size for tree in self.trees)

    def at(self, patch: Int[np.ndarray, "point"], places: Places) -> SurfacePoints:
        """Evaluate points, frames and areas at places of several patches."""
        count = len(places)
        on = SurfacePoints(np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros(count))
        for index, surface in enumerate(self.patches):
            row = np.flatnonzero(patch == index)
            if len(row):
                for whole, part in zip(on, surface.at(places[row])):
                    whole[row] = part
        return on

    def radiance(
        self,
        places: Places,
        directions: Points,
        patch: Int[np.ndarray, "point"] | None = None,
    ) -> Float[Array, "point channel"]:
        """Look up the radiance that leaves places in unit world directions, W m^-2 sr^-1.

        Zero for directions that do not leave; of the first patch unless told.
        """
        patch = np.zeros(len(places), np.int64) if patch is None else np.asarray(patch)
        frames = self.at(patch, places).frames
        local = np.einsum("pij,pi->pj", frames, directions)
        shadow = (local[:, :2] + 1) / 2
        found = self._lookup(np.concatenate([places, shadow], axis=1), patch)
        return jnp.where(jnp.asarray(local[:, 2:] > 0), found, 0)

    def crossings(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> LuminaireCrossings:
        """Find where rays of unit direction meet the first patch, from either side."""
        count = len(origins)
        nearest = LuminaireCrossings(
            np.full(count, np.inf), np.full(count, -1), np.zeros((count, 2))
        )
        for index, surface in enumerate(self.patches):
            distance, places = surface.crossings(origins, directions)
            row = np.flatnonzero(distance < nearest.distance)
            nearest.distance[row] = distance[row]
            nearest.patch[row] = index
            nearest.places[row] = places[row]
        return nearest

    def radiance_along(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Seen:
        """Look along rays of unit direction: the radiance that comes back, and from how far."""
        found = self.crossings(origins, directions)
        hit = jnp.asarray(np.isfinite(found.distance)[:, None])
        patch = np.maximum(found.patch, 0)
        radiance = self.radiance(found.places, -directions, patch)
        return Seen(jnp.where(hit, radiance, 0), found.distance)

    def power(self) -> Float[Array, "channel"]:
        """Integrate the radiance: W in each channel, exactly for Haar trees on flat patches."""
        total = jnp.zeros(self.channels, self.trees[0].values.dtype)
        for surface, tree in zip(self.patches, self.trees):
            area = jnp.asarray(cell_areas(surface, tree.size), total.dtype)
            disc = jnp.asarray(4 * disc_shares(tree.size), total.dtype)
            samples = tree.samples()
            total = total + jnp.einsum("uvklc,uv,kl->c", samples, area, disc, precision="highest")
        return total

    def _lookup(
        self, points: Float[np.ndarray, "point 4"], patch: Int[np.ndarray, "point"]
    ) -> Float[Array, "point channel"]:
        dtype = self.trees[0].values.dtype
        if self.forest is not None:
            padded = jnp.asarray(_padded(points, dtype))
            numbers = jnp.asarray(_padded(patch, np.dtype(np.int32)))
            return self.forest.evaluate(padded, numbers)[: len(points)]
        found = jnp.zeros((len(points), self.channels), dtype)
        for index, tree in enumerate(self.trees):
            row = np.flatnonzero(patch == index)
            if len(row):
                values = evaluate(tree, jnp.asarray(_padded(points[row], dtype)))
                found = found.at[jnp.asarray(row)].set(values[: len(row)])
        return found


def cell_areas(surface: EmittingSurface, size: int) -> Float[np.ndarray, "u v"]:
    """Integrate a surface's area over each of size x size cells of (u, v), by 3 x 3 nodes."""
    nodes, weights = np.polynomial.legendre.leggauss(_AREA_NODES)
    line = (np.arange(size)[:, None] + (nodes + 1) / 2).ravel() / size
    places = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    area = surface.at(places).area.reshape(size, _AREA_NODES, size, _AREA_NODES)
    return np.einsum("uavb,a,b->uv", area, weights, weights) / (2 * size) ** 2


def disc_shares(size: int) -> Float[np.ndarray, "kappa lambda"]:
    """Give each cell's area of (kappa, lambda) that stands for directions; pi / 4 in sum, exactly.

    Of a cell [a, b] x [c, d] in the quarter of the unit disc that is the integral over x of
    clip(sqrt(1 - x^2), c, d) - c.
    """
    edges = np.linspace(0, 1, size + 1)
    a, c = (part.ravel() for part in np.meshgrid(edges[:-1], edges[:-1], indexing="ij"))
    b, d = a + 1 / size, c + 1 / size
    full = np.clip(np.sqrt(np.maximum(1 - d * d, 0)), a, b)
    none = np.clip(np.sqrt(np.maximum(1 - c * c, 0)), a, b)
    part = _under_circle(none) - _under_circle(full) - c * (none - full)
    quarter = ((full - a) * (d - c) + part).reshape(size, size) / 4
    # The quarter has cells half as wide as those of the square: two by two are one.
    disc = np.block([[quarter[::-1, ::-1], quarter[::-1]], [quarter[:, ::-1], quarter]])
    return disc.reshape(size, 2, size, 2).sum(axis=(1, 3))


def _under_circle(x: np.ndarray) -> np.ndarray:
    """Integrate sqrt(1 - x^2) from 0."""
    x = np.clip(x, 0, 1)
    return (x * np.sqrt(1 - x * x) + np.arcsin(x)) / 2


def _padded(rows: np.ndarray, dtype: np.dtype) -> np.ndarray:
    wanted = max(_LEAST_BATCH, 1 << max(len(rows) - 1, 0).bit_length())
    padded = np.zeros((wanted, *rows.shape[1:]), dtype)
    padded[: len(rows)] = rows
    return padded
