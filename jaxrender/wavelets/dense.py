"""The transforms as written, by a matrix for every step: the slow twins of ``transform``."""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.shapes import Array, Float
from jaxrender.wavelets.filters import Taps, Wavelet
from jaxrender.wavelets.layout import Signal, corner, levels_by_axis, levels_of

_einsum = partial(jnp.einsum, precision=jax.lax.Precision.HIGHEST)


def analyse_standard_dense(
    wavelet: Wavelet, values: Signal, levels: int | None = None
) -> Float[Array, "*size channel"]:
    """Return the same as ``analyse_standard``, by one matrix an axis; raises the same."""
    result = jnp.asarray(values)
    for axis, count in enumerate(levels_by_axis(values, levels)):
        result = _along(analysis_matrix(wavelet, result.shape[axis], count), result, axis)
    return result


def synthesise_standard_dense(
    wavelet: Wavelet, coefficients: Signal, levels: int | None = None
) -> Float[Array, "*size channel"]:
    """Return the same as ``synthesise_standard``, by one matrix an axis; raises the same."""
    result = jnp.asarray(coefficients)
    for axis, count in enumerate(levels_by_axis(coefficients, levels)):
        result = _along(synthesis_matrix(wavelet, result.shape[axis], count), result, axis)
    return result


def analyse_nonstandard_dense(
    wavelet: Wavelet, values: Signal, levels: int | None = None
) -> Float[Array, "*size channel"]:
    """Return the same as ``analyse_nonstandard``, by a matrix a step; raises the same."""
    count = levels_of(values, levels)
    return _analyse(wavelet, jnp.asarray(values), tuple(range(values.ndim - 1)), count)


def synthesise_nonstandard_dense(
    wavelet: Wavelet, coefficients: Signal, levels: int | None = None
) -> Float[Array, "*size channel"]:
    """Return the same as ``synthesise_nonstandard``, by a matrix a step; raises the same."""
    count = levels_of(coefficients, levels)
    axes = tuple(range(coefficients.ndim - 1))
    return _synthesise(wavelet, jnp.asarray(coefficients), axes, count)


def _analyse(wavelet: Wavelet, values: Array, axes: tuple[int, ...], levels: int) -> Array:
    """Return an array after some levels, each a step along all these axes."""
    for level in range(levels):
        place = corner(values.shape, axes, level)
        block = values[place]
        for axis in axes:
            block = _along(analysis_matrix(wavelet, block.shape[axis], 1), block, axis)
        values = values.at[place].set(block)
    return values


def _synthesise(wavelet: Wavelet, coefficients: Array, axes: tuple[int, ...], levels: int) -> Array:
    """Undo ``_analyse``."""
    for level in reversed(range(levels)):
        place = corner(coefficients.shape, axes, level)
        block = coefficients[place]
        for axis in axes:
            block = _along(synthesis_matrix(wavelet, block.shape[axis], 1), block, axis)
        coefficients = coefficients.at[place].set(block)
    return coefficients


@lru_cache(maxsize=64)
def analysis_matrix(
    wavelet: Wavelet, size: int, levels: int
) -> Float[np.ndarray, "coefficient sample"]:
    """Return the matrix from the samples of one axis to its coefficients, float64 on the host."""
    matrix = np.eye(size)
    for level in range(levels):
        held = size >> level
        step = _step_matrix(wavelet.analysis_low, wavelet.analysis_high, wavelet.first, held)
        matrix[:held] = step @ matrix[:held]
    matrix.setflags(write=False)
    return matrix


@lru_cache(maxsize=64)
def synthesis_matrix(
    wavelet: Wavelet, size: int, levels: int
) -> Float[np.ndarray, "sample coefficient"]:
    """Return the matrix from the coefficients of one axis to its samples, float64 on the host."""
    matrix = np.eye(size)
    for level in range(levels):
        # x = S_1 S_2 ... S_J c, where S_l leaves all but the first of its columns alone.
        held = size >> level
        step = _step_matrix(wavelet.synthesis_low, wavelet.synthesis_high, wavelet.first, held)
        matrix[:, :held] = matrix[:, :held] @ step.T
    matrix.setflags(write=False)
    return matrix


def _step_matrix(
    low: Taps, high: Taps, first: int, size: int
) -> Float[np.ndarray, "coefficient sample"]:
    """Return the rows of both filters at every second sample, wrapped around the axis."""
    step = np.zeros((2, size // 2, size))
    for channel, taps in enumerate((low, high)):
        for place in range(size // 2):
            for k, tap in enumerate(taps):
                step[channel, place, (2 * place + k + first) % size] += tap
    return step.reshape(size, size)


def _along(matrix: np.ndarray, values: Array, axis: int) -> Array:
    """Return the array with a matrix applied to one of its axes."""
    moved = jnp.moveaxis(values, axis, 0)
    turned = _einsum("ij,j...->i...", jnp.asarray(matrix, values.dtype), moved)
    return jnp.moveaxis(turned, 0, axis)
