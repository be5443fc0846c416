"""A BRDF's tree over two Nusselt squares: cell means, transformed and thresholded (L 4.4).

The coefficients of all channels share their places.  What thresholding misses is the rms of the
missing part over the rms of the table, of clamped values.  The dropped coefficients predict it
(L 4.7, ERRATA 61); for an orthonormal wavelet exactly, but for clamping and dimming (``energy``).
"""

from typing import NamedTuple

import numpy as np

from jaxrender.brdf.compression.energy import (
    LAST_DEGREE,
    MENDINGS,
    Energy,
    dimmed_further,
    excess,
)
from jaxrender.brdf.tables.cell_means import Behaviour, albedo_of, behaviour
from jaxrender.brdf.tables.cells import Table
from jaxrender.geometry import NUSSELT
from jaxrender.geometry.disc_cells import covered_shares
from jaxrender.shapes import Float
from jaxrender.wavelets import (
    CoefficientTree,
    Thresholded,
    Wavelet,
    analyse_nonstandard,
    keep_fraction,
    keep_within,
    scaled,
)

# Of a wavelet that is not orthonormal an error is only estimated: try again, so often.
_ATTEMPTS = 6


class Goal(NamedTuple):
    """How much to keep: a fraction of the non-zero coefficients, or enough for an error."""

    fraction: float = 0.01
    error: float | None = None


class Compression(NamedTuple):
    """A tree, the number of coefficients of its table, and its relative rms error."""

    tree: CoefficientTree
    non_zero: int
    predicted: float
    measured: float
    by_channel: Float[np.ndarray, "channel"]
    table: Behaviour
    samples: Behaviour
    energy: Energy


def compression_of(
    table: Table, wavelet: Wavelet, goal: Goal, limit: float | None = None
) -> Compression:
    """Transform a table that is zero outside the disc, keep the largest coefficients, and judge.

    The table is dimmed where ``energy`` asks for it; with a ``limit`` no albedo is above it.

    Raises ``ValueError`` for a goal out of range, a size that is no power of two, and values that
    are not finite.
    """
    norm = float(np.sqrt(np.sum(np.square(table), dtype=float)))
    whole = norm / np.sqrt(table[..., 0].size)
    wanted = goal.error
    for _ in range(_ATTEMPTS):
        rms = None if wanted is None else wanted * whole
        tree, clamped, non_zero, predicted, energy = _thresholded(
            table, wavelet, goal.fraction, rms, limit
        )
        errors = _missed(clamped, table)
        measured = float(np.sqrt(np.sum(errors**2)) / norm)
        if goal.error is None or wanted is None or measured <= goal.error:
            break
        wanted *= 0.98 * goal.error / measured
    sizes = np.sqrt(np.sum(np.square(table), axis=(0, 1, 2, 3), dtype=float))
    return Compression(
        tree,
        non_zero,
        predicted / whole,
        measured,
        errors / np.where(sizes > 0, sizes, 1),
        behaviour(table),
        behaviour(clamped),
        energy,
    )


class _Thresholded(NamedTuple):
    tree: CoefficientTree
    clamped: Table
    non_zero: int
    predicted: float
    energy: Energy


def _thresholded(
    table: Table, wavelet: Wavelet, fraction: float, rms: float | None, limit: float | None
) -> _Thresholded:
    """Keep the largest coefficients, of a table that is dimmed until the tree's energy is right."""
    size, own = len(table), albedo_of(table)
    shares, centres = covered_shares(size), NUSSELT.centres((size, size))
    near = np.hypot(*np.moveaxis(2 * centres - 1, -1, 0)) <= np.sin(np.radians(LAST_DEGREE))
    factors, first = np.ones((size, size)), 0.0
    for step in range(MENDINGS + 1):
        dimmed = table
        if step:
            g = factors.astype(table.dtype)
            dimmed = g[:, :, None, None, None] * table * g[None, None, :, :, None]
        coefficients = _without_rounding(np.array(analyse_nonstandard(wavelet, dimmed)))
        non_zero = int(np.count_nonzero(np.any(coefficients != 0, axis=-1)))
        kept = _kept(coefficients, fraction, rms)
        tree = CoefficientTree.of_coefficients(wavelet, np.asarray(kept.coefficients))
        clamped = _clamped(tree, table)
        above = excess(albedo_of(clamped), own, near, limit)
        first = first if step else float(above.max())
        if above.max() <= 1:
            break
        factors = dimmed_further(factors, above)
    left = max(float(above.max()), 1.0)
    if left > 1:
        tree, clamped = scaled(tree, 1 / left), clamped * clamped.dtype.type(1 / left)
    energy = Energy.of(albedo_of(clamped), own, shares, near, first)
    return _Thresholded(tree, clamped, non_zero, kept.predicted_rms, energy)


def _without_rounding(coefficients: Table) -> Table:
    """Make what is only rounding zero, so that a constant table has one coefficient; in place."""
    largest = max(float(coefficients.max()), -float(coefficients.min()))
    least = np.finfo(coefficients.dtype).eps * largest
    for part in coefficients:
        part[np.abs(part) <= least] = 0
    return coefficients


def _kept(coefficients: Table, fraction: float, rms: float | None) -> Thresholded:
    if rms is None:
        return keep_fraction(coefficients, fraction, joint=True)
    return keep_within(coefficients, rms, joint=True)


def _clamped(tree: CoefficientTree, table: Table) -> Table:
    found = np.maximum(np.asarray(tree.samples()), 0)
    # What a tree leaks where no direction is does not count.
    found[~np.any(table, axis=(2, 3, 4))] = 0
    found[:, :, ~np.any(table, axis=(0, 1, 4))] = 0
    return found


def _missed(found: Table, table: Table) -> Float[np.ndarray, "channel"]:
    """Find the root of each channel's squared errors."""
    squares = sum(
        np.sum(np.square(a - b), axis=(0, 1, 2), dtype=float)
        for a, b in zip(found, table, strict=True)
    )
    return np.sqrt(squares)
