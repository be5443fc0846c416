"""Small trees of every wavelet, for the tests of what is done with them."""

import jax.numpy as jnp
import numpy as np

from jaxrender.wavelets import (
    CoefficientTree,
    Wavelet,
    analyse_nonstandard,
    keep_fraction,
)


def samples_of(size: int, axes: int, seed: int = 0) -> np.ndarray:
    """A bump on a slope, with noise: details at every level; three channels."""
    grid = np.stack(np.meshgrid(*[(np.arange(size) + 0.5) / size] * axes, indexing="ij"), axis=-1)
    bump = np.exp(-20 * np.sum((grid - 0.4) ** 2, axis=-1))
    noise = np.random.default_rng(seed).normal(size=(*grid.shape[:-1], 3))
    return (bump + grid @ np.arange(1.0, axes + 1))[..., None] * [1.0, 0.5, 2.0] + 0.2 * noise


def tree_of(
    wavelet: Wavelet, size: int, axes: int, fraction: float = 1.0, seed: int = 0
) -> CoefficientTree:
    coefficients = analyse_nonstandard(wavelet, jnp.asarray(samples_of(size, axes, seed)))
    kept = keep_fraction(coefficients, fraction, joint=True)
    return CoefficientTree.of_coefficients(wavelet, kept.coefficients)
