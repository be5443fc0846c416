"""Where coefficients stand (Mallat's order), and what may be transformed.

A step along an axis leaves the averages in its first half and the details in its second; the next
one works on the first half.  After J steps an axis of n samples holds

    [averages: n / 2^J] [coarsest details: n / 2^J] [...] [finest details: n / 2]

The *standard* decomposition does this to each axis on its own, so that index 0 is the scaling
function and 2^l + m the wavelet of level l at place m, l = 0 the coarsest (L 4.3, 4.4, and ERRATA
56, 58).  The *non-standard* one takes one step along every axis, then goes on with the block of
averages, the corner at the origin (L 4.5).  With all levels of a cube that block is one number, the
root scaling coefficient, which carries the mean (ERRATA 59).
"""

from math import log2

import jax.numpy as jnp

from jaxrender.shapes import AnyArray, Float

Signal = Float[AnyArray, "*size channel"]
"""Samples, or coefficients in Mallat's order, over any number of axes; channels come last."""


def check_signal(values: AnyArray):
    """Raise ValueError unless every axis but the last has a power of two of samples, all floats."""
    if not jnp.issubdtype(values.dtype, jnp.floating):
        raise ValueError(f"samples of type {values.dtype}; convert them to float32 or float64")
    if values.ndim < 2:
        raise ValueError(
            f"an array of shape {values.shape} has no axis beside its channels; "
            "give the channels an axis of their own, the last one"
        )
    for axis, size in enumerate(values.shape[:-1]):
        if size < 1 or size & (size - 1):
            nearest = 2 ** round(log2(max(size, 1)))
            raise ValueError(
                f"axis {axis} has {size} samples, which is no power of two; resample to {nearest}"
            )


def levels_of(values: Signal, levels: int | None) -> int:
    """Return the number of levels, all that the shortest axis has if None is given.

    Raises ValueError if there are not so many, and what ``check_signal`` raises.
    """
    check_signal(values)
    shortest = min(values.shape[:-1])
    most = shortest.bit_length() - 1
    if levels is None:
        return most
    if not 0 <= levels <= most:
        raise ValueError(f"{levels} levels of an axis of {shortest} samples; ask for 0 to {most}")
    return levels


def levels_by_axis(values: Signal, levels: int | None) -> tuple[int, ...]:
    """Return the levels of each axis, all that it has if None is given; raises the same."""
    alike = levels_of(values, levels)
    sizes = values.shape[:-1]
    return tuple(size.bit_length() - 1 if levels is None else alike for size in sizes)


def corner(shape: tuple[int, ...], axes: tuple[int, ...], level: int) -> tuple[slice, ...]:
    """Return the place of the averages after so many levels along these axes."""
    return tuple(slice(n >> level if axis in axes else n) for axis, n in enumerate(shape))
