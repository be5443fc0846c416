"""How far one photograph lies beside another, in pixels.

Two pictures of one still scene differ by a shift (d_row, d_column).  The peak of the correlation of
their gradients tells the whole pixels.  Least squares on the brightness,

    moved(p) - still(p) = -grad . d,

tells the parts of a pixel (Lucas and Kanade 1981).  Host side, NumPy float64.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from jaxrender.shapes import checked

_ROUNDS = 6
# Pictures are smoothed by so many pixels before they are differentiated.
_SMOOTH = 1.0
# Standard deviations within which one picture fits another are those of whole areas: what differs
# between neighbours is not independent after smoothing.
_PIXELS_PER_SAMPLE = 12.0


class Shift(NamedTuple):
    """Where a picture's content lies beside that of another, and the standard error, in pixels.

    The error is infinite where the pictures do not tell, such as of an even wall.
    """

    rows: float
    columns: float
    standard_error: float

    @property
    def pixels(self) -> float:
        """How far it is."""
        return float(np.hypot(self.rows, self.columns))


@checked
def shift_between(
    still: Float[np.ndarray, "row column"], moved: Float[np.ndarray, "row column"]
) -> Shift:
    """Find how far the content of ``moved`` lies from that of ``still``: down and to the right.

    Both must show the scene at one brightness: parts that one of them cannot show are clipped in
    both.
    """
    still, moved = (
        ndimage.gaussian_filter(np.asarray(one, np.float64), _SMOOTH) for one in (still, moved)
    )
    if np.ptp(still) == 0 or np.ptp(moved) == 0:
        return Shift(0.0, 0.0, np.inf)
    place = _whole_pixels(still, moved)
    error = np.inf
    for _ in range(_ROUNDS):
        step, error = _step(still, ndimage.shift(moved, -place, order=3, mode="nearest"), place)
        place = place + step
        if np.hypot(*step) < 1e-3:
            break
    return Shift(float(place[0]), float(place[1]), error)


def _whole_pixels(still: np.ndarray, moved: np.ndarray) -> Float[np.ndarray, "2"]:
    """Find the peak of the cross-correlation of both pictures' gradients, seen as complex."""
    window = np.outer(np.hanning(still.shape[0] + 2)[1:-1], np.hanning(still.shape[1] + 2)[1:-1])
    spectra = []
    for picture in (still, moved):
        down, across = np.gradient(picture)
        spectra.append(np.fft.fft2(window * (across + 1j * down)))
    correlation = np.real(np.fft.ifft2(np.conj(spectra[0]) * spectra[1]))
    peak = np.unravel_index(int(np.argmax(correlation)), correlation.shape)
    return np.array([np.fft.fftfreq(n, 1 / n)[k] for n, k in zip(correlation.shape, peak)])


def _step(
    still: np.ndarray, back: np.ndarray, place: Float[np.ndarray, "2"]
) -> tuple[Float[np.ndarray, "2"], float]:
    """Solve for the shift that is left, away from the borders that nothing was moved into."""
    margin = np.minimum(np.ceil(np.abs(place)).astype(int) + 4, (np.array(still.shape) - 1) // 2)
    inner = tuple(slice(m, n - m) for m, n in zip(margin, still.shape))
    down, across = (np.asarray(one) for one in np.gradient((still + back) / 2))
    slopes = np.stack([down[inner].ravel(), across[inner].ravel()], axis=-1)
    differences = (still - back)[inner].ravel()
    normal = slopes.T @ slopes
    # An even picture, or one of a single straight edge, tells no shift, or half of it.
    if not np.linalg.eigvalsh(normal)[0] > 1e-9 * max(np.sum(still[inner] ** 2), 1e-300):
        return np.zeros(2), np.inf
    step = np.linalg.solve(normal, slopes.T @ differences)
    left = differences - slopes @ step
    variance = _PIXELS_PER_SAMPLE * float(left @ left) / max(len(left) - 2, 1)
    error = float(np.sqrt(variance * np.trace(np.linalg.inv(normal)) / 2))
    # More than a pixel at once is beyond what a slope foretells.
    return step / max(1.0, float(np.hypot(*step))), error
