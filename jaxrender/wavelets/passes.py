"""One step along long axes, as sums of shifted slices: what makes ``transform`` fast.

A pass reads an array that was first extended around its seam, so that every tap is a plain slice,
and writes both halves, or all samples, in one sweep.  Extension and pass are programs of their own:
seeing both, XLA would look for the seam again at every tap (measured two to three times slower).
"""

from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.shapes import Array, Float
from jaxrender.wavelets.filters import Wavelet

# Filters of two taps need no extension, and along three axes at once they read only eight samples,
# whole rows of them.  The last axis is taken alone: its samples lie a few channels apart.
_TAPS_OF_A_PAIR = 2
_AXES_TOGETHER = 3


def analyse_by_passes(wavelet: Wavelet, values: Array, axes: tuple[int, ...]) -> Array:
    """Return one level along these axes, none shorter than the filters."""
    weights, first = _analysis_weights(wavelet)
    after = weights.shape[0] - 2 + first
    for group in _groups(wavelet, axes, values.ndim):
        if after - first > 0:
            values = _extended(values, group[0], -first, after)
        values = _analysis_pass(wavelet, values, group)
    return values


def synthesise_by_passes(
    wavelet: Wavelet, coefficients: Array, axes: tuple[int, ...], averages: Array | None = None
) -> Array:
    """Undo ``analyse_by_passes``; ``averages`` take the place of the corner at the origin.

    They are refused for filters of more than two taps, which reach across the corner's edge.
    """
    weights, first = _synthesis_weights(wavelet)
    after = weights.shape[0] - 1 + first
    groups = _groups(wavelet, axes, coefficients.ndim)
    if averages is not None:
        # The last axis, which stands alone.
        *groups, (axis,) = groups
        coefficients = _synthesised_with(wavelet, coefficients, averages, axis)
    for group in groups:
        if after - first > 0:
            coefficients = _extended_halves(coefficients, group[0], -first, after)
        coefficients = _synthesis_pass(wavelet, coefficients, group)
    return coefficients


def takes_averages(wavelet: Wavelet) -> bool:
    """Say whether ``synthesise_by_passes`` takes averages that stand apart."""
    return len(wavelet.synthesis_low) <= _TAPS_OF_A_PAIR


def _synthesised_with(wavelet: Wavelet, coefficients: Array, averages: Array, axis: int) -> Array:
    """Return a pass over coefficients whose corner is replaced, without a copy of all of them.

    The pass goes over what stands in the corner, and the corner's part is then done again.
    """
    corner = _corner_pass(wavelet, coefficients, averages, axis)
    return _mended(_synthesis_pass(wavelet, coefficients, (axis,)), corner)


@partial(jax.jit, static_argnums=(0, 3))
def _corner_pass(wavelet: Wavelet, coefficients: Array, averages: Array, axis: int) -> Array:
    sizes = averages.shape
    details = coefficients[
        tuple(
            slice(size, 2 * size) if place == axis else slice(size)
            for place, size in enumerate(sizes)
        )
    ]
    return _joined(wavelet, (averages, details), axis)


@partial(jax.jit, donate_argnums=0)
def _mended(whole: Array, corner: Array) -> Array:
    return jax.lax.dynamic_update_slice(whole, corner, (0,) * whole.ndim)


def _groups(wavelet: Wavelet, axes: tuple[int, ...], rank: int) -> list[tuple[int, ...]]:
    """Return the axes of each pass."""
    if len(wavelet.analysis_low) > _TAPS_OF_A_PAIR:
        return [(axis,) for axis in axes]
    others = tuple(axis for axis in axes if axis != rank - 2)
    groups = [others[i : i + _AXES_TOGETHER] for i in range(0, len(others), _AXES_TOGETHER)]
    return groups if len(others) == len(axes) else [*groups, (rank - 2,)]


def _analysis_weights(wavelet: Wavelet) -> tuple[Float[np.ndarray, "tap half"], int]:
    """Return what samples 2i + k + first count in both halves, and first; idle taps left out."""
    weights = np.array([wavelet.analysis_low, wavelet.analysis_high]).T
    used = np.flatnonzero(weights.any(axis=1))
    return weights[used[0] : used[-1] + 1], wavelet.first + int(used[0])


def _synthesis_weights(wavelet: Wavelet) -> tuple[Float[np.ndarray, "tap half parity"], int]:
    """Return what coefficients i + k + first of both halves count in samples 2i and 2i + 1."""
    filters = np.array([wavelet.synthesis_low, wavelet.synthesis_high])
    taps = filters.shape[1]
    weights = np.zeros((2 * taps, 2, 2))
    for tap in range(taps):
        # Coefficient j reaches sample 2j + tap + wavelet.first.
        shift, parity = divmod(tap + wavelet.first, 2)
        weights[taps - shift, :, parity] = filters[:, tap]
    used = np.flatnonzero(weights.any(axis=(1, 2)))
    return weights[used[0] : used[-1] + 1], int(used[0]) - taps


@partial(jax.jit, static_argnums=(1, 2, 3))
def _extended(values: Array, axis: int, before: int, after: int) -> Array:
    """Return an array that goes on periodically for some samples on either side of one axis."""
    size = values.shape[axis]
    head = jax.lax.slice_in_dim(values, size - before, size, axis=axis)
    tail = jax.lax.slice_in_dim(values, 0, after, axis=axis)
    return jnp.concatenate([head, values, tail], axis)


@partial(jax.jit, static_argnums=(1, 2, 3))
def _extended_halves(coefficients: Array, axis: int, before: int, after: int) -> Array:
    """Return the same of averages and details, each on its own."""
    halves = jnp.split(coefficients, 2, axis)
    return jnp.concatenate([_extended(half, axis, before, after) for half in halves], axis)


@partial(jax.jit, static_argnums=(0, 2))
def _analysis_pass(wavelet: Wavelet, values: Array, axes: tuple[int, ...]) -> Array:
    weights, _ = _analysis_weights(wavelet)
    for axis in axes:
        size = values.shape[axis] - len(weights) + 2
        shape = (*values.shape[:axis], 2, size // 2, *values.shape[axis + 1 :])
        terms = [
            _spread(jax.lax.slice_in_dim(values, k, k + size - 1, 2, axis), tap, shape, axis)
            for k, tap in enumerate(weights)
        ]
        values = _total(terms).reshape(*shape[:axis], size, *shape[axis + 2 :])
    return values


@partial(jax.jit, static_argnums=(0, 2))
def _synthesis_pass(wavelet: Wavelet, coefficients: Array, axes: tuple[int, ...]) -> Array:
    values = coefficients
    for axis in axes:
        values = _joined(wavelet, jnp.split(values, 2, axis), axis)
    return values


def _joined(wavelet: Wavelet, halves: Sequence[Array], axis: int) -> Array:
    """Return the samples along an axis from averages and details, extended where taps reach."""
    weights, _ = _synthesis_weights(wavelet)
    size = halves[0].shape[axis] - len(weights) + 1
    shape = (*halves[0].shape[:axis], size, 2, *halves[0].shape[axis + 1 :])
    terms = [
        _spread(jax.lax.slice_in_dim(half, k, k + size, 1, axis), tap, shape, axis + 1)
        for taps, half in zip(np.swapaxes(weights, 0, 1), halves, strict=True)
        for k, tap in enumerate(taps)
        if tap.any()
    ]
    return _total(terms).reshape(*shape[:axis], 2 * size, *shape[axis + 2 :])


def _spread(values: Array, weights: np.ndarray, shape: tuple[int, ...], axis: int) -> Array:
    """Return the values times each of two weights, along a new axis."""
    others = tuple(place for place in range(len(shape)) if place != axis)
    spread = jax.lax.broadcast_in_dim(values, shape, others)
    return spread * jax.lax.broadcast_in_dim(jnp.asarray(weights, values.dtype), shape, (axis,))


def _total(terms: list[Array]) -> Array:
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total
