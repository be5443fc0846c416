"""Samples sorted by the direction they reflect, many to a bin (T 6.17, 6.18).

U = B / g and W = K_d Y~ / g are averaged over a latitude-longitude grid of reflected directions R,
with g = K_s V(R) h_0.  Each sample is split bilinearly between four texels.  Its weight is its
confidence (g / noise)^2, the inverse variance of its L_slow.  Host side, NumPy float64.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy import sparse

from jaxrender.harmonics import LatLongGrid, coefficient_count, degrees
from jaxrender.inverse.lighting.operator import LightOperator, LightRows, in_chunks
from jaxrender.shapes import Bool, Float

# Bins of less confidence than this part of the most confident one count as not observed.
_LEAST_CONFIDENCE = 1e-9


class ReflectedBins(NamedTuple):
    """Averages over the samples of each bin; zero, of infinite variance, where there is none.

    ``passed`` is f_l, the mean of h_l / h_0 over the samples, for each coefficient; ``scatter`` the
    weighted sum of squares of the samples about their bins, and their number.
    """

    direct: Float[np.ndarray, "channel bin"]
    diffuse: Float[np.ndarray, "channel bin coefficient"]
    variance: Float[np.ndarray, "channel bin"]
    observed: Bool[np.ndarray, "bin"]
    passed: Float[np.ndarray, "coefficient"]
    scatter: Float[np.ndarray, "channel 2"]


def bin_by_reflection(
    operator: LightOperator,
    radiance: Float[np.ndarray, "sample channel"],
    weights: Float[np.ndarray, "sample channel"],
    height: int,
) -> ReflectedBins:
    """Average U and W over each bin, chunk by chunk; memory does not grow with the samples.

    Raises ``ValueError`` where no sample has a weight and a reflection.
    """
    grid = LatLongGrid(height, 2 * height)
    size, channels = height * 2 * height, radiance.shape[1]
    count = coefficient_count(operator.band_limit)
    kd, ks = np.asarray(operator.kd, float), np.asarray(operator.ks, float)
    shares, squares = np.zeros((channels, size)), np.zeros((channels, size))
    direct, diffuse = np.zeros((channels, size)), np.zeros((channels, size, count))
    energy, filtered = np.zeros((channels, 2)), np.zeros(operator.band_limit + 1)
    for rows, values, weight in _chunks(operator, radiance, weights):
        near = grid.neighbours(np.asarray(rows.reflected))
        gather = _gather(near.index, near.share, size)
        gather_squares = _gather(near.index, near.share**2, size)
        passed = np.asarray(rows.passed)
        vectors = np.asarray(operator.diffuse(rows))
        filtered += ((passed[:, :1] * passed) * weight.mean(axis=1)[:, None] ** 2).sum(axis=0)
        for channel in range(channels):
            gain = ks[channel] * passed[:, 0]
            # (g / n)^2 B / g and (g / n)^2 K_d Y~ / g: nothing is divided by a vanishing g.
            sure = (gain * weight[:, channel]) ** 2
            over = gain * weight[:, channel] ** 2
            shares[channel] += gather @ sure
            squares[channel] += gather_squares @ sure
            direct[channel] += gather @ (over * values[:, channel])
            diffuse[channel] += kd[channel] * (gather @ (over[:, None] * vectors))
            energy[channel] += (
                np.sum((weight[:, channel] * values[:, channel])[sure > 0] ** 2),
                np.sum(sure > 0),
            )
    observed = np.all(shares > _LEAST_CONFIDENCE * shares.max(axis=1, keepdims=True), axis=0)
    if not observed.any():
        raise ValueError(
            "no sample shows the light by reflection: all have weight 0, or their R is shadowed"
        )
    share = np.where(observed[None], shares, 1)
    direct, diffuse = direct / share * observed, diffuse / share[..., None] * observed[:, None]
    # What the samples of a bin disagree by: all of their energy less that of the bins' means.
    energy[:, 0] = np.maximum(energy[:, 0] - np.sum(shares * direct**2, axis=1), 0)
    variance = np.where(observed[None], squares / share**2, np.inf)
    passing = (filtered / filtered[0])[degrees(operator.band_limit)]
    return ReflectedBins(direct, diffuse, variance, observed, passing, energy)


def _chunks(
    operator: LightOperator, radiance: np.ndarray, weights: np.ndarray
) -> Iterator[tuple[LightRows, np.ndarray, np.ndarray]]:
    """Cut samples into chunks of rows, radiance and weights."""
    chunks = in_chunks(operator.rows, operator.samples_per_chunk)
    size, count = operator.samples_per_chunk, operator.count
    for start in range(0, count, size):
        rows: LightRows = _take(chunks, start // size)
        kept = min(size, count - start)
        rows = _take(rows, slice(0, kept))
        yield rows, radiance[start : start + kept], weights[start : start + kept]


def _take(rows: LightRows, index: int | slice) -> LightRows:
    vectors = None if rows.transfer_vectors is None else rows.transfer_vectors[index]
    return LightRows(rows.normals[index], rows.reflected[index], rows.passed[index], vectors)


def _gather(index: np.ndarray, share: np.ndarray, size: int) -> sparse.csr_array:
    samples = np.repeat(np.arange(len(index)), index.shape[1])
    return sparse.csr_array((share.ravel(), (index.ravel(), samples)), (size, len(index)))
