"""Filters of wavelets with two channels: Haar, the linear spline, Daubechies.

A step halves a periodic signal x into averages a and details d, and another one undoes it:

    a_i = sum_k low_k x_{2i + k + first},    d_i = sum_k high_k x_{2i + k + first}    (analysis)
    x_j = sum over 2i + k + first = j of a_i low_k + d_i high_k                      (synthesis)

which are the refinement equations of L app. B.1, phi(x) = sqrt(2) sum_k low_k phi(2x - k), with the
low filters summing to sqrt(2).  Either high filter is the other side's low one backwards, with
alternating signs.  Where both sides have the same filters the step is an orthogonal matrix, and
sums of squares are kept (Parseval).  The linear spline is not: L section 4.5.2 prefers it, because
what it is put together from is narrow (three samples) and smooth.
"""

import difflib
from math import comb, sqrt
from typing import NamedTuple

import numpy as np

Taps = tuple[float, ...]


class Wavelet(NamedTuple):
    """The four filters of a wavelet, all of one even length; hashable, so static under jit."""

    name: str
    analysis_low: Taps
    analysis_high: Taps
    synthesis_low: Taps
    synthesis_high: Taps
    orthonormal: bool
    vanishing_moments: int
    """Details of polynomials of lower degree than this vanish (away from the seam)."""

    @property
    def first(self) -> int:
        """The offset of the first tap from twice the coefficient's place: filters are centred."""
        return 1 - len(self.analysis_low) // 2


def haar() -> Wavelet:
    """Return Haar's wavelet: sums and differences of neighbours (L fig. B.1)."""
    return _wavelet("haar", 1, (sqrt(0.5), sqrt(0.5)))


def linear_spline() -> Wavelet:
    """Return the biorthogonal spline CDF(2,2) (L section 4.5.2, fig. B.2).

    Synthesis is by hat functions; the analysis filters are those of the dual, which is rough.
    """
    hat = sqrt(2.0) / 4.0 * np.array([0.0, 1.0, 2.0, 1.0, 0.0, 0.0])
    dual = sqrt(2.0) / 8.0 * np.array([-1.0, 2.0, 6.0, 2.0, -1.0, 0.0])
    return _wavelet("cdf-2-2", 2, tuple(hat.tolist()), tuple(dual.tolist()))


def daubechies(vanishing_moments: int) -> Wavelet:
    """Return the shortest orthonormal wavelet with so many vanishing moments, N.

    Spectral factorisation: |low(w)|^2 = 2 cos^2N(w/2) P(sin^2(w/2)), where
    P(y) = sum_{k<N} binomial(N - 1 + k, k) y^k; of each pair of roots z and 1/z, where
    z + 1/z = 2 - 4y, the one inside the unit circle.

    Raises ValueError unless N is from 1 to 10: beyond, the roots lose too many digits.
    """
    count = vanishing_moments
    if not 1 <= count <= 10:
        raise ValueError(f"{count} vanishing moments; ask for 1 to 10")
    half = [comb(count - 1 + k, k) for k in range(count)]
    middle = 1.0 - 2.0 * np.roots(half[::-1]).astype(complex)
    # Both roots of z^2 - 2 middle z + 1: their product is 1, and the larger is found exactly.
    root = np.sqrt(middle**2 - 1.0)
    larger = np.where(np.abs(middle + root) > 1.0, middle + root, middle - root)
    low = np.real(np.poly(1.0 / larger)) if count > 1 else np.ones(1)
    for _ in range(count):
        low = np.convolve(low, [1.0, 1.0])
    low *= sqrt(2.0) / low.sum()
    name = "haar" if count == 1 else f"daubechies-{count}"
    return _wavelet(name, count, tuple(low.tolist()))


def _wavelet(name: str, moments: int, synthesis: Taps, analysis: Taps | None = None) -> Wavelet:
    low = synthesis if analysis is None else analysis
    return Wavelet(
        name, low, _mirror(synthesis), synthesis, _mirror(low), analysis is None, moments
    )


def _mirror(low: Taps) -> Taps:
    """Return the filter backwards, with alternating signs."""
    return tuple(float(tap) * (-1.0) ** k for k, tap in enumerate(reversed(low)))


WAVELETS: dict[str, Wavelet] = {
    wavelet.name: wavelet for wavelet in (haar(), linear_spline(), daubechies(2), daubechies(4))
}


def wavelet_named(name: str) -> Wavelet:
    """Return the wavelet of that name; raises ValueError, with the nearest, if there is none."""
    if name not in WAVELETS:
        near = difflib.get_close_matches(name, WAVELETS, n=1)
        meant = f", did you mean {near[0]!r}?" if near else ";"
        raise ValueError(f"no wavelet is named {name!r}{meant} choose one of {', '.join(WAVELETS)}")
    return WAVELETS[name]
