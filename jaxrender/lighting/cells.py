"""Near-equal cells on the sphere, and what an environment holds in each of them.

A cell replaces many texels by one point mass: their summed irradiance at the direction of their
energy-weighted mean, so that energy is conserved exactly and direction to second order in the
cell's angle.  The cells are nested (their rows are a power of two) and do not know how the image
was sampled: the same light at two resolutions falls into the same cells.
"""

import math
from typing import NamedTuple

import numpy as np

from jaxrender.lighting.base import LightNodes
from jaxrender.lighting.environment import Environment
from jaxrender.shapes import Float, Int

# Never fewer columns than this in a row of cells, even at a pole.
_FEWEST_COLUMNS = 4


class Cells(NamedTuple):
    """A partition of an environment's texels: ``rows`` and the flat cell index of each texel."""

    rows: int
    index: Int[np.ndarray, "row column"]


def partition(environment: Environment, angle: float) -> Cells:
    """Partition an environment into nested cells no larger than ``angle`` radians.

    An image coarser than that keeps its texels (merged towards the poles).
    """
    if not angle > 0:
        raise ValueError(f"angle={angle}: a cell's angle must be above 0 radians")
    height, width = environment.grid.shape
    rows = min(2 ** max(2, math.ceil(math.log2(math.pi / angle))), height)
    row = np.arange(height) * rows // height
    polar = (row + 0.5) * np.pi / rows
    # Halve the number of columns each time that the circle of latitude has shrunk to half.
    halvings = np.floor(np.log2(1 / np.sin(polar))).astype(int)
    columns = np.maximum(2 * rows >> halvings, min(_FEWEST_COLUMNS, 2 * rows))
    column = np.arange(width)[None, :] * columns[:, None] // width
    return Cells(rows, row[:, None] * 2 * rows + column)


class CellLight(NamedTuple):
    """One point mass per non-empty cell, and which cell it stands for."""

    nodes: LightNodes
    cell: Int[np.ndarray, "node"]


def gather(
    environment: Environment, cells: Cells, fraction: Float[np.ndarray, "row column"]
) -> CellLight:
    """Gather the given fraction of each texel's light into one point mass per non-empty cell."""
    irradiance = (
        np.asarray(environment.radiance, float) * (environment.grid.weights() * fraction)[..., None]
    )
    intensity = irradiance.mean(axis=-1, keepdims=True)
    energy = _sum_by_cell(cells, irradiance)
    centre = _sum_by_cell(cells, environment.grid.directions() * intensity)
    length = np.linalg.norm(centre, axis=-1)
    occupied = np.flatnonzero(length > 0)
    directions = centre[occupied] / length[occupied, None]
    dtype = environment.radiance.dtype
    nodes = LightNodes(directions.astype(dtype), energy[occupied].astype(dtype))
    return CellLight(nodes, occupied)


def condensed(environment: Environment, angle: float) -> LightNodes:
    """Replace an environment by point masses, one for each cell of at most ``angle`` radians."""
    cells = partition(environment, angle)
    return gather(environment, cells, np.ones(environment.grid.shape)).nodes


def _sum_by_cell(
    cells: Cells, values: Float[np.ndarray, "row column k"]
) -> Float[np.ndarray, "cell k"]:
    index, count = cells.index.ravel(), 2 * cells.rows * cells.rows
    columns = values.reshape(-1, values.shape[-1]).T
    return np.stack([np.bincount(index, column, count) for column in columns], axis=-1)
