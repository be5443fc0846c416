"""Noise apart from misfit: neighbouring pixels tell the one, what is left above it is the other.

A model that is wrong leaves a smooth residual, which second differences of neighbouring pixels do
away with; noise stays: r_1 - 2 r_2 + r_3 has six times its variance.  So the noise is measured
whatever the model leaves, and the residual's mean square in excess of it is misfit.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.imaging import NoiseModel, estimate_noise
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.saturation import clipped_values
from jaxrender.inverse.weights import standard_deviations
from jaxrender.shapes import Float, Int

# Fewer rows of three pixels tell no noise.
_FEWEST = 50
# An excess of so many standard errors is no chance.  Less of the radiance than this may be an error
# of the integrals.
_SURE, LEAST = 4.0, 2e-3
# A floor below this is rounding, and not worth a word.
_NO_FLOOR = 1e-9
# Neighbours' weights in a second difference, by the root of their squares' sum.
_SECOND = np.array([1.0, -2.0, 1.0]) / np.sqrt(6)


class Misfit(NamedTuple):
    """What photographs hold beyond the model and their noise.

    ``noise`` is that of single pixels.  ``rms`` is the root mean square of what is left above it,
    relative to the radiance; ``share`` its part of chi-squared.  ``correlation`` is that of the
    residuals of neighbouring pixels, from 0 for noise alone to 1; None where the noise was given
    and no neighbours are known.  ``found`` says whether there is more than chance would leave.
    """

    noise: NoiseModel
    rms: float
    share: float
    correlation: float | None
    found: bool

    def sentence(self) -> str:
        """Say it in words."""
        level = f"{100 * self.noise.relative:.2g} %"
        if self.noise.floor > _NO_FLOOR:
            level += f" and {self.noise.floor:.2g}"
        return (
            f"the photographs hold more than the model: {100 * self.rms:.2g} % of the radiance "
            f"beside a noise of {level}"
        )


class Left(NamedTuple):
    """Samples with what is predicted of them."""

    observations: Observations
    predicted: Float[np.ndarray, "sample channel"]

    @property
    def residual(self) -> Float[np.ndarray, "sample channel"]:
        """What the prediction leaves."""
        return np.asarray(self.observations.radiance, float) - self.predicted

    def counted(self, together: int) -> "Left":
        """Keep the samples that stand for pixels, so many of them together or none.

        Of those that a mended camera does not see nothing is known.
        """
        whole = np.all(self.observations.pixels.reshape(-1, together) > 0, axis=1)
        if whole.all():
            return self
        kept = np.flatnonzero(np.repeat(whole, together))
        return Left(self.observations.take(kept), self.predicted[kept])


def rows_of_three(pool: Observations, most: int, seed: int) -> Int[np.ndarray, "row 3"]:
    """Find neighbouring pixels of a photograph's row, three and three; at most so many of them.

    None of them overlap, and none is clipped: clipped values have no noise.  There are none where
    nobody says which pixels the samples are.
    """
    if pool.pixel is None:
        return np.zeros((0, 3), int)
    row, column = np.asarray(pool.pixel, np.int64).T
    # Three in a row begin at every third column, and are neighbours in the order of the pixels.
    order = np.lexsort((column, row, np.asarray(pool.frame)))
    line = np.stack([np.asarray(pool.frame), row], axis=1)[order]
    at = column[order]
    first = np.flatnonzero(at[:-2] % 3 == 0)
    together = np.all(line[first] == line[first + 2], axis=1) & (at[first + 2] == at[first] + 2)
    first = first[together]
    if len(first) > most:
        first = np.sort(np.random.default_rng(seed).choice(first, most, replace=False))
    rows = order[first[:, None] + np.arange(3)]
    clipped = clipped_values(pool.take(rows.ravel()), pool).any(axis=1)
    return rows[~clipped.reshape(-1, 3).any(axis=1)]


def measure_misfit(
    fitted: Left,
    neighbours: Left | None,
    noise: NoiseModel | None,
    least: float = LEAST,
) -> Misfit | None:
    """Say what a fit leaves beyond noise: that given, or else that of neighbouring pixels.

    ``neighbours`` are rows of three, one after the other.  ``least`` is the error of the model's
    own arithmetic, relative to the radiance.  None where the noise is neither given nor told by
    neighbours.
    """
    fitted = fitted.counted(1)
    neighbours = None if neighbours is None else neighbours.counted(3)
    rows = 0 if neighbours is None else neighbours.observations.count // 3
    channels = fitted.predicted.shape[1]
    correlation, uncertain = None, 0.0
    if neighbours is not None and rows >= _FEWEST:
        left = neighbours.residual.reshape(rows, 3, channels)
        level = neighbours.predicted.reshape(rows, 3, channels)
        if noise is None:
            second = np.einsum("rkc,k->rc", left, _SECOND)
            noise = estimate_noise(second, level[:, 1], neighbours.observations.rounding)
            uncertain = 2 / second.size
        scaled = left / standard_deviations(noise, level)
        along = np.mean(scaled[:, :-1] * scaled[:, 1:])
        correlation = float(np.clip(along / max(np.mean(scaled**2), 1e-300), 0, 1))
    if noise is None:
        return None
    residual, deviation = fitted.residual, standard_deviations(noise, fitted.predicted)
    chi_squared = float(np.mean((residual / deviation) ** 2))
    pixels = fitted.observations.pixels[:, None]
    squares, of_noise, of_signal = (
        float(np.sum(pixels * part**2))
        for part in (residual, deviation, np.asarray(fitted.observations.radiance, float))
    )
    rms = np.sqrt(max(squares - of_noise, 0) / of_signal) if of_signal > 0 else 0.0
    chance = np.sqrt(uncertain + 2 / residual.size)
    excess = chi_squared - 1
    share = max(excess, 0.0) / chi_squared if chi_squared > 0 else 0.0
    found = excess > _SURE * chance and rms > least
    return Misfit(noise, float(rms), share, correlation, bool(found))
