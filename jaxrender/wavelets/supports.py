"""Basis functions of one axis between samples, and which of them reach a point.

A function of level l is what ``transform`` synthesises from a single coefficient on ``size``
samples, times sqrt(size) for unit norm on [0, 1].  Between samples Haar's is constant in each cell,
the others are linear from centre to centre (constant beyond the outermost two).  For the linear
spline that is the series itself (L fig. B.2); for Daubechies' rough functions it passes through the
series' own samples.  Axes are periodic in the transform, so that a function near one end may begin
at the other; at coarse levels a place occurs once, however wide the filters are.

All of it is small and made once on the host: sum over levels of 2 x 2^l x size numbers.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from jaxrender.shapes import Float, Int
from jaxrender.wavelets.dense import synthesis_matrix
from jaxrender.wavelets.filters import Wavelet

# Functions below this part of their largest value are rounding.
_NOTHING = 1e-14


class Window(NamedTuple):
    """The places of a level whose functions reach a sample or the next one, or whose children's do.

    They are ``first[sample] + 0 .. width - 1`` modulo 2^l.
    """

    first: Int[np.ndarray, "sample"]
    width: int
    scaling: Float[np.ndarray, "place sample"]
    wavelet: Float[np.ndarray, "place sample"]


@lru_cache(maxsize=32)
def windows(wavelet: Wavelet, size: int) -> tuple[Window, ...]:
    """Return a window for each level of ``size`` samples, the coarsest first."""
    levels = size.bit_length() - 1
    found: list[Window] = []
    below = np.zeros((0, size), bool)
    for level in reversed(range(levels)):
        scaling, details = (functions(wavelet, size, level, kind) for kind in (0, 1))
        reach = _reaches(scaling) | _reaches(details)
        if not is_stepwise(wavelet):
            # Up to the next sample values are interpolated.
            reach |= np.append(reach[:, 1:], reach[:, -1:], axis=1)
        if len(below):
            reach |= below[0::2] | below[1::2]
        first, width = _arcs(reach)
        below = ((np.arange(len(reach))[:, None] - first) % len(reach)) < width
        found.append(Window(first, width, scaling, details))
    return tuple(reversed(found))


def functions(
    wavelet: Wavelet, size: int, level: int, kind: int
) -> Float[np.ndarray, "place sample"]:
    """Return the scaling functions (``kind`` 0) or wavelets (1) of a level at all samples."""
    levels = size.bit_length() - 1
    matrix = synthesis_matrix(wavelet, size, levels - level)
    places = 1 << level
    if kind:
        matrix = synthesis_matrix(wavelet, size, levels - level)
        return matrix[:, places : 2 * places].T * np.sqrt(size)
    return matrix[:, :places].T * np.sqrt(size)


def is_stepwise(wavelet: Wavelet) -> bool:
    """Say whether functions are constant in each cell: Haar's are."""
    return len(wavelet.synthesis_low) == 2


def overlaps(wavelet: Wavelet, size: int, axes: int) -> Float[np.ndarray, "level selector"]:
    """Bound what coefficients of at most 1 of one level and selector add up to at a point."""
    rows = []
    for window in windows(wavelet, size):
        along = [np.abs(f).sum(axis=0).max() for f in (window.scaling, window.wavelet)]
        bits = (np.arange(1 << axes)[:, None] >> np.arange(axes)) & 1
        rows.append(np.prod(np.where(bits == 1, along[1], along[0]), axis=1))
    return np.array(rows).reshape(len(rows), 1 << axes)


def _reaches(functions: Float[np.ndarray, "place sample"]) -> np.ndarray:
    largest = np.abs(functions).max()
    return np.abs(functions) > _NOTHING * largest


def _arcs(reach: np.ndarray) -> tuple[Int[np.ndarray, "sample"], int]:
    """Find the shortest run of places that holds all that reach a sample, modulo their number."""
    places, samples = reach.shape
    first, width = np.zeros(samples, np.int64), 1
    for sample in range(samples):
        held = np.flatnonzero(reach[:, sample])
        gaps = np.diff(np.append(held, held[0] + places))
        after = int(np.argmax(gaps))
        first[sample] = held[(after + 1) % len(held)]
        width = max(width, places - int(gaps[after]) + 1)
    return first, width
