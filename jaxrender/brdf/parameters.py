"""The numbers that a model is made of: how they are kept, and which are refused.

Checks run at construction and skip traced values: inside a compiled or differentiated function
there is no number to look at.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.shapes import AnyArray, Array, Float

Scalar = Float[AnyArray, ""] | float

# A sum of reflectances may round up to this much above 1 and still count as 1.
_ROUNDING = 1e-6


def as_scalar(value: Scalar | int) -> Scalar:
    """Make a number an array, still weak in type: as a plain float each would be compiled anew."""
    return jax.device_put(float(value)) if isinstance(value, float | int) else value


def as_scalar_or_none(value: Scalar | int | None) -> Scalar | None:
    """Do the same where the parameter may be left out."""
    return None if value is None else as_scalar(value)


def is_known(value: Float[AnyArray, "..."] | float) -> bool:
    """Say whether there is a number to look at: inside a traced function there is none."""
    return not isinstance(value, Tracer)


def matching(
    value: Float[AnyArray, "*shape"] | float, reference: Float[AnyArray, "..."]
) -> Float[Array, "*shape"]:
    """Bring a parameter to the precision of the directions that it meets."""
    return jnp.asarray(value, reference.dtype)


def refuse_outside(
    name: str, value: Float[AnyArray, "..."] | float, interval: str, remedy: str
) -> None:
    """Raise ``ValueError`` when a known value lies outside an interval such as ``(0, 1]``."""
    if not is_known(value):
        return
    lower, upper = (float(end) for end in interval[1:-1].split(","))
    values = np.asarray(value)
    above = values > lower if interval[0] == "(" else values >= lower
    below = values < upper if interval[-1] == ")" else values <= upper
    if not np.all(above & below):
        raise ValueError(f"{name}={values}: must lie in {interval}; {remedy}")


def refuse_unlisted(name: str, value: str, choices: Sequence[str]) -> None:
    """Raise ``ValueError`` that lists the choices when the value is not one of them."""
    if value not in choices:
        raise ValueError(f"{name}={value!r}: choose one of {', '.join(choices)}")


def refuse_other_channels(name: str, value: Float[AnyArray, "..."], channels: int) -> None:
    """Raise ``ValueError`` when a parameter's channels are not as many as the amplitudes'."""
    if value.shape[-1] != channels:
        raise ValueError(
            f"{name} has {value.shape[-1]} channels where kd has {channels}: give one for each"
        )


def share_of_energy_is_bounded(*reflectances: Float[AnyArray, "*#channel"] | float) -> bool:
    """Say whether reflectances are none of them negative and add up to at most 1 in each channel.

    Only of known values: raises JAX's own error inside a traced function.
    """
    parts = [np.asarray(part, float) for part in reflectances]
    return bool(all(np.all(part >= 0) for part in parts) and np.all(sum(parts) <= 1 + _ROUNDING))
