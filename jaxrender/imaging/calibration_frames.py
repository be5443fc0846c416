"""Frames that tell what the camera adds and takes: dark frames, a black level, flat fields.

    linear radiance = (value - dark) / (1 - black) / fall-off

A dark frame is a photograph with the lens cap on; its mean is what the sensor reads without light,
and its spread the readout noise.  A flat field is a photograph of an evenly lit white surface; it
darkens towards the corners as the lens does.  Host side, NumPy float64; values are linear.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from jaxrender.shapes import checked

# Powers of the squared radius, and how the robust fit cuts.
_DEGREES, _CUT, _ROUNDS = 3, 4.0, 5
_MEDIAN_ABSOLUTE = 0.6744897501960817
# A flat field is smoothed by this part of its diagonal, and must be above this part of its maximum.
_SMOOTH, _DARKEST = 0.01, 0.05
_MIN_FRAMES = 2


class Dark(NamedTuple):
    """What a sensor reads without light, by pixel, and the standard deviation of a reading."""

    level: Float[np.ndarray, "row column channel"]
    read_noise: float

    @checked
    def subtracted(
        self, values: Float[np.ndarray, "row column channel"]
    ) -> Float[np.ndarray, "row column channel"]:
        """Values above the dark, scaled so that full scale stays 1; noise below 0 is kept."""
        if np.shape(values) != self.level.shape:
            raise ValueError(
                f"a photograph of shape {np.shape(values)} and a dark frame of shape "
                f"{self.level.shape}: take both with the same camera and setting"
            )
        return (np.asarray(values, np.float64) - self.level) / (1 - self.level)


@checked
def dark_of(frames: Sequence[Float[np.ndarray, "row column channel"]]) -> Dark:
    """Average dark frames, whose differences tell the readout noise.

    Raises ``ValueError`` for fewer than two frames, unlike shapes, and frames that are lit.
    """
    if len(frames) < _MIN_FRAMES:
        raise ValueError(f"{len(frames)} dark frames: give {_MIN_FRAMES} or more")
    shapes = {np.shape(frame) for frame in frames}
    if len(shapes) > 1:
        raise ValueError(f"dark frames of shapes {sorted(shapes)}: they must be alike")
    stack = np.stack([np.asarray(frame, np.float64) for frame in frames])
    level = stack.mean(axis=0)
    if np.median(level) > 0.5:
        raise ValueError(f"the dark frames read {np.median(level):.2g}: put the lens cap on")
    return Dark(level, float(np.sqrt(np.mean(stack.var(axis=0, ddof=1)))))


@checked
def above_black(
    values: Float[np.ndarray, "row column channel"], black_level: float
) -> Float[np.ndarray, "row column channel"]:
    """Subtract one black level, full scale kept at 1; noise below 0 is kept.

    Raises ``ValueError`` for a level outside of [0, 1).
    """
    if not 0 <= black_level < 1:
        raise ValueError(f"black_level={black_level}: give one from 0 to below 1")
    return (np.asarray(values, np.float64) - black_level) / (1 - black_level)


class Vignetting(NamedTuple):
    """How a lens darkens: 1 + a s + b s^2 + c s^3, s the squared distance from a centre.

    Distances are in half diagonals of the picture; ``row`` and ``column`` of the centre in pixels.
    ``rms`` is the relative difference from the flat field that it was fitted to.
    """

    row: float
    column: float
    coefficients: Float[np.ndarray, "3"]
    rms: float

    def fall_off(self, rows: int, columns: int) -> Float[np.ndarray, "row column"]:
        """The factor by which each pixel is darker than the centre."""
        down = (np.arange(rows) + 0.5 - self.row)[:, None]
        across = (np.arange(columns) + 0.5 - self.column)[None, :]
        s = 4 * (down**2 + across**2) / (rows**2 + columns**2)
        a, b, c = self.coefficients
        return 1 + s * (a + s * (b + s * c))

    @checked
    def corrected(
        self, picture: Float[np.ndarray, "row column channel"]
    ) -> Float[np.ndarray, "row column channel"]:
        """The picture as a lens without fall-off shows it."""
        pixels = np.asarray(picture, np.float64)
        return pixels / self.fall_off(*pixels.shape[:2])[..., None]


@checked
def fit_vignetting(flat: Float[np.ndarray, "row column channel"]) -> Vignetting:
    """Fit the fall-off about the picture's centre to a flat field, dust left out.

    Raises ``ValueError`` for a flat field that is black somewhere, or brighter towards the corners.
    """
    level = np.asarray(flat, np.float64).mean(axis=-1)
    _check_lit(level)
    rows, columns = level.shape
    down, across = (np.arange(n) + 0.5 - n / 2 for n in (rows, columns))
    s = 4 * (down[:, None] ** 2 + across[None, :] ** 2) / (rows**2 + columns**2)
    powers = s.ravel()[:, None] ** np.arange(_DEGREES + 1)
    kept = np.ones(level.size, bool)
    found, left = np.zeros(_DEGREES + 1), level.ravel()
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(powers[kept], level.ravel()[kept], rcond=None)[0]
        left = level.ravel() - powers @ found
        spread = np.median(np.abs(left[kept])) / _MEDIAN_ABSOLUTE
        kept = np.abs(left) <= _CUT * max(spread, 1e-12 * float(np.abs(found[0])))
    fitted = Vignetting(rows / 2, columns / 2, found[1:] / found[0], 0.0)
    if fitted.fall_off(rows, columns).max() > 1.05:
        raise ValueError("the flat field is brightest away from its centre: light it evenly")
    return fitted._replace(rms=float(np.sqrt(np.mean(left[kept] ** 2)) / found[0]))


@checked
def flat_field_gain(
    flat: Float[np.ndarray, "row column channel"],
) -> Float[np.ndarray, "row column channel"]:
    """Make the factor that evens a picture out from a flat field, pixel by pixel.

    Each channel is smoothed, and 1 where the lens is brightest.  Raises ``ValueError`` for a flat
    field that is black somewhere.
    """
    pixels = np.asarray(flat, np.float64)
    width = _SMOOTH * np.hypot(*pixels.shape[:2])
    smooth = np.asarray(ndimage.gaussian_filter(pixels, (width, width, 0), mode="nearest"))
    for channel in range(smooth.shape[-1]):
        _check_lit(smooth[..., channel])
    return smooth.max(axis=(0, 1)) / smooth


def _check_lit(level: Float[np.ndarray, "row column"]) -> None:
    dark = level <= _DARKEST * level.max()
    if dark.any():
        row, column = np.argwhere(dark)[0]
        raise ValueError(
            f"the flat field is black at (row {row}, column {column}): photograph an evenly lit "
            "white surface that fills the picture"
        )
