"""A whole BRDF from few of its values, by what other measured materials have in common.

The relative logarithms of ``brdf.tables.learned`` are mean + components @ c with c ~ N(0, I)
beforehand, noise, and what the components leave out.  So c has a Gaussian distribution afterwards,
and every cell of the completed table a standard error.  Measurements that say more than noise and
what is left of the learnt materials do so by leaving one another out: their excess widens it.
"""

from typing import NamedTuple

import numpy as np
import scipy.optimize

from jaxrender.brdf.tables.isotropic import IsotropicTable, nearest_known, node_angles, pair_at
from jaxrender.brdf.tables.learned import FLOOR, LearnedMaterials, LearnedRows
from jaxrender.brdf.tables.measurements import Measurements
from jaxrender.shapes import Bool, Float, checked

# What a gonioreflectometer's value is off by, where nobody says.
USUAL_NOISE = 0.03
# Fewer values do not tell how large noise and excess are.
_FEWEST_TO_JUDGE = 20
# No pair is asked for at which a direction is lower than this cosine: it is hard to measure.
_LOWEST_COSINE = 0.1
_CANDIDATES = 30_000
_BLOCK = 100_000


class Completion(NamedTuple):
    """A completed BRDF, and how well it is known.

    ``relative_error`` is the standard error of each entry of the table over the entry.  ``noise``
    is that of the measurements, relative.  ``excess`` is the variance by which this material
    departs from the learnt ones, over that by which they do from one another.  ``left_out`` is the
    rms error of the logarithm at each measurement, as all others foretell it.  Each is by channel.
    """

    brdf: IsotropicTable
    relative_error: Float[np.ndarray, "theta_h theta_d phi_d channel"]
    coefficients: Float[np.ndarray, "channel component"]
    noise: Float[np.ndarray, "channel"]
    excess: Float[np.ndarray, "channel"]
    left_out: Float[np.ndarray, "channel"]


class NextPairs(NamedTuple):
    """Where to measure next, one after the other: local directions, and what each is worth.

    ``remaining`` is the mean variance of the table's logarithms after it, over that before any.
    """

    incoming: Float[np.ndarray, "pair 3"]
    outgoing: Float[np.ndarray, "pair 3"]
    remaining: Float[np.ndarray, "pair"]


class _Channel(NamedTuple):
    coefficients: Float[np.ndarray, "component"]
    covariance: Float[np.ndarray, "component component"]
    noise: float
    excess: float
    left_out: float


@checked
def complete(
    materials: LearnedMaterials, measured: Measurements, noise: float | None = None
) -> Completion:
    """Complete a BRDF from values at scattered pairs, channel by channel.

    ``noise`` is the relative standard deviation of the values; None: it is found, or .03 where
    fewer than 20 values would tell.  Raises ``ValueError`` for a noise that is not positive and for
    a channel without values above the horizon.
    """
    if noise is not None and not 0 < noise < np.inf:
        raise ValueError(f"noise {noise:g}: give a relative deviation above 0, as 0.03")
    rows = materials.at_pairs(measured.incoming, measured.outgoing)
    valid = _usable(measured)
    found = []
    for channel, own in enumerate(valid.T):
        if not own.any():
            raise ValueError(f"channel {channel} has no value above the horizon: give at least one")
        some = LearnedRows(*(part[own] for part in rows))
        logs = some.logs(measured.values[own, channel, None])[:, 0]
        found.append(_completed(some, logs, noise))
    values, errors = (np.zeros((materials.known.size, len(found))) for _ in range(2))
    for first in range(0, len(values), _BLOCK):
        block = slice(first, first + _BLOCK)
        at = materials.at_nodes(block)
        for channel, one in enumerate(found):
            logs = at.mean + at.components @ one.coefficients
            spread = _variances(at.components, one.covariance)
            values[block, channel] = at.values(logs)
            deviation = np.sqrt(one.excess * (spread + at.left_out)) * at.slopes(logs)
            # Below the least value that counts, a relative error says nothing.
            least = FLOOR / at.cosine
            errors[block, channel] = deviation / np.maximum(values[block, channel], least)
    nearest = nearest_known(materials.known)
    whole = IsotropicTable(values[nearest])
    parts = [np.array([getattr(one, name) for one in found]) for name in _Channel._fields]
    return Completion(whole, errors[nearest], parts[0], *parts[2:])


@checked
def next_pairs(
    materials: LearnedMaterials,
    count: int,
    measured: Measurements | None = None,
    noise: float = USUAL_NOISE,
) -> NextPairs:
    """Choose pairs to measure next, each the one that lowers the mean variance most.

    ``measured`` is what there is already; None: nothing.  What a material measures does not matter
    for it, only where.  Raises ``ValueError`` for a count below 1 and a noise that is not positive.
    """
    if count < 1:
        raise ValueError(f"{count} pairs: give at least 1")
    if not 0 < noise < np.inf:
        raise ValueError(f"noise {noise:g}: give a relative deviation above 0, as 0.03")
    angles = node_angles(materials.shape)
    incoming, outgoing = (pair.reshape(-1, 3) for pair in pair_at(angles))
    fit = materials.known.ravel() & (incoming[:, 2] > _LOWEST_COSINE)
    places = np.nonzero(fit & (outgoing[:, 2] > _LOWEST_COSINE))[0]
    places = places[:: max(1, len(places) // _CANDIDATES)]
    incoming, outgoing = incoming[places], outgoing[places]
    rows = materials.at_pairs(incoming, outgoing)
    variance = noise**2 + rows.left_out
    covariance = np.eye(materials.count)
    total = rows.components.T @ rows.components / len(places)
    beforehand = np.trace(total)
    if measured is not None:
        usable = _usable(measured).any(axis=1)
        seen = materials.at_pairs(measured.incoming[usable], measured.outgoing[usable])
        covariance = _posterior(seen, noise, 1.0)
    chosen, remaining = [], []
    for _ in range(count):
        moved = rows.components @ covariance
        scale = variance + np.sum(moved * rows.components, axis=1)
        gain = _variances(moved, total) / scale
        best = int(np.argmax(gain))
        covariance = covariance - np.outer(moved[best], moved[best]) / scale[best]
        chosen.append(best)
        remaining.append(np.sum(covariance * total) / beforehand)
    return NextPairs(incoming[chosen], outgoing[chosen], np.array(remaining))


def _usable(measured: Measurements) -> Bool[np.ndarray, "pair channel"]:
    """Say which values were measured above the horizon."""
    above = (measured.incoming[:, 2] > 0) & (measured.outgoing[:, 2] > 0)
    return measured.valid & above[:, None]


def _variances(
    rows: Float[np.ndarray, "row component"], covariance: Float[np.ndarray, "component component"]
) -> Float[np.ndarray, "row"]:
    return np.sum((rows @ covariance) * rows, axis=1)


def _posterior(
    rows: LearnedRows, noise: float, excess: float
) -> Float[np.ndarray, "component component"]:
    """Evaluate the covariance of the coefficients afterwards, over the excess."""
    weight = 1 / (noise**2 / excess + rows.left_out)
    told = rows.components.T @ (weight[:, None] * rows.components)
    return np.linalg.inv(told + np.eye(len(told)))


def _completed(
    rows: LearnedRows, logs: Float[np.ndarray, "value"], noise: float | None
) -> _Channel:
    """Fit the coefficients, and find noise and excess by leaving values out one by one."""
    deviation, excess = noise or USUAL_NOISE, 1.0
    # Noise and excess move the fit but little: a few turns settle them.
    for turn in range(4):
        covariance = _posterior(rows, deviation, excess)
        weight = 1 / (deviation**2 / excess + rows.left_out)
        off = logs - rows.mean
        coefficients = covariance @ (rows.components.T @ (weight * off))
        spread = _variances(rows.components, covariance)
        # A value's own part in its prediction, and its error without it.
        free = np.maximum(1 - weight * spread, 1e-6)
        missed = (off - rows.components @ coefficients) / free
        # The prediction's variance without the value, over the excess.
        foretold = spread / free + rows.left_out
        if turn == 3 or len(logs) < _FEWEST_TO_JUDGE:
            break
        excess, deviation = _judged(missed, foretold, noise)
    return _Channel(coefficients, covariance, deviation, excess, float(np.sqrt(np.mean(missed**2))))


def _judged(
    missed: Float[np.ndarray, "value"], foretold: Float[np.ndarray, "value"], noise: float | None
) -> tuple[float, float]:
    """Find excess and noise: the squares of errors are excess * foretold + noise^2."""
    squares, weight = missed**2, 1 / (foretold + (noise or USUAL_NOISE) ** 2)
    if noise is None:
        columns = np.stack([foretold, np.ones_like(foretold)], axis=1) * weight[:, None]
        (excess, square), _ = scipy.optimize.nnls(columns, squares * weight)
        return max(float(excess), 1.0), max(float(np.sqrt(square)), 1e-3)
    above = np.sum(weight**2 * foretold * (squares - noise**2))
    return max(float(above / np.sum((weight * foretold) ** 2)), 1.0), noise
