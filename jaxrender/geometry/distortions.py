"""How a lens moves points of the image plane: one class a formula.  Host side, NumPy float64.

Places are (x, y) in focal lengths from the principal point, x right and y down, as OpenCV, COLMAP
and Metashape have them.  ``distort`` moves a place to where the lens shows it, and ``undistort`` is
its inverse.  A formula holds from the axis up to where it folds back upon itself; both are NaN
beyond.  There a place has no ray, and must not be given a wrong one.

``RadialTangential``  polynomials or their quotient in r^2, two tangential and four prism terms
``FieldOfView``       r' = atan(2 r tan(omega / 2)) / omega (Devernay and Faugeras 2001)
``Division``          r = r' / (1 + k r'^2) (Fitzgibbon 2001)
``Skew``              x' = x + skew y
"""

import abc
import math

import equinox as eqx
import numpy as np
from numpy.polynomial import Polynomial

from jaxrender.shapes import Bool, Float, checked

# What is left of an equation that counts as solved, in focal lengths.
_SOLVED = 1e-12
_FARTHEST = 1e8
_STEPS = 100
# Where a tangential formula is looked at, on the way from the axis.
_ON_THE_WAY = np.linspace(0.125, 1, 8)


class Distortion(eqx.Module):
    """A one-to-one map of the image plane about the principal point."""

    @abc.abstractmethod
    def distort(self, places: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
        """Move ideal places to where the lens shows them; NaN beyond the formula's range."""

    @abc.abstractmethod
    def undistort(self, places: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
        """Find the ideal places of what the lens shows; NaN where there are none."""

    @abc.abstractmethod
    def jacobian(self, places: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2 2"]:
        """Differentiate ``distort``: rows are the moved place, columns the ideal one."""


class RadialTangential(Distortion):
    """The lens of Brown and Conrady, as OpenCV writes it, with q = x^2 + y^2.

    g = (1 + sum numerator_i q^i) / (1 + sum denominator_i q^i), (p1, p2) tangential, (s1 .. s4)
    prism:

        x' = x g + 2 p1 x y + p2 (q + 2 x^2) + s1 q + s2 q^2
        y' = y g + p1 (q + 2 y^2) + 2 p2 x y + s3 q + s4 q^2

    It holds where it stretches every direction by a positive factor, from the axis on.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    tangential: tuple[float, ...]
    prism: tuple[float, ...]

    def __init__(
        self,
        numerator: tuple[float, ...] = (),
        denominator: tuple[float, ...] = (),
        tangential: tuple[float, ...] = (0.0, 0.0),
        prism: tuple[float, ...] = (0.0,) * 4,
    ):
        """Raise ``ValueError`` for numbers that are not finite, or too many or few of them."""
        self.numerator = _finite("numerator", numerator)
        self.denominator = _finite("denominator", denominator)
        self.tangential = _finite("tangential", tangential, 2)
        self.prism = _finite("prism", prism, 4)

    @property
    def reach(self) -> float:
        """The radius at which the radial part folds back, or has a pole."""
        above, below = self._polynomials()
        q = Polynomial([0.0, 1.0])
        rise = above * below + 2 * q * (above.deriv() * below - above * below.deriv())
        turns = np.concatenate([one.trim().roots() for one in (rise, below)])
        real = turns.real[(np.abs(turns.imag) <= 1e-12 * np.abs(turns)) & (turns.real > 0)]
        return math.sqrt(real.min()) if real.size else math.inf

    @checked
    def distort(self, places: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
        """Move ideal places to where the lens shows them; NaN beyond the formula's range."""
        return np.where(self._holds(places)[..., None], self._moved(places), np.nan)

    @checked
    def undistort(self, places: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
        """Solve for the radius, then by Newton's method for both coordinates, to 1e-12."""
        radius = np.linalg.norm(places, axis=-1)
        ideal = self._ideal_radius(radius)
        start = places * (ideal / np.where(radius > 0, radius, 1))[..., None]
        if not self._bends:
            return start
        # A tangential term may reach what the radial part alone does not.
        near = places * (min(self.reach, 1.0) / np.maximum(radius, 1))[..., None]
        found = np.where(np.isfinite(start), start, 0.9 * near)
        with np.errstate(all="ignore"):
            for _ in range(_STEPS // 4):
                left = self._moved(found) - places
                if not np.any(np.abs(left) > _SOLVED / 100):
                    break
                found = found - _solved(self._slopes(found), left)
            left = np.abs(self._moved(found) - places).max(axis=-1)
        good = (left <= _SOLVED * (1 + radius)) & self._holds(found)
        return np.where(good[..., None], found, np.nan)

    @checked
    def jacobian(self, places: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2 2"]:
        """Differentiate ``distort``."""
        return np.where(self._holds(places)[..., None, None], self._slopes(places), np.nan)

    @property
    def _bends(self) -> bool:
        return any(self.tangential) or any(self.prism)

    def _polynomials(self) -> tuple[Polynomial, Polynomial]:
        return Polynomial([1.0, *self.numerator]), Polynomial([1.0, *self.denominator])

    def _gain(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate g and its derivative."""
        above, below = self._polynomials()
        bottom = below(q)
        gain = above(q) / bottom
        return gain, (above.deriv()(q) - gain * below.deriv()(q)) / bottom

    def _moved(self, places: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            x, y = places[..., 0], places[..., 1]
            q, (p1, p2), (s1, s2, s3, s4) = x * x + y * y, self.tangential, self.prism
            gain = self._gain(q)[0]
            across = x * gain + 2 * p1 * x * y + p2 * (q + 2 * x * x) + (s1 + s2 * q) * q
            down = y * gain + p1 * (q + 2 * y * y) + 2 * p2 * x * y + (s3 + s4 * q) * q
        return np.stack([across, down], axis=-1)

    def _slopes(self, places: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            x, y = places[..., 0], places[..., 1]
            q, (p1, p2), (s1, s2, s3, s4) = x * x + y * y, self.tangential, self.prism
            gain, rise = self._gain(q)
            shared = 2 * rise * x * y + 2 * p1 * x + 2 * p2 * y
            xx = gain + 2 * rise * x * x + 2 * p1 * y + 6 * p2 * x + 2 * x * (s1 + 2 * s2 * q)
            yy = gain + 2 * rise * y * y + 6 * p1 * y + 2 * p2 * x + 2 * y * (s3 + 2 * s4 * q)
            xy, yx = shared + 2 * y * (s1 + 2 * s2 * q), shared + 2 * x * (s3 + 2 * s4 * q)
        return np.stack([np.stack([xx, xy], -1), np.stack([yx, yy], -1)], axis=-2)

    def _holds(self, places: np.ndarray) -> Bool[np.ndarray, "point"]:
        """Whether the formula stretches all directions, from the axis to a place."""
        inside = np.linalg.norm(places, axis=-1) < self.reach
        if self._bends:
            for part in _ON_THE_WAY:
                slopes = self._slopes(part * places)
                skew = (slopes[..., 0, 1] + slopes[..., 1, 0]) / 2
                stretch = slopes[..., 0, 0], slopes[..., 1, 1]
                inside &= (stretch[0] > 0) & (stretch[0] * stretch[1] > skew * skew)
        return inside

    def _ideal_radius(self, radius: np.ndarray) -> np.ndarray:
        """Solve r g(r^2) = radius by Newton's method between bounds; NaN where nothing does."""

        def equation(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            gain, rise = self._gain(r * r)
            return r * gain - radius, gain + 2 * r * r * rise

        with np.errstate(all="ignore"):
            low, high = np.zeros_like(radius), np.full_like(radius, min(self.reach, _FARTHEST))
            now = np.minimum(radius, 0.999 * high)
            for _ in range(_STEPS):
                left, slope = equation(now)
                low, high = np.where(left <= 0, now, low), np.where(left >= 0, now, high)
                step = now - left / slope
                step = np.where((step >= low) & (step <= high), step, (low + high) / 2)
                moved, now = np.abs(step - now), step
                if not np.any(moved > 1e-16 * (1 + now)):
                    break
            left = np.abs(equation(now)[0])
        good = (left <= _SOLVED * (1 + radius)) & (now < self.reach)
        return np.where(good, now, np.nan)


class FieldOfView(Distortion):
    """r' = atan(2 r tan(omega / 2)) / omega, ``omega`` in radians between 0 and pi."""

    omega: float

    def __init__(self, omega: float):
        """Raise ``ValueError`` for an angle out of range."""
        if not 0 < omega < math.pi:
            raise ValueError(f"omega is {omega}: give radians between 0 and pi")
        self.omega = float(omega)

    @checked
    def distort(self, places: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
        """Move ideal places to where the lens shows them."""
        return places * self._gain(np.linalg.norm(places, axis=-1))[0][..., None]

    @checked
    def undistort(self, places: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
        """Invert the formula; NaN from r' = pi / (2 omega) on, which is infinitely far."""
        radius = np.linalg.norm(places, axis=-1)
        angle = np.where(radius * self.omega < math.pi / 2, radius * self.omega, np.nan)
        small = radius < 1e-9
        ratio = np.tan(angle) / (self._factor * np.where(small, 1, radius))
        return places * np.where(small, self.omega / self._factor, ratio)[..., None]

    @checked
    def jacobian(self, places: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2 2"]:
        """Differentiate ``distort``."""
        return _radial_slopes(places, *self._gain(np.linalg.norm(places, axis=-1)))

    @property
    def _factor(self) -> float:
        return 2 * math.tan(self.omega / 2)

    def _gain(self, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate r' / r and its derivative to r^2."""
        c = self._factor
        small = c * radius < 1e-4
        r = np.where(small, 1, radius)
        angle = np.arctan(c * r)
        rise = (c / (1 + (c * r) ** 2) - angle / r) / (2 * self.omega * r * r)
        square = (c * radius) ** 2
        gain = np.where(small, c / self.omega * (1 - square / 3), angle / (self.omega * r))
        return gain, np.where(small, -(c**3) / (3 * self.omega), rise)


class Division(Distortion):
    """r = r' / (1 + k r'^2): the ideal radius of the one that is shown."""

    k: float

    def __init__(self, k: float):
        """Raise ``ValueError`` for a number that is not finite."""
        (self.k,) = _finite("k", (k,))

    @checked
    def distort(self, places: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
        """Solve the quadratic equation for the branch through the axis."""
        return places * self._gain(places)[0][..., None]

    @checked
    def undistort(self, places: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
        """Apply the formula, up to where it folds back or has its pole."""
        stretch = self.k * np.sum(places**2, axis=-1)
        holds = np.abs(stretch) < 1
        return places / np.where(holds, 1 + stretch, np.nan)[..., None]

    @checked
    def jacobian(self, places: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2 2"]:
        """Differentiate ``distort``."""
        return _radial_slopes(places, *self._gain(places))

    def _gain(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        square = 1 - 4 * self.k * np.sum(places**2, axis=-1)
        root = np.sqrt(np.where(square > 0, square, np.nan))
        return 2 / (1 + root), 4 * self.k / (root * (1 + root) ** 2)


class Skew(Distortion):
    """x' = x + skew y: rows of pixels that are not at right angles to the columns."""

    skew: float

    def __init__(self, skew: float):
        """Raise ``ValueError`` for a number that is not finite."""
        (self.skew,) = _finite("skew", (skew,))

    @checked
    def distort(self, places: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
        """Shift each row."""
        return places + self.skew * places[..., 1:] * np.array([1, 0])

    @checked
    def undistort(self, places: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
        """Shift each row back."""
        return places - self.skew * places[..., 1:] * np.array([1, 0])

    @checked
    def jacobian(self, places: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2 2"]:
        """Differentiate ``distort``."""
        return np.broadcast_to(np.array([[1, self.skew], [0, 1]]), (*places.shape, 2))


def _radial_slopes(places: np.ndarray, gain: np.ndarray, rise: np.ndarray) -> np.ndarray:
    outer = places[..., :, None] * places[..., None, :]
    return gain[..., None, None] * np.eye(2) + 2 * rise[..., None, None] * outer


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve equations of two unknowns; not finite where the matrix is singular."""
    (a, b), (c, d) = np.moveaxis(matrix, (-2, -1), (0, 1))
    u, v = right[..., 0], right[..., 1]
    return np.stack([d * u - b * v, a * v - c * u], axis=-1) / (a * d - b * c)[..., None]


def _finite(name: str, values: tuple[float, ...], count: int | None = None) -> tuple[float, ...]:
    numbers = tuple(float(value) for value in values)
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"{name} is {numbers}: give finite numbers")
    if count is not None and len(numbers) != count:
        raise ValueError(f"{name} has {len(numbers)} numbers: give {count}")
    return numbers
