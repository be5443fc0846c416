"""A BRDF as what a wavelet tree is made of: means over the cells of Nusselt's square.

A coefficient is an integral of the function (L 4.6), and the finest ones are means over cells.  A
single sample at a cell's centre is a poor mean of a lobe narrower than the cell; worse, centres are
mirror images of each other, so that all of a mirror's peak is met and spread over whole cells.  So
each cell has several samples: the first numbers of a Sobol sequence, and the same with the two
directions exchanged, which leaves a reciprocal BRDF a reciprocal table.  Off the disc it is zero.

``TabulatedBRDF.of`` refuses what is not finite; measurements have holes, and recovered series are
negative in places.  Here such samples are left out of their cell's mean, and cells without another
one are filled and counted.  Host side.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Shaped
from scipy.stats import qmc

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.parameters import refuse_unlisted
from jaxrender.brdf.tables.cells import Table, cell_weights, masked, values_of_pairs
from jaxrender.geometry import NUSSELT
from jaxrender.shapes import Float, Int

FILLS = ("nearest", "zero")
_evaluate = eqx.filter_jit(BRDF.evaluate)


class Samples(NamedTuple):
    """Means in 1/sr, and how many of them had no sample but negative or not finite ones."""

    values: Table
    masked: int


class Behaviour(NamedTuple):
    """What a table does: of its rms how much changes when the directions do; its largest albedo."""

    reciprocity_error: float
    largest_albedo: float


def tabulate(
    brdf: BRDF,
    size: int,
    fill: str = "nearest",
    dtype: type = np.float32,
    cell_samples: int = 1,
) -> Samples:
    """Average every channel over ``size``^4 cells of Nusselt's square, each of some samples.

    One sample is the cell's centre; else an even number of them.  Only samples above the horizon
    count, and a cell without any is 0.  Evaluated in JAX's default precision, some pairs at a time,
    and kept in ``dtype``.  Cells without a valid sample take the ``nearest`` valid one or ``zero``.
    Raises ``ValueError`` for an unlisted ``fill``, a size without any direction, and an odd number
    of samples but one.
    """
    refuse_unlisted("fill", fill, FILLS)
    cells = _touched(size)
    pairs, counts = (len(cells), len(cells)), np.zeros(())
    total, met = np.zeros(0), np.zeros(pairs, bool)
    for offset in _offsets(cell_samples):
        places = [(cells + part) / size for part in (offset[:2], offset[2:])]
        above = np.logical_and.outer(*(np.array(NUSSELT.covers(part)) for part in places))
        directions = [np.asarray(NUSSELT.direction_from_square(part), float) for part in places]
        found = values_of_pairs(partial(_evaluate, brdf), directions[0], directions[1])
        valid = np.isfinite(found) & (found >= 0) & above[..., None]
        if not total.size:
            total, counts = np.zeros(found.shape, dtype), np.zeros(found.shape, np.uint16)
        total += np.where(valid, found, 0)
        counts += valid
        met |= above
    total /= np.maximum(counts, 1)
    missing = met[..., None] & (counts == 0)
    count = int(np.count_nonzero(missing))
    if not count:
        return Samples(_laid_out(total, cells, size, 0.0), 0)
    # Were it zero beyond the horizon, holes near it would be filled with darkness.
    total[missing | ~met[..., None]] = np.nan
    table = masked(_laid_out(total, cells, size, np.nan), fill).values
    return Samples(table * _laid_out(met[..., None], cells, size, 0.0), count)


def behaviour(values: Table) -> Behaviour:
    """Measure a table on Nusselt's square, of one size along all axes."""
    reverse = values.transpose(2, 3, 0, 1, 4)
    size = np.sqrt(np.mean(np.square(values), dtype=float))
    apart = np.sqrt(np.mean(np.square(values - reverse), dtype=float))
    weights = cell_weights(NUSSELT, (len(values), len(values))).astype(values.dtype)
    albedo = np.einsum("ijklc,kl->ijc", values, weights, optimize=True)
    return Behaviour(float(apart / size) if size > 0 else 0.0, float(albedo.max()))


def _touched(size: int) -> Int[np.ndarray, "cell 2"]:
    """List the cells of which some part is in the disc."""
    cells = np.argwhere(np.ones((size, size), bool))
    # The place of a cell that is nearest to the disc's centre.
    nearest = np.clip(0.5, cells / size, (cells + 1) / size)
    return cells[np.sum((nearest - 0.5) ** 2, axis=1) < 0.25]


def _laid_out(
    found: Shaped[np.ndarray, "incoming outgoing channel"],
    cells: Int[np.ndarray, "cell 2"],
    size: int,
    elsewhere: float,
) -> Table:
    """Put the values of all pairs of cells where they belong on the squares."""
    places = np.asarray(np.ravel_multi_index((cells[:, 0], cells[:, 1]), (size, size)))
    rows = np.full(
        (size**2, size**2, found.shape[-1]), elsewhere, np.result_type(found, np.float32)
    )
    rows[np.ix_(places, places)] = found
    return rows.reshape(*(size,) * 4, -1)


def _offsets(count: int) -> Float[np.ndarray, "sample 4"]:
    """Lay out a cell's samples on the unit cube."""
    if count == 1:
        return np.full((1, 4), 0.5)
    if count < 1 or count % 2:
        raise ValueError(f"cell_samples={count}: give 1, or an even number such as 16")
    # Unscrambled, the first is a corner; the seed is part of what is computed.
    sequence = qmc.Sobol(4, scramble=True, rng=0)
    half = sequence.random_base2(int(np.ceil(np.log2(count // 2))))[: count // 2]
    return np.concatenate([half, half[:, [2, 3, 0, 1]]])
