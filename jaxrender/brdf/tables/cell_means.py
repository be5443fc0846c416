"""A BRDF as what a wavelet tree is made of: means over the cells of Nusselt's square.

A coefficient is an integral of the function (L 4.6), and the finest ones are means over cells.  A
single sample at a cell's centre is a poor mean of a lobe narrower than the cell; worse, centres are
mirror images of each other, so that all of a mirror's peak is met and spread over whole cells, and
a material that reflects a fifth of the light sends out many times what arrives.

So each pair of cells has some even samples, and each cell many about the mirror directions of its
own (``mirror_lobes``), which fall into whatever cells they meet.  All samples of a pair of cells
are weighed together by the balance heuristic (Veach 1997),

    mean = c + sum of W (rho - c),      W = 1 / (n + m a p 4 / cos t_r),

with n even samples, m about the mirror, a the area of the outgoing cell: 4 / cos t_r turns p per
steradian into per area of the square.  The weights' sum is 1 but for noise, which c, the least of
the even samples, keeps away from what is constant.  Samples on a cell of the rim are in the part
of it that the disc covers, and off the disc the table is zero.  Either direction takes the first
part in turn, which leaves a reciprocal BRDF a reciprocal table.

``TabulatedBRDF.of`` refuses what is not finite; measurements have holes, and recovered series are
negative in places.  Here such samples are left out of their cell's mean, which is then the sum of
W rho over that of W, and cells without another one are filled and counted.  Host side.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Shaped
from scipy.stats import qmc

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.exchanged import Exchanged
from jaxrender.brdf.parameters import refuse_unlisted
from jaxrender.brdf.tables.cells import Table, masked, values_of_pairs
from jaxrender.brdf.tables.mirror_lobes import mirror_density, mirrored
from jaxrender.geometry import NUSSELT
from jaxrender.geometry.disc_cells import covered_shares, places_in_disc
from jaxrender.shapes import Array, Bool, Float, Int

FILLS = ("nearest", "zero")
# With 4 instead of 16 the albedo of a narrow lobe (.05 at 16^4) errs by twice as much.
CELL_SAMPLES = 16
# For each even sample of a pair of cells.
_ABOUT_MIRROR = 256
_PAIRS_AT_ONCE = 1 << 17
_evaluate = eqx.filter_jit(BRDF.evaluate)


class Samples(NamedTuple):
    """Means in 1/sr, and how many of them had no sample but negative or not finite ones."""

    values: Table
    masked: int


class Behaviour(NamedTuple):
    """What a table does: of its rms how much changes when the directions do; its largest albedo."""

    reciprocity_error: float
    largest_albedo: float


class _Sums(NamedTuple):
    """Weighted values of valid samples, their weights, the least, and whether some are invalid."""

    total: Float[np.ndarray, "*pair channel"]
    weight: Float[np.ndarray, "*pair channel"]
    least: Float[np.ndarray, "*pair channel"]
    holes: Bool[np.ndarray, "*pair channel"]

    def plus(self, other: "_Sums") -> "_Sums":
        """Add up."""
        return _Sums(
            self.total + other.total,
            self.weight + other.weight,
            np.minimum(self.least, other.least),
            self.holes | other.holes,
        )

    def reversed(self) -> "_Sums":
        """Exchange the directions."""
        return _Sums(*(np.swapaxes(part, 0, 1) for part in self))

    def means(self, expected: float) -> Float[np.ndarray, "*pair channel"]:
        """Divide by the weights' expected sum; where samples are missing, by their sum."""
        plain = self.total / np.where(self.weight > 0, self.weight, 1)
        least = np.where(self.holes, 0, self.least)
        better = (self.total + least * (expected - self.weight)) / expected
        return np.where(self.holes, plain, np.maximum(better, 0))


def tabulate(
    brdf: BRDF,
    size: int,
    fill: str = "nearest",
    dtype: type = np.float32,
    cell_samples: int = CELL_SAMPLES,
) -> Samples:
    """Average every channel over ``size``^4 cells of Nusselt's square, each of some samples.

    ``cell_samples`` is how many even ones a pair of cells has; 1 is the value at the centres, 0 for
    a cell whose centre is no direction.  Evaluated in JAX's default precision, some pairs at a
    time, and kept in ``dtype``.  Cells without a valid sample take the ``nearest`` valid one or
    ``zero``.  Raises ``ValueError`` for an unlisted ``fill``, a size that is neither 1 nor even,
    and an odd number of samples but one.
    """
    refuse_unlisted("fill", fill, FILLS)
    if cell_samples != 1 and (cell_samples < 1 or cell_samples % 2):
        raise ValueError(f"cell_samples={cell_samples}: give 1, or an even number such as 16")
    cells = np.argwhere(covered_shares(size) > 0)
    met = np.ones((len(cells), len(cells)), bool)
    if cell_samples == 1:
        above = np.array(NUSSELT.covers((cells + 0.5) / size))
        met, sums = np.logical_and.outer(above, above), _at_centres(brdf, cells, size)
        sums = _Sums(*(np.where(met[..., None], part, 0).astype(part.dtype) for part in sums))
        found = sums.means(1.0).astype(dtype)
    else:
        count = cell_samples // 2
        sums = _sums(brdf, cells, size, count)
        back = sums if brdf.reciprocal else _sums(Exchanged(brdf), cells, size, count)
        sums = sums.plus(back.reversed())
        found = sums.means(2.0).astype(dtype)
    missing = met[..., None] & (sums.weight == 0)
    count = int(np.count_nonzero(missing))
    if not count:
        return Samples(_laid_out(found, cells, size, 0.0), 0)
    # Were it zero beyond the horizon, holes near it would be filled with darkness.
    found[missing | ~met[..., None]] = np.nan
    table = masked(_laid_out(found, cells, size, np.nan), fill).values
    return Samples(table * _laid_out(met[..., None], cells, size, 0.0), count)


def behaviour(values: Table) -> Behaviour:
    """Measure a table on Nusselt's square, of one size along all axes."""
    reverse = values.transpose(2, 3, 0, 1, 4)
    size = np.sqrt(np.mean(np.square(values), dtype=float))
    apart = np.sqrt(np.mean(np.square(values - reverse), dtype=float))
    largest = float(albedo_of(values).max())
    return Behaviour(float(apart / size) if size > 0 else 0.0, largest)


def albedo_of(values: Table) -> Float[np.ndarray, "kappa_i lambda_i channel"]:
    """Integrate rho cos t_r over the outgoing disc, for a table on Nusselt's square.

    A cell on the rim counts by the share of it that the disc covers.
    """
    size = len(values)
    weights = (4 / size**2 * covered_shares(size)).astype(values.dtype)
    return np.einsum("ijklc,kl->ijc", values, weights, optimize=True)


def _at_centres(brdf: BRDF, cells: Int[np.ndarray, "cell 2"], size: int) -> _Sums:
    directions = np.asarray(NUSSELT.direction_from_square((cells + 0.5) / size), float)
    found = values_of_pairs(partial(_evaluate, brdf), directions, directions)
    return _weighed(found, np.ones((*found.shape[:2], 1)))


def _sums(brdf: BRDF, cells: Int[np.ndarray, "cell 2"], size: int, count: int) -> _Sums:
    """Take ``count`` even samples of each pair, and ``count`` times as many about the mirror."""
    area = covered_shares(size)[tuple(cells.T)] / size**2
    about = count * _ABOUT_MIRROR
    sums: _Sums | None = None
    for place in _sobol(count):
        both = [
            np.asarray(_directions(jnp.asarray(cells), jnp.asarray(part), size))
            for part in (place[:2], place[2:])
        ]
        found = values_of_pairs(partial(_with_density, brdf), both[0], both[1])
        weight = 1 / (count + about * area[:, None] * found[..., -1:])
        added = _weighed(found[..., :-1], weight)
        sums = added if sums is None else sums.plus(added)
    assert sums is not None
    number = np.full(size**2, -1)
    number[cells[:, 0] * size + cells[:, 1]] = np.arange(len(cells))
    numbers = _sobol(about)
    step = max(_PAIRS_AT_ONCE // about, 1)
    for start in range(0, len(cells), step):
        some = cells[np.minimum(np.arange(start, start + step), len(cells) - 1)]
        flat, found = _about_mirror(brdf, jnp.asarray(some), jnp.asarray(numbers), size)
        flat, found = np.asarray(flat), np.asarray(found)
        row = np.repeat(np.arange(start, start + step), about)
        column = number[np.maximum(flat, 0)]
        there = (flat >= 0) & (column >= 0) & (row < len(cells))
        row, column, found = row[there], column[there], found[there]
        weight = 1 / (count + about * area[column][:, None] * found[:, -1:])
        added, at = _weighed(found[:, :-1], weight), (row - start) * len(cells) + column
        for whole, part in ((sums.total, added.total), (sums.weight, added.weight)):
            rows = whole[start : start + step]
            for channel in range(rows.shape[-1]):
                counted = np.bincount(at, part[:, channel], rows[..., 0].size)
                rows[..., channel] += counted.reshape(rows.shape[:2])
        for channel in range(added.holes.shape[1]):
            held = added.holes[:, channel]
            sums.holes[row[held], column[held], channel] = True
    return sums


def _weighed(
    found: Float[np.ndarray, "*pair channel"], weight: Float[np.ndarray, "*pair one"]
) -> _Sums:
    valid = np.isfinite(found) & (found >= 0)
    values = np.where(valid, found, 0)
    return _Sums(values * weight, valid * weight, values, ~valid)


@partial(jax.jit, static_argnums=2)
def _directions(cells: Array, place: Array, size: int) -> Float[Array, "cell 3"]:
    fractions = jnp.broadcast_to(place[None], (len(cells), 2))
    return NUSSELT.direction_from_square(places_in_disc(cells, fractions, size))


@eqx.filter_jit
def _with_density(
    brdf: BRDF, incoming: Float[Array, "pair 3"], outgoing: Float[Array, "pair 3"]
) -> Float[Array, "pair number"]:
    """Evaluate rho, and in the last column the density about the mirror, per outgoing area."""
    by_angle = mirror_density(incoming, outgoing)
    by_area = 4 * by_angle / jnp.maximum(outgoing[:, 2], 1e-12)
    return jnp.concatenate([brdf.evaluate(incoming, outgoing), by_area[:, None]], axis=1)


@eqx.filter_jit
def _about_mirror(
    brdf: BRDF, cells: Int[Array, "cell 2"], numbers: Float[Array, "sample 4"], size: int
) -> tuple[Int[Array, "pair"], Float[Array, "pair number"]]:
    """Draw from each cell; the outgoing cells, -1 below the horizon, and as ``_with_density``."""
    count = len(numbers)
    numbers = jnp.tile(numbers, (len(cells), 1))
    places = places_in_disc(jnp.repeat(cells, count, axis=0), numbers[:, :2], size)
    incoming = NUSSELT.direction_from_square(places)
    outgoing = mirrored(incoming, numbers[:, 2:])
    at = (NUSSELT.square_from_direction(outgoing) * size).astype(np.int32)
    at = jnp.clip(at, 0, size - 1)
    flat = jnp.where(outgoing[:, 2] > 0, at[:, 0] * size + at[:, 1], -1)
    return flat, _with_density(brdf, incoming, outgoing)


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


def _sobol(count: int) -> Float[np.ndarray, "sample 4"]:
    """Lay out samples on the unit cube."""
    # Unscrambled, the first is a corner; the seed is part of what is computed.
    sequence = qmc.Sobol(4, scramble=True, rng=0)
    return sequence.random_base2(int(np.ceil(np.log2(count))))[:count]
