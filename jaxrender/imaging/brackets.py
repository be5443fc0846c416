"""One scene at several exposures: their radiance together, with its standard deviation.

A pixel of linear value x_j at exposure t_j measures the radiance x_j / t_j.  The merged radiance is
the mean with the weights of least variance,

    L = sum_j w_j x_j / t_j,    w_j proportional to t_j^2 / variance(t_j L),

over the photographs that neither saturate nor clip it to black.  The variance is that of the
merged radiance, found in two rounds: that of the measured value would favour dark noise.  Radiance
is 1 where a photograph of exposure 1 is at full scale.  Host side, NumPy float64.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jaxrender.imaging.masks import saturated
from jaxrender.imaging.response import Curve, Linear, Response
from jaxrender.imaging.sensor import SensorNoise
from jaxrender.shapes import checked

_ROUNDS = 2
# Within half a step of 8 bits of full scale a value is saturated, and of 0 it is black.
FULL_SCALE, BLACK = 0.998, 0.002
# A pixel is well exposed in a photograph that tells its radiance to this part.
_WELL = 0.05


class Bracket(NamedTuple):
    """One photograph of several: stored values, 1 at full scale, and exposure (seconds, say)."""

    values: Float[np.ndarray, "row column channel"]
    exposure: float


class BracketRules(NamedTuple):
    """Which stored values are no measurement: from ``saturation`` up, and up to ``black``.

    ``grow``: so many pixels around a saturated one are left out, too.
    """

    saturation: float = FULL_SCALE
    black: float = BLACK
    grow: int = 0


class Merged(NamedTuple):
    """The radiance of a scene, its standard deviation, and where it was well exposed.

    Where no photograph is usable, the radiance is a bound: the shortest exposure's where all
    saturate, the longest one's where all are black.  Such pixels are not ``well_exposed``.  Their
    standard deviation is infinite where they saturate.
    """

    radiance: Float[np.ndarray, "row column channel"]
    standard_deviation: Float[np.ndarray, "row column channel"]
    well_exposed: Bool[np.ndarray, "row column"]


@checked
def merge_brackets(
    brackets: Sequence[Bracket],
    response: Response | None = None,
    noise: SensorNoise | None = None,
    rules: BracketRules | None = None,
) -> Merged:
    """Merge photographs from one place into radiance.

    ``response``: how radiance became stored values (None: linear).  Raises ``ValueError`` for no
    photographs, photographs of unlike shapes, and an exposure that is not above 0.
    """
    check_brackets(brackets)
    response, noise, rules = response or Linear(), noise or SensorNoise(), rules or BracketRules()
    exposures = np.array([float(one.exposure) for one in brackets])
    linear = [linear_values(one.values, response) for one in brackets]
    usable = [usable_values(one.values, response, rules) for one in brackets]
    radiance = _first(linear, usable, exposures)
    total = precision = np.zeros_like(radiance)
    well = np.zeros(radiance.shape, bool)
    for _ in range(_ROUNDS):
        total, precision = np.zeros_like(radiance), np.zeros_like(radiance)
        well = np.zeros(radiance.shape, bool)
        for value, good, exposure in zip(linear, usable, exposures):
            variance = noise.variance(exposure * radiance, response) / exposure**2
            weight = np.where(good, 1 / variance, 0)
            total += weight * value / exposure
            precision += weight
            well |= good & (variance <= (_WELL * radiance) ** 2)
        some = precision > 0
        radiance = np.where(some, total / np.where(some, precision, 1), radiance)
    deviation = np.sqrt(1 / np.where(precision > 0, precision, np.inf))
    deviation = np.where(precision > 0, deviation, _bound(brackets, radiance, noise, response))
    return Merged(np.maximum(radiance, 0), deviation, np.asarray(well.all(axis=-1)))


def check_brackets(brackets: Sequence[Bracket]) -> None:
    """Raise ``ValueError`` unless there are photographs of one shape with exposures above 0."""
    if not brackets:
        raise ValueError("no photographs given: give at least one, with its exposure")
    shapes = [np.shape(one.values) for one in brackets]
    if len(set(shapes)) > 1:
        raise ValueError(f"photographs of shapes {shapes}: those of one scene have one shape")
    for number, one in enumerate(brackets):
        if not (np.isfinite(one.exposure) and one.exposure > 0):
            raise ValueError(f"exposure of photograph {number} is {one.exposure}: give one above 0")


def linear_values(
    values: Float[np.ndarray, "row column channel"], response: Response
) -> Float[np.ndarray, "row column channel"]:
    """Undo the response; what a measured curve does not cover gets the value of its end."""
    values = np.asarray(values, np.float64)
    if isinstance(response, Curve):
        values = np.clip(values, response.values[0], response.values[-1])
    return np.asarray(response.linearise(values), np.float64)


def usable_values(
    values: Float[np.ndarray, "row column channel"], response: Response, rules: BracketRules
) -> Bool[np.ndarray, "row column channel"]:
    """Mark what measures radiance: no channel saturates, and this one is not black.

    A camera mixes the channels of a pixel when it makes colours, so that one spoils the others.
    """
    values = np.asarray(values, np.float64)
    low, high = rules.black, rules.saturation
    good = (values > low) & ~saturated(values, high, rules.grow)[..., None]
    if isinstance(response, Curve):
        good &= (values >= response.values[0]) & (values <= response.values[-1])
    return good


def _first(
    linear: list[np.ndarray], usable: list[np.ndarray], exposures: Float[np.ndarray, "photograph"]
) -> np.ndarray:
    """Divide all usable values by all their exposures; bounds where there are none."""
    time = sum(exposure * good for exposure, good in zip(exposures, usable))
    value = sum(np.where(good, one, 0) for one, good in zip(linear, usable))
    shortest, longest = int(np.argmin(exposures)), int(np.argmax(exposures))
    dark = linear[longest] / exposures[longest]
    bright = linear[shortest] / exposures[shortest]
    # Where the shortest exposure is above what the longest says, the longest was saturated.
    bound = np.maximum(dark, bright)
    return np.where(time > 0, value / np.where(time > 0, time, 1), bound)


def _bound(
    brackets: Sequence[Bracket], radiance: np.ndarray, noise: SensorNoise, response: Response
) -> np.ndarray:
    """Say how well a bound is known: not at all above, to the noise of the longest in the dark."""
    longest = max(brackets, key=lambda one: one.exposure)
    dark = np.asarray(longest.values) < 0.5
    variance = noise.variance(longest.exposure * radiance, response)
    return np.where(dark, np.sqrt(variance) / longest.exposure, np.inf)
