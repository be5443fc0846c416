"""What measured materials have in common: their principal components, to complete others by.

Values are mapped to logarithms relative to the median material, cosines included,

    x = log((rho c + e) / (rho_median c + e)),   c = cos t_i cos t_o,   e = 1e-3 / sr,

as Nielsen, Jensen and Ramamoorthi do (On Optimal, Minimal BRDF Sampling for Reflectance
Acquisition, 2015).  Each channel of each material is one column of what is learnt.  Components are
scaled so that the coefficients of the columns have variance 1.
"""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxrender.brdf.tables.isotropic import (
    HalfDifference,
    corners,
    half_difference,
    nearest_known,
    node_angles,
    pair_at,
)
from jaxrender.geometry import Components
from jaxrender.shapes import Bool, Float, checked

# Reflectance below this, in 1/sr, is as good as none.
FLOOR = 1e-3
# At grazing the cosines' product counts as this.
_LEAST_COSINE = 1e-3
# The columns at a node are read this many nodes at a time.
_BLOCK = 50_000
_FOLDS = 10
# Fewer materials have too little in common to be told from chance.
FEWEST_MATERIALS = 5
# Reference, mean and what is left out come before the components.
_BEFORE = 3


class LearnedRows(NamedTuple):
    """What is learnt, at pairs of directions or at nodes.

    ``level`` is the median material times the cosines, and ``cosine`` their product.
    """

    mean: Float[np.ndarray, "pair"]
    components: Float[np.ndarray, "pair component"]
    left_out: Float[np.ndarray, "pair"]
    level: Float[np.ndarray, "pair"]
    cosine: Float[np.ndarray, "pair"]

    def logs(self, values: Float[np.ndarray, "pair channel"]) -> Float[np.ndarray, "pair channel"]:
        """Map values in 1/sr to relative logarithms."""
        over = values * self.cosine[:, None] + FLOOR
        return np.log(over / (self.level + FLOOR)[:, None])

    def values(self, logs: Float[np.ndarray, "pair"]) -> Float[np.ndarray, "pair"]:
        """Map relative logarithms to values in 1/sr, none of them below 0."""
        return np.maximum(np.exp(logs) * (self.level + FLOOR) - FLOOR, 0) / self.cosine

    def slopes(self, logs: Float[np.ndarray, "pair"]) -> Float[np.ndarray, "pair"]:
        """Say how much a value in 1/sr changes with its relative logarithm."""
        return np.exp(logs) * (self.level + FLOOR) / self.cosine


class LearnedMaterials(NamedTuple):
    """Principal components over half and difference angles.

    ``table`` holds for each node of ``IsotropicTable`` the median material in 1/sr, the mean of the
    columns' logarithms, the variance that the components leave of a material that was not learnt,
    and the components.  ``known`` says at which nodes every material was measured; others hold what
    their neighbours do.
    """

    table: Float[np.ndarray, "theta_h theta_d phi_d part"]
    known: Bool[np.ndarray, "theta_h theta_d phi_d"]

    @property
    def shape(self) -> tuple[int, int, int]:
        """How many nodes there are of each angle."""
        n_h, n_d, n_p = self.known.shape
        return n_h, n_d, n_p

    @property
    def count(self) -> int:
        """How many components there are."""
        return self.table.shape[-1] - _BEFORE

    def at_nodes(self, index: slice) -> LearnedRows:
        """Look up some of the nodes, numbered along the last angle first."""
        cosine = node_cosines(self.shape)[index]
        return _rows(self.table.reshape(-1, self.table.shape[-1])[index].astype(float), cosine)

    @checked
    def at_pairs(
        self, incoming: Float[np.ndarray, "pair 3"], outgoing: Float[np.ndarray, "pair 3"]
    ) -> LearnedRows:
        """Interpolate at pairs of local unit directions, +Z the normal."""
        angles = half_difference(Components.of(incoming), Components.of(outgoing))
        flat = self.table.reshape(-1, self.table.shape[-1])
        parts = [
            np.asarray(corner.weight, float)[:, None] * flat[np.asarray(corner.index)]
            for corner in corners(self.shape, angles)
        ]
        return _rows(np.sum(parts, axis=0), incoming[:, 2] * outgoing[:, 2])


@functools.lru_cache(maxsize=2)
def node_cosines(shape: tuple[int, int, int]) -> Float[np.ndarray, "node"]:
    """Multiply the cosines of both directions at each node; at least 1e-3."""
    incoming, outgoing = pair_at(HalfDifference(*(np.asarray(a) for a in node_angles(shape))))
    above = np.maximum(incoming[..., 2], 0) * np.maximum(outgoing[..., 2], 0)
    return np.maximum(above, _LEAST_COSINE).ravel()


def _rows(table: Float[np.ndarray, "pair part"], cosine: Float[np.ndarray, "pair"]) -> LearnedRows:
    cosine = np.maximum(cosine, _LEAST_COSINE)
    reference, mean, left_out = table[:, :_BEFORE].T
    return LearnedRows(mean, table[:, _BEFORE:], left_out, reference * cosine, cosine)


def learn_materials(
    tables: Sequence[np.ndarray],
    scales: Float[np.ndarray, "channel"],
    count: int = 40,
) -> LearnedMaterials:
    """Learn ``count`` components of tables, each [channel, theta_h, theta_d, phi_d].

    Values times ``scales`` are in 1/sr; what is negative was not measured.  Tables may be mapped
    from files: they are read in parts, thrice.  Raises ``ValueError`` for fewer than five tables,
    tables of several sizes, more components than the columns have, and no node in common.
    """
    if len(tables) < FEWEST_MATERIALS:
        raise ValueError(f"{len(tables)} materials: give at least {FEWEST_MATERIALS}")
    sizes = {one.shape for one in tables}
    if len(sizes) > 1 or len(next(iter(sizes))) != 4:
        raise ValueError(f"tables have the sizes {sorted(sizes)}: give all one size, of four axes")
    columns = len(tables) * len(scales)
    # Half of the columns at least have to say what is left out.
    if not 1 <= count <= columns // 2:
        raise ValueError(f"{count} components: {columns} columns tell 1 to {columns // 2}")
    shape = tables[0].shape[1:]
    flat = [one.reshape(len(scales), -1) for one in tables]
    known = np.ones(flat[0].shape[1], bool)
    for one in flat:
        known &= np.all(one >= 0, axis=0)
    places = np.nonzero(known)[0]
    if not len(places):
        raise ValueError("no node was measured of all materials")
    cosine = node_cosines(shape)
    part = np.zeros((known.size, _BEFORE + count), np.float32)

    def logs(some: np.ndarray) -> np.ndarray:
        """Read the columns at some nodes, keep their median and mean, and return what is left."""
        values = np.concatenate([one[:, some] * scales[:, None] for one in flat]).T
        part[some, 0] = np.median(values, axis=1)
        rows = _rows(part[some].astype(float), cosine[some])
        found = rows.logs(values)
        part[some, 1] = np.mean(found, axis=1)
        return found - np.mean(found, axis=1, keepdims=True)

    blocks = [places[first : first + _BLOCK] for first in range(0, len(places), _BLOCK)]
    gram = np.zeros((columns, columns))
    for some in blocks:
        centred = logs(some)
        gram += centred.T @ centred
    squares, vectors = np.linalg.eigh(gram)
    largest = np.argsort(squares)[::-1][:count]
    turn = vectors[:, largest] / np.sqrt(columns)
    own = float(np.trace(gram) - np.sum(squares[largest]))
    # Materials that are not among those learnt are left with more.
    worse = _left_of_others(gram, len(scales), count) / max(own, 1e-30 * float(np.trace(gram)))
    for some in blocks:
        centred = logs(some)
        components = centred @ turn
        left = np.mean(centred**2, axis=1) - np.sum(components**2, axis=1)
        part[some, _BEFORE:] = components
        part[some, 2] = worse * np.maximum(left, 0)
    nearest = nearest_known(known.reshape(shape)).ravel()
    return LearnedMaterials(part[nearest].reshape(*shape, -1), known.reshape(shape))


def _left_of_others(gram: Float[np.ndarray, "column column"], channels: int, count: int) -> float:
    """Sum up the squares that components of some materials leave of others, each left out once."""
    columns = len(gram)
    material = np.arange(columns) // channels
    # At most so many folds as materials; a material's channels stay together.
    fold = np.random.default_rng(0).permutation(material[-1] + 1)[material] % _FOLDS
    left = 0.0
    for number in np.unique(fold):
        out = fold == number
        mean = np.where(out, 0, 1 / np.sum(~out))[:, None]
        inside = np.eye(columns)[:, ~out] - mean
        outside = np.eye(columns)[:, out] - mean
        squares, vectors = np.linalg.eigh(inside.T @ gram @ inside)
        largest = np.argsort(squares)[::-1][:count]
        size = np.sqrt(np.maximum(squares[largest], 1e-30 * squares[largest[0]]))
        across = (vectors[:, largest] / size).T @ inside.T @ gram @ outside
        left += float(np.einsum("ij,ik,kj->", outside, gram, outside) - np.sum(across**2))
    return max(left, 0.0)
