"""White balance and colour from a card or a chart in the photograph.

A grey card reflects all channels alike, so that its colour is that of the light and the camera.
A colour chart has 24 known patches.  Their linear colours, as the camera saw them, become those
that are published by a 3 x 3 matrix, or by a factor for each channel:

    published_p = matrix @ seen_p,    least squares over the patches p.

Pictures are linear radiance.  Host side, NumPy float64.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jaxrender.imaging.colour import rgb_from_xyz
from jaxrender.shapes import checked

PATCHES = (
    "dark skin",
    "light skin",
    "blue sky",
    "foliage",
    "blue flower",
    "bluish green",
    "orange",
    "purplish blue",
    "moderate red",
    "purple",
    "yellow green",
    "orange yellow",
    "blue",
    "green",
    "red",
    "yellow",
    "magenta",
    "cyan",
    "white",
    "neutral 8",
    "neutral 6.5",
    "neutral 5",
    "neutral 3.5",
    "black",
)
# CIE L*a*b* of the patches under D50, 2 degree observer: X-Rite's data of the ColorChecker Classic
# made from November 2014 on.
_LAB = (
    (37.54, 14.37, 14.92),
    (64.66, 19.27, 17.50),
    (49.32, -3.82, -22.54),
    (43.46, -12.74, 22.72),
    (54.94, 9.61, -24.79),
    (70.48, -32.26, -0.37),
    (62.73, 35.83, 56.50),
    (39.43, 10.75, -45.17),
    (50.57, 48.64, 16.67),
    (30.10, 22.54, -20.87),
    (71.77, -24.13, 58.19),
    (71.51, 18.24, 67.37),
    (28.37, 15.42, -49.80),
    (54.38, -39.72, 32.27),
    (42.43, 51.05, 28.62),
    (81.80, 2.67, 80.41),
    (50.63, 51.28, -14.12),
    (49.57, -29.71, -28.32),
    (95.19, -1.03, 2.93),
    (81.29, -0.57, 0.44),
    (66.89, -0.75, -0.06),
    (50.76, -0.13, 0.14),
    (35.63, -0.46, -0.48),
    (20.64, 0.07, -0.46),
)
_ROWS, _COLUMNS = 4, 6
# XYZ of D50 and D65, and the cone responses in which Bradford's adaptation scales one to the other.
_D50, _D65 = np.array([0.96422, 1.0, 0.82521]), np.array([0.95047, 1.0, 1.08883])
_BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
# The middle part of a patch, along each side, that is looked at.
_MIDDLE = 0.4
_MEDIAN_ABSOLUTE = 0.6744897501960817


class Rectangle(NamedTuple):
    """Part of a picture, in pixels from its top left corner: rows and columns up to the ends."""

    top: int
    left: int
    bottom: int
    right: int

    def mask(self, rows: int, columns: int) -> Bool[np.ndarray, "row column"]:
        """Mark it in a picture of so many rows and columns; ``ValueError`` where it leaves it."""
        if not (0 <= self.top < self.bottom <= rows and 0 <= self.left < self.right <= columns):
            raise ValueError(
                f"the rectangle of rows {self.top} to {self.bottom} and columns {self.left} to "
                f"{self.right} is no part of a picture of {rows} rows and {columns} columns"
            )
        mask = np.zeros((rows, columns), bool)
        mask[self.top : self.bottom, self.left : self.right] = True
        return mask


class WhiteBalance(NamedTuple):
    """Factors that make a grey card grey, the mean of its channels kept, and their errors.

    ``unevenness`` is the relative spread of the card's brightness: of shadows, or of no card.
    """

    gains: Float[np.ndarray, "channel"]
    standard_error: Float[np.ndarray, "channel"]
    unevenness: float

    @checked
    def applied(
        self, picture: Float[np.ndarray, "row column channel"]
    ) -> Float[np.ndarray, "row column channel"]:
        """The picture, balanced."""
        return np.asarray(picture, np.float64) * self.gains


@checked
def white_balance(
    picture: Float[np.ndarray, "row column channel"], card: Bool[np.ndarray, "row column"]
) -> WhiteBalance:
    """Find the balance from a grey card, given by a mask (``Rectangle.mask`` makes one).

    The median of the ratio of each channel to the mean counts, so that a hair on the card does no
    harm.  Raises ``ValueError`` for a mask of no pixels, and a card that is black in a channel.
    """
    pixels = np.asarray(picture, np.float64)[card]
    if not len(pixels):
        raise ValueError("the grey card has no pixels: check the mask or the rectangle")
    level = pixels.mean(axis=-1)
    if not (np.median(pixels, axis=0) > 0).all():
        raise ValueError("the grey card is black in one of the channels: give one that is lit")
    ratios = pixels[level > 0] / level[level > 0, None]
    middle = np.median(ratios, axis=0)
    spread = np.median(np.abs(ratios - middle), axis=0) / _MEDIAN_ABSOLUTE
    gains = 1 / middle
    error = 1.25 * spread / np.sqrt(len(ratios)) * gains**2
    uneven = np.median(np.abs(level / np.median(level) - 1)) / _MEDIAN_ABSOLUTE
    return WhiteBalance(gains, error, float(uneven))


class ColourFit(NamedTuple):
    """The matrix from seen to published colours, and what it leaves of each patch.

    ``residual`` are differences of linear red, green and blue, white being about 0.9; ``rms`` is
    theirs relative to the rms of the published colours.
    """

    matrix: Float[np.ndarray, "3 3"]
    residual: Float[np.ndarray, "patch 3"]
    rms: float

    @property
    def worst(self) -> str:
        """Name the patch that fits least."""
        return PATCHES[int(np.argmax(np.sum(self.residual**2, axis=-1)))]

    @checked
    def applied(self, picture: Float[np.ndarray, "*image 3"]) -> Float[np.ndarray, "*image 3"]:
        """The picture in linear Rec. 709, which may be below 0 for colours outside of it."""
        return np.asarray(picture, np.float64) @ self.matrix.T


@checked
def fit_colours(seen: Float[np.ndarray, "patch 3"], kind: str = "matrix") -> ColourFit:
    """Fit the 24 patches, in the order of ``PATCHES``; a patch that is NaN is left out.

    ``kind``: matrix, or diagonal (a factor for each channel).  It takes in exposure and balance.
    Raises ``ValueError`` for other than 24 patches, fewer than six usable ones, and an unknown
    ``kind``.
    """
    if kind not in ("matrix", "diagonal"):
        raise ValueError(f"kind={kind!r}: choose matrix or diagonal")
    seen = np.asarray(seen, np.float64)
    if len(seen) != len(PATCHES):
        raise ValueError(f"{len(seen)} patches: a chart has {len(PATCHES)}")
    published, usable = chart_colours(), np.asarray(np.isfinite(seen).all(axis=-1))
    if usable.sum() < _COLUMNS:
        raise ValueError(f"{usable.sum()} usable patches: give {_COLUMNS} or more")
    own, wanted = seen[usable], published[usable]
    if kind == "matrix":
        matrix = np.linalg.lstsq(own, wanted, rcond=None)[0].T
    else:
        matrix = np.diag(np.sum(own * wanted, axis=0) / np.sum(own**2, axis=0))
    residual = np.where(usable[:, None], seen @ matrix.T - published, 0)
    rms = np.sqrt(np.mean(residual[usable] ** 2) / np.mean(wanted**2))
    return ColourFit(matrix, residual, float(rms))


def chart_colours() -> Float[np.ndarray, "24 3"]:
    """The published colours of the patches as linear Rec. 709, lit by its white (D65)."""
    lightness, a, b = np.array(_LAB).T
    f = np.stack(
        [
            (lightness + 16) / 116 + a / 500,
            (lightness + 16) / 116,
            (lightness + 16) / 116 - b / 200,
        ],
        axis=-1,
    )
    # The inverse of CIE's cube root, and of the line that continues it below 6 / 29.
    xyz = _D50 * np.where(f > 6 / 29, f**3, 3 * (6 / 29) ** 2 * (f - 4 / 29))
    adapted = np.linalg.inv(_BRADFORD) @ np.diag((_BRADFORD @ _D65) / (_BRADFORD @ _D50))
    return xyz @ (rgb_from_xyz() @ adapted @ _BRADFORD).T


@checked
def chart_patches(
    picture: Float[np.ndarray, "row column channel"], corners: Float[np.ndarray, "4 2"]
) -> Float[np.ndarray, "24 channel"]:
    """Read the patches of a chart: the median of the middle of each, in the order of ``PATCHES``.

    ``corners`` are (row, column) in pixels of the outer corners of the patches dark skin, bluish
    green, black and white, in this order: clockwise from the top left of an upright chart.
    Raises ``ValueError`` for corners of no quadrangle, and a chart that is too small or cut off.
    """
    outline = _homography(np.asarray(corners, np.float64))
    pixels = np.asarray(picture, np.float64)
    inside = (np.arange(16) + 0.5) / 16 * _MIDDLE + (1 - _MIDDLE) / 2
    patches = []
    for number in range(_ROWS * _COLUMNS):
        row, column = divmod(number, _COLUMNS)
        y, x = np.meshgrid((row + inside) / _ROWS, (column + inside) / _COLUMNS, indexing="ij")
        mapped = np.stack([y.ravel(), x.ravel(), np.ones(y.size)], axis=-1) @ outline.T
        places = np.unique(np.floor(mapped[:, :2] / mapped[:, 2:]).astype(int), axis=0)
        if (places < 0).any() or (places >= pixels.shape[:2]).any():
            raise ValueError(f"patch {PATCHES[number]!r} leaves the picture: mend the corners")
        if len(places) < 4:
            raise ValueError("the patches are smaller than four pixels: give a larger picture")
        patches.append(np.median(pixels[places[:, 0], places[:, 1]], axis=0))
    return np.array(patches)


def _homography(corners: Float[np.ndarray, "4 2"]) -> Float[np.ndarray, "3 3"]:
    """Map the unit square, row and column, to a quadrangle; its corners come clockwise."""
    square = np.array([[0, 0], [0, 1], [1, 1], [1, 0]], float)
    rows, right = [], []
    for (y, x), place in zip(square, corners):
        for axis in (0, 1):
            own = np.zeros(8)
            own[3 * axis : 3 * axis + 3] = y, x, 1
            own[6:] = -y * place[axis], -x * place[axis]
            rows.append(own)
            right.append(place[axis])
    matrix = np.array(rows)
    turns = np.roll(corners, -1, 0) - corners
    turns = turns[:, 1] * np.roll(turns, -1, 0)[:, 0] - turns[:, 0] * np.roll(turns, -1, 0)[:, 1]
    if not (turns > 0).all():
        raise ValueError(
            f"the corners {corners.tolist()} are no quadrangle in clockwise order: give (row, "
            "column) of dark skin, bluish green, black, white"
        )
    return np.append(np.linalg.solve(matrix, np.array(right)), 1.0).reshape(3, 3)
