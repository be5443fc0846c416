"""Which coefficients to keep: the largest, by fraction, by count or by the error that is left.

For an orthonormal wavelet, in either decomposition, what is left out is what is missing:

    rms error = sqrt(sum of dropped coefficients squared / number of samples)         (L 4.7)

exactly (the text's plain sum is a slip, ERRATA 61).  The linear spline is not orthonormal; for it
the same number is an **estimate**, wrong by a factor that L 4.7 bounds, and the bound that
``keep_within`` is given is met only about so well.  Every channel's number counts for itself; for a
budget of each channel call it once a channel.  With ``joint`` the channels of a place are kept or
left out together by the root of the sum of their squares, as coefficient trees hold them; a count
is then one of places, and the rms error that of this norm.

The choice is made on the host, in float64.  Among equal magnitudes the first in the array is kept.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.shapes import AnyArray, Array, Float


class Thresholded(NamedTuple):
    """Coefficients of which only the largest are not zero."""

    coefficients: Float[Array, "*size channel"]
    kept: int
    predicted_rms: float
    """Of the samples; exact if the wavelet is orthonormal, else an estimate."""


def keep_fraction(
    coefficients: Float[AnyArray, "*size channel"], fraction: float, joint: bool = False
) -> Thresholded:
    """Keep this fraction of the non-zero coefficients, rounded, at least one.

    Raises ValueError if the fraction is not in (0, 1] or a coefficient is not finite.
    """
    if not 0.0 < fraction <= 1.0:
        raise ValueError(f"a fraction of {fraction}; give one above 0, at most 1")
    magnitudes = _magnitudes(coefficients, joint)
    count = round(fraction * np.count_nonzero(magnitudes))
    return _keep(coefficients, magnitudes, max(count, 1))


def keep_largest(
    coefficients: Float[AnyArray, "*size channel"], count: int, joint: bool = False
) -> Thresholded:
    """Keep so many coefficients, or all that are not zero if there are fewer.

    Raises ValueError if the count is not positive or a coefficient is not finite.
    """
    if count < 1:
        raise ValueError(f"{count} coefficients to keep; keep at least one")
    return _keep(coefficients, _magnitudes(coefficients, joint), count)


def keep_within(
    coefficients: Float[AnyArray, "*size channel"], rms: float, joint: bool = False
) -> Thresholded:
    """Keep as few coefficients as leave the predicted rms error at or below this one.

    Raises ValueError if the error is negative or NaN, or a coefficient is not finite.
    """
    if not rms >= 0.0:
        raise ValueError(f"an rms error of {rms}; give zero or a positive number")
    magnitudes = _magnitudes(coefficients, joint)
    dropped = np.cumsum(np.sort(magnitudes) ** 2)
    count = magnitudes.size - int(np.searchsorted(dropped, magnitudes.size * rms**2, "right"))
    return _keep(coefficients, magnitudes, count)


def _magnitudes(coefficients: AnyArray, joint: bool) -> Float[np.ndarray, " place"]:
    if joint:
        rows = np.asarray(coefficients).reshape(-1, coefficients.shape[-1])
        magnitudes = np.sqrt(np.einsum("pc,pc->p", rows, rows, dtype=np.float64))
    else:
        magnitudes = np.abs(np.asarray(coefficients, np.float64)).ravel()
    if not np.isfinite(magnitudes).all():
        raise ValueError(
            f"{np.sum(~np.isfinite(magnitudes))} coefficients are not finite; mend the samples"
        )
    return magnitudes


def _keep(
    coefficients: AnyArray, magnitudes: Float[np.ndarray, " place"], count: int
) -> Thresholded:
    """Keep the largest, the first of equal ones."""
    count = min(count, int(np.count_nonzero(magnitudes)))
    kept = np.zeros(magnitudes.size, bool)
    if count:
        smallest = np.partition(magnitudes, -count)[-count]
        kept = magnitudes > smallest
        equal = np.flatnonzero(magnitudes == smallest)
        kept[equal[: count - np.count_nonzero(kept)]] = True
    missing = np.sqrt(np.sum(magnitudes[~kept] ** 2) / max(magnitudes.size, 1))
    values = jnp.asarray(coefficients)
    joint = kept.size < values.size
    mask = kept.reshape(*values.shape[:-1], 1 if joint else values.shape[-1])
    held = jnp.where(jnp.asarray(mask), values, jnp.zeros((), values.dtype))
    return Thresholded(held, count, float(missing))
