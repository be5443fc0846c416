"""Whether photographs of one scene agree: their stated exposures, and where the camera stood.

Two photographs that both show a pixel well have linear values in the ratio of their exposures.
Least squares over all pairs gives every exposure by the pixels alone.  A camera rounds the times
that it states (1/60 s is 1/64 s): up to a tenth that is no lie.  Host side, NumPy float64.
"""

from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from jaxrender.imaging.brackets import (
    Bracket,
    BracketRules,
    check_brackets,
    linear_values,
    usable_values,
)
from jaxrender.imaging.registration import Shift, shift_between
from jaxrender.imaging.response import Linear, Response
from jaxrender.shapes import checked

# An exposure that is further off, as a part, and by so many standard errors, is wrong.
_ROUNDED, _SURE = 0.1, 4.0
# The darkest linear value at which a ratio is taken, and the fewest values that tell one.
_DARKEST, _FEWEST = 0.02, 30
# No response is known better than to this part, and no ratio either.
_LEAST_ERROR = 1e-3
_MEDIAN_ABSOLUTE = 0.6744897501960817


class MeasuredExposures(NamedTuple):
    """Exposures as stated and as the pixels tell them, and the relative error of the latter.

    ``measured`` has the scale of ``stated``: the median of their ratios is 1.  The error is
    infinite for a photograph that shares no well exposed pixels with the others; its ``measured``
    is what is stated.  ``exponent`` is the power of the stated ratios that the measured ones
    follow: clearly not 1 where the response is wrong, rather than an exposure.
    """

    stated: Float[np.ndarray, "photograph"]
    measured: Float[np.ndarray, "photograph"]
    relative_error: Float[np.ndarray, "photograph"]
    exponent: float

    @property
    def wrong(self) -> list[int]:
        """List the photographs whose stated exposure the pixels contradict."""
        off = np.abs(np.log(self.measured / self.stated))
        return [
            int(k) for k in np.flatnonzero(off > np.maximum(_ROUNDED, _SURE * self.relative_error))
        ]

    def said(self, names: Sequence[str]) -> str | None:
        """Say what is wrong, in a sentence; None where nothing is."""
        if not self.wrong:
            return None
        told = ", ".join(
            f"{names[k]}: {self.stated[k]:.4g} stated, {self.measured[k]:.4g} measured"
            for k in self.wrong
        )
        if abs(self.exponent - 1) > _ROUNDED and self._follows_a_power():
            return (
                f"the pixels follow the stated exposures to the power {self.exponent:.3g} "
                f"({told}): the response is wrong rather than the exposures"
            )
        return f"the pixels contradict the stated exposures ({told})"

    def _follows_a_power(self) -> bool:
        """Whether one power of the stated exposures explains all measured ones."""
        left = _logarithms(self.measured) - self.exponent * _logarithms(self.stated)
        return len(left) > 2 and bool(np.abs(left).max() < _ROUNDED)


@checked
def measure_exposures(
    brackets: Sequence[Bracket], response: Response | None = None, rules: BracketRules | None = None
) -> MeasuredExposures:
    """Measure the ratios of exposures by the pixels that two photographs both expose well.

    Raises ``ValueError`` as ``merge_brackets`` does.
    """
    check_brackets(brackets)
    response, rules = response or Linear(), rules or BracketRules()
    linear = [linear_values(one.values, response) for one in brackets]
    good = [
        usable_values(one.values, response, rules) & (value > _DARKEST)
        for one, value in zip(brackets, linear)
    ]
    stated = np.array([float(one.exposure) for one in brackets])
    rows, ratios = [], []
    for one, other in combinations(range(len(brackets)), 2):
        both = good[one] & good[other]
        if np.count_nonzero(both) < _FEWEST:
            continue
        each = np.log(linear[other][both] / linear[one][both])
        ratio = float(np.median(each))
        spread = float(np.median(np.abs(each - ratio))) / _MEDIAN_ABSOLUTE
        error = np.hypot(1.25 * spread / np.sqrt(len(each)), _LEAST_ERROR)
        row = np.zeros(len(brackets))
        row[[one, other]] = -1, 1
        rows.append(row / error)
        ratios.append(ratio / error)
    logarithms, errors = _solved(np.array(rows).reshape(-1, len(stated)), np.array(ratios), stated)
    slope = np.polyfit(np.log(stated), logarithms, 1)[0] if np.ptp(stated) > 0 else 1.0
    return MeasuredExposures(stated, np.exp(logarithms), errors, float(slope))


@checked
def measure_shifts(
    brackets: Sequence[Bracket], response: Response | None = None, rules: BracketRules | None = None
) -> tuple[Shift, ...]:
    """Find how far the content of each photograph lies from that of the shortest exposure.

    Neighbours in exposure are compared, each clipped to what the other can show.
    Raises ``ValueError`` as ``merge_brackets`` does.
    """
    check_brackets(brackets)
    response, rules = response or Linear(), rules or BracketRules()
    order = sorted(range(len(brackets)), key=lambda k: brackets[k].exposure)
    found = {order[0]: Shift(0.0, 0.0, 0.0)}
    for one, other in pairwise(order):
        step = shift_between(*_alike(brackets[one], brackets[other], response, rules))
        before = found[one]
        found[other] = Shift(
            before.rows + step.rows,
            before.columns + step.columns,
            float(np.hypot(before.standard_error, step.standard_error)),
        )
    return tuple(found[k] for k in range(len(brackets)))


def check_shifts(shifts: Sequence[Shift], names: Sequence[str], limit: float = 0.5) -> None:
    """Raise ``ValueError`` where a photograph lies over ``limit`` pixels from the others."""
    for name, shift in zip(names, shifts):
        # A shift that is not known surely is not held against anyone.
        if shift.pixels - 2 * shift.standard_error > limit:
            raise ValueError(
                f"{name}: the picture lies {shift.rows:.2f} pixels down and {shift.columns:.2f} to "
                f"the right of the shortest exposure, more than {limit:g}: use a tripod, align the "
                "photographs first (align_image_stack of Hugin does), leave this one out, or allow "
                "a larger shift"
            )


@checked
def aligned(brackets: Sequence[Bracket], shifts: Sequence[Shift]) -> list[Bracket]:
    """Move photographs by whole pixels to where the shortest exposure lies.

    What a photograph does not show becomes black, which no measurement is taken from.
    """
    moved = []
    for one, shift in zip(brackets, shifts, strict=True):
        back = (-round(shift.rows), -round(shift.columns), 0)
        moved.append(one._replace(values=np.asarray(ndimage.shift(one.values, back, order=0))))
    return moved


def _alike(
    one: Bracket, other: Bracket, response: Response, rules: BracketRules
) -> list[Float[np.ndarray, "row column"]]:
    """Show both photographs over the range of radiance that both can tell, in logarithms."""
    pictures = []
    edge = np.full((1, 1, np.shape(one.values)[-1]), rules.saturation)
    high = linear_values(edge, response) / other.exposure
    low = np.maximum(linear_values(0 * edge + rules.black, response), _DARKEST) / one.exposure
    low = np.minimum(low, high / 2)
    for photograph in (one, other):
        radiance = linear_values(photograph.values, response) / photograph.exposure
        pictures.append(np.log(np.clip(radiance, low, high)).mean(axis=-1))
    return pictures


def _solved(
    rows: Float[np.ndarray, "pair photograph"],
    ratios: Float[np.ndarray, "pair"],
    stated: Float[np.ndarray, "photograph"],
) -> tuple[np.ndarray, np.ndarray]:
    """Solve for the logarithms of the exposures; where nothing tells, they stay as stated."""
    normal = rows.T @ rows
    told = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
    logarithms = told @ (rows.T @ ratios)
    errors = np.full(len(stated), np.inf)
    groups = (np.abs(normal) > 0) | np.eye(len(stated), dtype=bool)
    for _ in stated:  # who is linked with whom, over any number of others
        groups = groups.astype(int) @ groups.astype(int) > 0
    for k in range(len(stated)):
        members = groups[k]
        if members.sum() > 1:
            errors[k] = np.sqrt(told[k, k])
        if k == np.flatnonzero(members)[0]:
            apart = np.log(stated[members]) - logarithms[members]
            logarithms[members] += np.median(apart)
    return logarithms, errors


def _logarithms(exposures: np.ndarray) -> np.ndarray:
    return np.log(exposures) - np.mean(np.log(exposures))
