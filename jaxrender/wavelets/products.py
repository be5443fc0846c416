"""Steps along short axes, by small matrix products that leave the array in its order.

The matrices are those of ``dense``; here they multiply from whichever side needs no copy.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.shapes import Array
from jaxrender.wavelets.dense import analysis_matrix, synthesis_matrix
from jaxrender.wavelets.filters import Wavelet
from jaxrender.wavelets.layout import corner

# Rows of so many numbers are multiplied whole, each channel on its own: a third of the matrix
# counts, but products of few columns take as long.
_LONGEST_ROW = 128

_matmul = partial(jnp.matmul, precision=jax.lax.Precision.HIGHEST)


@partial(jax.jit, static_argnums=(0, 2, 3))
def analyse_by_products(
    wavelet: Wavelet, values: Array, axes: tuple[int, ...], levels: int
) -> Array:
    """Return an array after some levels, each a step along all these axes."""
    if len(axes) == 1:
        matrix = analysis_matrix(wavelet, values.shape[axes[0]], levels)
        return _along(matrix, values, axes[0])
    for level in range(levels):
        place = corner(values.shape, axes, level)
        block = values[place]
        for axis in axes:
            block = _along(analysis_matrix(wavelet, block.shape[axis], 1), block, axis)
        values = with_corner(values, block)
    return values


@partial(jax.jit, static_argnums=(0, 2, 3))
def synthesise_by_products(
    wavelet: Wavelet, coefficients: Array, axes: tuple[int, ...], levels: int
) -> Array:
    """Undo ``analyse_by_products``."""
    if len(axes) == 1:
        matrix = synthesis_matrix(wavelet, coefficients.shape[axes[0]], levels)
        return _along(matrix, coefficients, axes[0])
    for level in reversed(range(levels)):
        place = corner(coefficients.shape, axes, level)
        block = coefficients[place]
        for axis in axes:
            block = _along(synthesis_matrix(wavelet, block.shape[axis], 1), block, axis)
        coefficients = with_corner(coefficients, block)
    return coefficients


def with_corner(values: Array, block: Array) -> Array:
    """Return an array with the corner at its origin replaced."""
    return jax.lax.dynamic_update_slice(values, block, (0,) * values.ndim)


def _along(matrix: np.ndarray, values: Array, axis: int) -> Array:
    """Return the array with a matrix applied to one of its axes."""
    size, before = len(matrix), int(np.prod(values.shape[:axis]))
    after = values.size // (size * before)
    if before == 1:
        result = _matmul(jnp.asarray(matrix, values.dtype), values.reshape(size, after))
    elif size * after <= _LONGEST_ROW:
        row = jnp.asarray(np.kron(matrix.T, np.eye(after)), values.dtype)
        result = _matmul(values.reshape(before, size * after), row)
    else:
        # A product of the same matrix with all at once took three times as long in a trial.
        each = jnp.broadcast_to(jnp.asarray(matrix, values.dtype), (before, size, size))
        result = _matmul(each, values.reshape(before, size, after))
    return result.reshape(values.shape)
