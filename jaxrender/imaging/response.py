"""Camera and display responses: from the numbers in a file to linear radiance and back.

``values`` are normalised to 0..1 at the file boundary (8-bit code 255 is 1); ``radiance`` is linear
with 1 at full scale.  Host side, NumPy float64.
"""

import abc
from collections.abc import Callable

import equinox as eqx
import numpy as np
from jaxtyping import Float

from jaxrender.shapes import AnyArray, checked

# IEC 61966-2-1: slope, offset, exponent, and the breakpoint on either side.
_SLOPE, _OFFSET, _GAMMA = 12.92, 0.055, 2.4
_BREAK_VALUE, _BREAK_RADIANCE = 0.04045, 0.0031308


class Response(eqx.Module):
    """An invertible map between stored values and linear radiance."""

    @abc.abstractmethod
    def linearise(self, values: Float[np.ndarray, "*image"]) -> Float[np.ndarray, "*image"]:
        """Linear radiance of stored values."""

    @abc.abstractmethod
    def encode(self, radiance: Float[np.ndarray, "*image"]) -> Float[np.ndarray, "*image"]:
        """Stored values of linear radiance."""


class Linear(Response):
    """Values are proportional to radiance: EXR, HDR, PFM, and some 8-bit laboratory cameras."""

    @checked
    def linearise(self, values: Float[np.ndarray, "*image"]) -> Float[np.ndarray, "*image"]:
        """The values themselves."""
        return np.asarray(values, np.float64)

    @checked
    def encode(self, radiance: Float[np.ndarray, "*image"]) -> Float[np.ndarray, "*image"]:
        """The radiance itself."""
        return np.asarray(radiance, np.float64)


class SRGB(Response):
    """The piecewise curve of IEC 61966-2-1, not its gamma 2.2 approximation.

    The linear segment continues below 0 and the power above 1, so that noise and highlights survive
    a round trip.  The standard's rounded breakpoints leave a step of 3e-8 in value.
    """

    @checked
    def linearise(self, values: Float[np.ndarray, "*image"]) -> Float[np.ndarray, "*image"]:
        """v / 12.92 up to v = .04045, ((v + .055) / 1.055)^2.4 above."""
        values = np.asarray(values, np.float64)
        power = ((np.maximum(values, 0) + _OFFSET) / (1 + _OFFSET)) ** _GAMMA
        return np.where(values <= _BREAK_VALUE, values / _SLOPE, power)

    @checked
    def encode(self, radiance: Float[np.ndarray, "*image"]) -> Float[np.ndarray, "*image"]:
        """12.92 L up to L = .0031308, 1.055 L^(1/2.4) - .055 above."""
        radiance = np.asarray(radiance, np.float64)
        root = (1 + _OFFSET) * np.maximum(radiance, 0) ** (1 / _GAMMA) - _OFFSET
        return np.where(radiance <= _BREAK_RADIANCE, _SLOPE * radiance, root)


class Curve(Response):
    """A measured response: a strictly increasing table, linear between its entries.

    ``radiance`` has one column for all channels, or one column for each.
    """

    values: Float[np.ndarray, "entry"]
    radiance: Float[np.ndarray, "entry"] | Float[np.ndarray, "entry channel"]

    def __init__(
        self,
        values: Float[AnyArray, "entry"],
        radiance: Float[AnyArray, "entry"] | Float[AnyArray, "entry channel"],
    ):
        """Raises ValueError unless all columns are finite and strictly increasing."""
        self.values = _increasing("values", values)
        columns = np.array(radiance, np.float64)
        if columns.ndim == 2:
            names = [f"radiance of channel {k}" for k in range(columns.shape[1])]
            each = [_increasing(name, one) for name, one in zip(names, columns.T, strict=True)]
            self.radiance = np.stack(each, axis=-1)
        else:
            self.radiance = _increasing("radiance", columns)
        if len(self.values) != len(self.radiance):
            raise ValueError(
                f"a curve of {len(self.values)} values and {len(self.radiance)} radiances: "
                "give one radiance for each value"
            )

    @checked
    def linearise(self, values: Float[np.ndarray, "*image"]) -> Float[np.ndarray, "*image"]:
        """Interpolated; raises ValueError for values that the table does not cover."""
        values = np.asarray(values, np.float64)
        first, last = self.values[0], self.values[-1]
        outside = ~((values >= first) & (values <= last))
        if outside.any():
            raise ValueError(
                f"value {values[outside].flat[0]} lies outside the response curve, which covers "
                f"{first} to {last}: extend the curve or mask such pixels"
            )
        return self._by_channel(values, lambda x, radiance: np.interp(x, self.values, radiance))

    @checked
    def encode(self, radiance: Float[np.ndarray, "*image"]) -> Float[np.ndarray, "*image"]:
        """Interpolated; radiance beyond the table saturates, as on a sensor."""
        radiance = np.asarray(radiance, np.float64)
        return self._by_channel(radiance, lambda x, own: np.interp(x, own, self.values))

    def _by_channel(self, image: np.ndarray, interpolate: Callable) -> np.ndarray:
        if self.radiance.ndim == 1:
            return interpolate(image, self.radiance)
        channels = self.radiance.shape[1]
        if image.shape[-1:] != (channels,):
            raise ValueError(
                f"a response of {channels} channels and an image of shape {list(image.shape)}: "
                f"its last axis must be that of {channels} channels"
            )
        each = [interpolate(image[..., k], self.radiance[:, k]) for k in range(channels)]
        return np.stack(each, axis=-1)


_NAMED: dict[str, type[Response]] = {"linear": Linear, "srgb": SRGB}


def response_named(name: str) -> Response:
    """The response called ``linear`` or ``srgb``; ValueError lists the names."""
    if name not in _NAMED:
        raise ValueError(
            f"unknown response {name!r}: choose one of {', '.join(sorted(_NAMED))}, or give a curve"
        )
    return _NAMED[name]()


def _increasing(name: str, column: Float[AnyArray, "entry"]) -> Float[np.ndarray, "entry"]:
    column = np.array(column, np.float64)
    if len(column) < 2 or not np.isfinite(column).all():
        raise ValueError(f"a curve's {name} must be at least two finite numbers, got {column}")
    steps = np.diff(column)
    if not (steps > 0).all():
        entry = int(np.argmax(steps <= 0)) + 1
        raise ValueError(
            f"a curve's {name} must increase strictly, but entry {entry} is {column[entry]} after "
            f"{column[entry - 1]}: sort the table and merge repeated entries"
        )
    return column
