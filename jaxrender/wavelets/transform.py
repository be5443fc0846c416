"""Between samples and wavelet coefficients, over any number of axes: standard and non-standard.

One step along one axis is ``analyse_step``, undone by ``synthesise_step``; ``layout`` says in what
order the decompositions take them and where the coefficients stand.  Axes are periodic.  As in
PyWavelets' mode "periodization", the standard decomposition is ``fswavedecn`` and the non-standard
one ``wavedecn``.  ``dense`` holds the twins.

Short axes go by ``products``, long ones by ``passes``, and by these all axes of some length if the
filter has two taps.  Passes are programs called one after another, so they are fastest when called
from Python; inside another ``jit`` they give the same numbers more slowly.
"""

from functools import partial

import jax
import jax.numpy as jnp

from jaxrender.shapes import Array, Float
from jaxrender.wavelets.filters import Wavelet
from jaxrender.wavelets.layout import Signal, check_signal, corner, levels_by_axis, levels_of
from jaxrender.wavelets.passes import (
    analyse_by_passes,
    synthesise_by_passes,
    takes_averages,
)
from jaxrender.wavelets.products import (
    analyse_by_products,
    synthesise_by_products,
    with_corner,
)

# Up to here products are used.  At 32^4 samples passes beat them if filters have two taps and
# several axes go together, and lose to them otherwise.
_LARGEST_OF_TWO_TAPS = 8
_LARGEST_BY_PRODUCTS = 64


def analyse_step(wavelet: Wavelet, values: Signal, axis: int) -> Float[Array, "*size channel"]:
    """Return averages, then details, along one axis.

    Raises ValueError if a size is no power of two, or if the axis is the channels' or has a single
    sample.
    """
    _check_axis(values, axis)
    return _analyse(wavelet, jnp.asarray(values), (axis,), 1)


def synthesise_step(
    wavelet: Wavelet, coefficients: Signal, axis: int
) -> Float[Array, "*size channel"]:
    """Return the samples along one axis from averages and details; raises the same."""
    _check_axis(coefficients, axis)
    return _synthesise(wavelet, jnp.asarray(coefficients), (axis,), 1)


def analyse_standard(
    wavelet: Wavelet, values: Signal, levels: int | None = None
) -> Float[Array, "*size channel"]:
    """Return the coefficients of the standard decomposition, all levels of each axis by default.

    Raises ValueError if a size is no power of two or the shortest axis has not so many levels.
    """
    result = jnp.asarray(values)
    for axis, count in enumerate(levels_by_axis(values, levels)):
        result = _analyse(wavelet, result, (axis,), count)
    return result


def synthesise_standard(
    wavelet: Wavelet, coefficients: Signal, levels: int | None = None
) -> Float[Array, "*size channel"]:
    """Return the samples from the coefficients of ``analyse_standard``; raises the same."""
    result = jnp.asarray(coefficients)
    for axis, count in enumerate(levels_by_axis(coefficients, levels)):
        result = _synthesise(wavelet, result, (axis,), count)
    return result


def analyse_nonstandard(
    wavelet: Wavelet, values: Signal, levels: int | None = None
) -> Float[Array, "*size channel"]:
    """Return the coefficients of the non-standard decomposition, all levels by default.

    Raises ValueError if a size is no power of two or the shortest axis has not so many levels.
    """
    count = levels_of(values, levels)
    return _analyse(wavelet, jnp.asarray(values), tuple(range(values.ndim - 1)), count)


def synthesise_nonstandard(
    wavelet: Wavelet, coefficients: Signal, levels: int | None = None
) -> Float[Array, "*size channel"]:
    """Return the samples from the coefficients of ``analyse_nonstandard``; raises the same."""
    count = levels_of(coefficients, levels)
    axes = tuple(range(coefficients.ndim - 1))
    return _synthesise(wavelet, jnp.asarray(coefficients), axes, count)


def _check_axis(values: Signal, axis: int):
    check_signal(values)
    if not 0 <= axis < values.ndim - 1:
        raise ValueError(f"axis {axis}; choose one of 0 to {values.ndim - 2}, channels come last")
    if values.shape[axis] < 2:
        raise ValueError(f"axis {axis} has one sample, which cannot be halved; leave it out")


def _analyse(wavelet: Wavelet, values: Array, axes: tuple[int, ...], levels: int) -> Array:
    """Return an array after some levels, each a step along all these axes."""
    if levels == 0:
        return values
    long, short = _by_length(wavelet, values, axes)
    if not long:
        return analyse_by_products(wavelet, values, axes, levels)
    result = analyse_by_passes(wavelet, values, long)
    if short:
        result = analyse_by_products(wavelet, result, short, 1)
    if levels == 1:
        return result
    averages = _analyse(wavelet, _averages(result, axes), axes, levels - 1)
    return _with_averages_in_place(result, averages)


def _synthesise(wavelet: Wavelet, coefficients: Array, axes: tuple[int, ...], levels: int) -> Array:
    """Undo ``_analyse``."""
    if levels == 0:
        return coefficients
    long, short = _by_length(wavelet, coefficients, axes)
    if not long:
        return synthesise_by_products(wavelet, coefficients, axes, levels)
    result = coefficients
    if levels > 1:
        averages = _synthesise(wavelet, _averages(result, axes), axes, levels - 1)
        if not short and takes_averages(wavelet):
            return synthesise_by_passes(wavelet, result, long, averages)
        result = _with_averages(result, averages)
    if short:
        result = synthesise_by_products(wavelet, result, short, 1)
    return synthesise_by_passes(wavelet, result, long)


def _by_length(
    wavelet: Wavelet, values: Array, axes: tuple[int, ...]
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the axes long enough for passes, and the others."""
    few = len(wavelet.analysis_low) == 2 and len(axes) > 1
    largest = _LARGEST_OF_TWO_TAPS if few else _LARGEST_BY_PRODUCTS
    long = tuple(axis for axis in axes if values.shape[axis] > largest)
    return long, tuple(axis for axis in axes if axis not in long)


@partial(jax.jit, static_argnums=1)
def _averages(values: Array, axes: tuple[int, ...]) -> Array:
    return values[corner(values.shape, axes, 1)]


_with_averages = jax.jit(with_corner)
# For an array that nobody else holds.
_with_averages_in_place = jax.jit(with_corner, donate_argnums=0)
