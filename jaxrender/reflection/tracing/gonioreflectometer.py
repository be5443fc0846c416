"""A gonioreflectometer without metal: the BRDF of a patch of micro-geometry (L 3.1.1).

    rho(w_i, w_r) = L_mean(w_r) / (E cos t_i)

E is the irradiance of a directional source on a plane that faces it (ERRATA 55), so E cos t_i that
on the patch's *mean plane*; L_mean is the mean radiance over the mean plane as seen from w_r, what
the highest parts hide included in what hides it.  Rays from the viewer are spread evenly over the
mean plane of the endless surface (``geometry.periodic``) and followed for ``bounces`` reflections;
every vertex is connected to *all* incident directions, of which the viewer's paths do not depend.
Hence one set of paths serves a whole hemisphere of light.

The samples of a pair of directions are 16 lattices, each shifted at random; the standard error is
that of the mean of the 16.  All incident directions of an exit direction share its paths, so their
errors are alike; those of different exit directions are independent.  Every exit direction has a
generator of its own: rows can be measured in any order, on any number of threads, or later.

What lies outside the Nusselt disc is no direction, and its entries are zero.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.brdf.samplers import DirectionSampler
from jaxrender.geometry import NUSSELT, Embedding
from jaxrender.geometry.height_fields import Patch
from jaxrender.geometry.periodic import PeriodicSurface
from jaxrender.reflection.tracing.scattering import (
    Scene,
    Vertices,
    continued,
    reflected,
    reflected_pairs,
    trace,
)
from jaxrender.shapes import AnyArray, Float

# Lattices whose scatter tells the error: known to 18 %.
GROUPS = 16
# Pairs of path and incident direction worked on at once.
_PAIRS_AT_ONCE = 2**20
_GOLDEN = (np.sqrt(5) - 1) / 2


class MeasureSettings(NamedTuple):
    """What is measured, and how well."""

    size: tuple[int, int, int, int] = (16, 16, 16, 16)
    """Samples in kappa_i, lambda_i, kappa_r and lambda_r, at the centres of cells."""
    embedding: Embedding = NUSSELT
    samples: int = 256
    """Paths for each exit direction; rounded up to a multiple of 16."""
    bounces: int = 4
    """The most reflections between facets: 1 is direct light only."""
    seed: int = 0
    region: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)
    """u0, v0, u1, v1: the part of the period looked at; it keeps its neighbourhood's shadows."""

    def check(self) -> None:
        """Raise ``ValueError`` for what cannot be measured."""
        u0, v0, u1, v1 = self.region
        if min(self.size) < 1 or self.samples < 1 or self.bounces < 1:
            raise ValueError(
                f"size {self.size}, samples {self.samples}, bounces {self.bounces}: give at least 1"
            )
        if not (0 <= u0 < u1 <= 1 and 0 <= v0 < v1 <= 1):
            raise ValueError(f"region is {self.region}: give 0 <= u0 < u1 <= 1, and v likewise")


class Block(NamedTuple):
    """The part of a measurement of one row of exit directions."""

    row: int
    """The index of kappa_r."""
    values: Float[np.ndarray, "kappa_i lambda_i lambda_r channel"]
    standard_errors: Float[np.ndarray, "kappa_i lambda_i lambda_r channel"]


class Measurement(NamedTuple):
    """A table of rho in 1/sr, and the standard error of each entry."""

    values: Float[np.ndarray, "kappa_i lambda_i kappa_r lambda_r channel"]
    standard_errors: Float[np.ndarray, "kappa_i lambda_i kappa_r lambda_r channel"]

    @classmethod
    def of(cls, blocks: Iterable[Block]) -> "Measurement":
        """Put blocks of all rows together."""
        rows = sorted(blocks, key=lambda block: block.row)
        if [block.row for block in rows] != list(range(len(rows))) or not rows:
            raise ValueError(f"blocks of rows {[b.row for b in rows]}: give each row once, from 0")
        values = np.stack([block.values for block in rows], axis=2)
        return cls(values, np.stack([block.standard_errors for block in rows], axis=2))


class MeasuredPairs(NamedTuple):
    """Values of rho in 1/sr under each incident direction, and their standard errors."""

    values: Float[np.ndarray, "direction channel"]
    standard_errors: Float[np.ndarray, "direction channel"]


class Gonioreflectometer(NamedTuple):
    """A patch under the source; ``Gonioreflectometer.of`` mounts it."""

    scene: Scene
    patch: Patch

    @classmethod
    def of(
        cls,
        patch: Patch,
        brdfs: Sequence[BRDF],
        samplers: Sequence[DirectionSampler] | None = None,
        *,
        tangents: Float[AnyArray, "face 3"] | None = None,
    ) -> "Gonioreflectometer":
        """Mount a patch whose faces have these BRDFs; raises as ``Scene.of`` does."""
        shape = PeriodicSurface(patch)
        scene = Scene.of(shape, brdfs, patch.material, tangents=tangents, samplers=samplers)
        return cls(scene, patch)

    def measure(self, settings: MeasureSettings | None = None) -> Measurement:
        """Measure a whole table."""
        return Measurement.of(self.blocks(settings or MeasureSettings()))

    def blocks(self, settings: MeasureSettings, done: Collection[int] = ()) -> Iterator[Block]:
        """Measure row by row of kappa_r, leaving out those that are done."""
        settings.check()
        for row in range(settings.size[2]):
            if row not in done:
                yield self.block(settings, row)

    def block(self, settings: MeasureSettings, row: int) -> Block:
        """Measure one row of exit directions."""
        settings.check()
        embedding, size = settings.embedding, settings.size
        light, exits = (embedding.cell_directions(s) for s in (size[:2], size[2:]))
        lit, seen = (
            np.asarray(embedding.covers(embedding.centres(s))) for s in (size[:2], size[2:])
        )
        shape = (*size[:2], size[3], self.scene.channels)
        values, errors = np.zeros(shape), np.zeros(shape)
        for column in np.flatnonzero(seen[row]):
            rng = np.random.default_rng([settings.seed, row, int(column)])
            found = self.pairs(light[lit], exits[row, column], settings, rng)
            values[lit, column], errors[lit, column] = found
        return Block(row, values, errors)

    def pairs(
        self,
        incoming: Float[np.ndarray, "direction 3"],
        outgoing: Float[np.ndarray, "3"],
        settings: MeasureSettings,
        rng: np.random.Generator,
    ) -> MeasuredPairs:
        """Measure one exit direction under any incident ones.

        Size, embedding and seed of the settings take no part.  Raises ``ValueError`` for directions
        that are not above the mean plane.
        """
        if not (outgoing[2] > 0 and (incoming[:, 2] > 0).all()):
            raise ValueError("a direction lies below the mean plane: give those above it")
        count = -(-settings.samples // GROUPS)
        region = np.array(settings.region, float).reshape(2, 2)
        at_once = max(1, min(GROUPS, _PAIRS_AT_ONCE // (count * max(len(incoming), 1))))
        means = []
        for first in range(0, GROUPS, at_once):
            groups = min(at_once, GROUPS - first)
            origins = self._footprint(outgoing, region, (groups, count), rng)
            means.append(self._means(origins, incoming, outgoing, settings.bounces, rng))
        radiance = np.concatenate(means) / incoming[:, 2, None]
        errors = radiance.std(axis=0, ddof=1) / np.sqrt(GROUPS)
        return MeasuredPairs(radiance.mean(axis=0), errors)

    def _footprint(
        self,
        outgoing: np.ndarray,
        region: Float[np.ndarray, "2 2"],
        counts: tuple[int, int],
        rng: np.random.Generator,
    ) -> Float[np.ndarray, "group sample 3"]:
        """Shifted lattices on the region of the mean plane, moved along w_r above all facets."""
        groups, count = counts
        index = np.arange(count)
        lattice = np.stack([(index + 0.5) / count, index * _GOLDEN], axis=-1)
        place = (lattice + rng.random((groups, 1, 2))) % 1
        place = region[0] + (region[1] - region[0]) * place
        flat = self.patch.rectangle[0] + self.patch.size * place
        height = float(self.scene.shape.bounds()[1, 2]) - self.patch.level
        rise = (height + 0.01 * self.scene.shape.diagonal()) / outgoing[2]
        on_plane = np.concatenate([flat, np.full((groups, count, 1), self.patch.level)], axis=-1)
        return on_plane + rise * outgoing

    def _means(
        self,
        origins: Float[np.ndarray, "group sample 3"],
        incoming: Float[np.ndarray, "direction 3"],
        outgoing: Float[np.ndarray, "3"],
        bounces: int,
        rng: np.random.Generator,
    ) -> Float[np.ndarray, "group direction channel"]:
        """Mean radiance of each group of paths under light of unit irradiance from each place."""
        groups, count = origins.shape[:2]
        scene, path = self.scene, np.arange(groups * count)
        total = np.zeros((groups, len(incoming), scene.channels))
        carried = np.ones((len(path), scene.channels))
        starts, directions = origins.reshape(-1, 3), np.tile(-outgoing, (len(path), 1))
        for bounce in range(bounces):
            vertices, _ = trace(scene, starts, directions)
            if not len(vertices.ray):
                break
            path, carried = path[vertices.ray], carried[vertices.ray]
            lit = _lit(scene, vertices, incoming) * carried[:, None, :]
            # Paths stay in order, so that each group's are neighbours.
            ends = np.searchsorted(path, count * np.arange(groups + 1))
            for group in range(groups):
                total[group] += lit[ends[group] : ends[group + 1]].sum(axis=0)
            if bounce + 1 == bounces:
                break
            drawn, density = continued(scene, vertices, rng.random((len(path), 2)))
            carried = carried * reflected(scene, vertices, drawn)
            carried /= np.where(density > 0, density, np.inf)[:, None]
            on = np.flatnonzero(carried.any(axis=1))
            kept = vertices.take(on)
            starts, directions = kept.points, kept.to_world(drawn[on])
            path, carried = path[on], carried[on]
        return total / count


def _lit(
    scene: Scene, vertices: Vertices, incoming: Float[np.ndarray, "direction 3"]
) -> Float[np.ndarray, "vertex direction channel"]:
    """Radiance at each vertex under each direction, shadows cast."""
    values = reflected_pairs(scene, vertices, incoming)
    asked = (values != 0).max(axis=2)
    hidden = scene.shape.occluded_pairs(vertices.points, incoming, asked)
    asked &= ~hidden
    return np.where(asked[:, :, None], values, 0)
