"""Slow and fast light apart (T 6.3): an environment as a smooth part and directional sources.

The dual model filters light in frequency by the azimuthal mean of the specular lobe, which is
accurate for slow light only; what stands out of its surroundings within the reach of the lobe is
better treated as sources in angle.  What counts as slow depends on the roughness sigma alone, never
on the image's resolution:

1. the light is gathered into cells of at most sigma / 2;
2. its *envelope* is the largest light below it that a low pass at degree 0.3 / sigma hardly
   changes: clip by the low-passed light, and again, until it stays;
3. each cell's excess over the envelope is one directional source, the strongest first, so that a
   wide bright region becomes several.

How many of these sources are needed is decided by the error of the model that will use them
(:mod:`jaxrender.reflection.dual`), or by naming the fraction of the energy left in the slow part.
Energy and colour are conserved exactly: slow + sources = light, texel by texel.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

from jaxrender.harmonics import LatLongGrid, analyse, apply_transfer, synthesise
from jaxrender.lighting.cells import Cells, gather, partition
from jaxrender.lighting.directional import DirectionalSources
from jaxrender.lighting.environment import Environment
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Float, Int

# A source must be narrow beside the lobe, whose radius is 2 sigma.
CELL_ANGLE_PER_SIGMA = 0.5
# Degree of the low pass that defines slow, times sigma.  At a third of the lobe's own band limit
# the azimuthal mean and the lobe agree to a per cent even at grazing exit.
ENVELOPE_DEGREE_TIMES_SIGMA = 0.3
# Light within this factor of its low-passed self is slow.
_ENVELOPE_TOLERANCE = 1.05
_ENVELOPE_ROUNDS = 40


class LightSplit(eqx.Module):
    """An environment split at roughness ``sigma``: ``slow`` + ``sources`` = ``environment``."""

    environment: Environment
    slow: Environment
    sources: DirectionalSources
    sigma: float = eqx.field(static=True)

    @property
    def slow_energy(self) -> float:
        """The fraction of the light's energy that is left in the slow part."""
        slow = float(np.sum(np.asarray(self.slow.nodes().irradiance)))
        total = slow + float(np.sum(np.asarray(self.sources.irradiance)))
        return slow / total if total > 0 else 1.0


class Candidates(NamedTuple):
    """All that stands out of an environment, as sources from the strongest to the weakest.

    ``fraction`` is how much of each texel's radiance stands out, ``cell`` which cell of ``cells``
    each source stands for.
    """

    sources: DirectionalSources
    cell: Int[np.ndarray, "source"]
    cells: Cells
    fraction: Float[np.ndarray, "row column"]


def candidates(environment: Environment, sigma: float, envelope_scale: float = 1.0) -> Candidates:
    """Find what stands out of the envelope of an environment at roughness ``sigma``.

    An ``envelope_scale`` below 1 lowers the envelope; at 0 every cell of the light is a source.
    """
    cells = partition(environment, CELL_ANGLE_PER_SIGMA * sigma)
    fraction = _excess_fraction(environment, cells, sigma, envelope_scale)
    nodes, cell = gather(environment, cells, fraction)
    order = np.argsort(-nodes.irradiance.sum(axis=-1), kind="stable")
    sources = DirectionalSources(nodes.directions[order], nodes.irradiance[order])
    return Candidates(sources, cell[order], cells, fraction)


def take(environment: Environment, found: Candidates, count: int, sigma: float) -> LightSplit:
    """Make the ``count`` strongest candidates sources and leave the rest in the slow part."""
    taken = np.zeros(2 * found.cells.rows**2, bool)
    taken[found.cell[:count]] = True
    left = 1 - found.fraction * taken[found.cells.index]
    radiance = np.asarray(environment.radiance)
    slow = Environment(radiance * left[..., None].astype(radiance.dtype))
    directions, irradiance = (np.asarray(part)[:count] for part in found.sources.nodes())
    sources = DirectionalSources(directions, irradiance)
    return LightSplit(environment, slow, sources, sigma)


def split_to_energy(environment: Environment, sigma: float, slow_energy: float) -> LightSplit:
    """Split so that the fraction ``slow_energy`` of the light's energy is left in the slow part.

    The strongest sources are taken first; where all that stands out is not enough, the envelope is
    lowered.  Raises ``ValueError`` outside [0, 1].
    """
    if not 0 <= slow_energy <= 1:
        raise ValueError(f"slow_energy={slow_energy}: a fraction from 0 to 1 is meant")
    total = float(np.sum(environment.nodes().irradiance))
    wanted = (1 - slow_energy) * total
    found = candidates(environment, sigma)
    if _energies(found).sum() < wanted:
        low, high = 0.0, 1.0
        for _ in range(30):
            middle = (low + high) / 2
            enough = _energies(candidates(environment, sigma, middle)).sum() >= wanted
            low, high = (middle, high) if enough else (low, middle)
        found = candidates(environment, sigma, low)
    reached = np.concatenate([[0.0], np.cumsum(_energies(found))])
    # The last few ulps of the sum of all sources must not ask for one source more than there are.
    count = int(np.searchsorted(reached, wanted * (1 - 1e-9)))
    return take(environment, found, min(count, len(found.cell)), sigma)


def _energies(found: Candidates) -> Float[np.ndarray, "source"]:
    return np.asarray(found.sources.irradiance).sum(axis=-1)


def _excess_fraction(
    environment: Environment, cells: Cells, sigma: float, envelope_scale: float
) -> Float[np.ndarray, "row column"]:
    """How much of each texel's radiance stands above the envelope, on the cells' own grid."""
    height, width = environment.grid.shape
    rows = np.arange(height) * cells.rows // height
    columns = np.arange(width) * (2 * cells.rows) // width
    block = (rows[:, None] * 2 * cells.rows + columns[None, :]).ravel()
    weights = environment.grid.weights()
    intensity = np.asarray(environment.radiance, float).mean(axis=-1)
    energy = np.bincount(block, (weights * intensity).ravel(), 2 * cells.rows**2)
    solid_angle = np.bincount(block, weights.ravel(), 2 * cells.rows**2)
    light = (energy / solid_angle).reshape(cells.rows, 2 * cells.rows)
    envelope = envelope_scale * _envelope(light, ENVELOPE_DEGREE_TIMES_SIGMA / sigma)
    excess = np.where(light > 0, 1 - envelope / np.where(light > 0, light, 1), 0)
    return excess.clip(0, 1).ravel()[block].reshape(height, width)


def _envelope(
    light: Float[np.ndarray, "row column"], degree: float
) -> Float[np.ndarray, "row column"]:
    """Find the largest light below ``light`` that the low pass at ``degree`` hardly changes."""
    grid = LatLongGrid(*light.shape)
    band_limit = min(grid.band_limit, int(4 * degree) + 1)
    degrees = np.arange(band_limit + 1.0)
    transfer = np.exp(-degrees * (degrees + 1) / (degree * (degree + 1)))
    envelope = light
    for _ in range(_ENVELOPE_ROUNDS):
        slow = np.asarray(_low_pass(grid, envelope, transfer))
        clipped = np.minimum(envelope, _ENVELOPE_TOLERANCE * slow.clip(0))
        moved, envelope = np.max(envelope - clipped), clipped
        if moved <= 1e-4 * envelope.mean():
            break
    return envelope


@stored(partial(jax.jit, static_argnums=0), effort="less")
def _low_pass(
    grid: LatLongGrid, light: Float[AnyArray, "row column"], transfer: Float[AnyArray, " degree"]
) -> Float[Array, "row column"]:
    coefficients = analyse(grid, light[..., None], transfer.shape[0] - 1)
    return synthesise(grid, apply_transfer(coefficients, transfer))[..., 0]
