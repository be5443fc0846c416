"""A recovered light as images."""

from typing import NamedTuple

import numpy as np

from jaxrender.harmonics import LatLongGrid, band_limit_of, real_basis
from jaxrender.inverse.factorization import RecoveredScene
from jaxrender.lighting import DirectionalSources, positive_environment
from jaxrender.shapes import Float

# Rows of the recovered light's image: its texels are smaller than any lobe that showed it.
_ROWS = 128


class LightImages(NamedTuple):
    """A light as latitude-longitude images of radiance: the whole of it, and its slow part.

    ``deviation`` is the standard deviation of the slow part.  Where the photographs tell nothing it
    is that of the light that was expected.
    """

    whole: Float[np.ndarray, "row column channel"]
    slow: Float[np.ndarray, "row column channel"]
    deviation: Float[np.ndarray, "row column channel"]


def light_images(scene: RecoveredScene) -> LightImages:
    """Draw the light; in the whole of it each source is one texel of the same energy.

    The light is black where the sum of few degrees falls below zero.  The added energy is removed
    elsewhere, so that the image keeps the recovered coefficients.
    """
    grid = LatLongGrid(_ROWS, 2 * _ROWS)
    light = positive_environment(np.asarray(scene.slow), np.asarray(scene.slow_error), _ROWS)
    slow = np.asarray(light.radiance)
    whole = slow.copy()
    rows, columns = texels_of(scene.sources, grid)
    energy = np.maximum(np.asarray(scene.sources.irradiance), 0)
    np.add.at(whole, (rows, columns), energy / grid.weights()[rows, columns, None])
    return LightImages(whole, slow, _deviation(scene, grid))


def _deviation(scene: RecoveredScene, grid: LatLongGrid) -> Float[np.ndarray, "row column channel"]:
    """Carry the covariance of the slow coefficients to every texel."""
    towards = grid.directions().reshape(-1, 3)
    basis = np.asarray(real_basis(towards, band_limit_of(len(scene.slow))))
    variance = [np.einsum("tk,tk->t", basis @ own, basis) for own in scene.slow_covariance]
    return np.sqrt(np.maximum(np.stack(variance, axis=-1), 0)).reshape(*grid.shape, -1)


def texels_of(sources: DirectionalSources, grid: LatLongGrid) -> tuple[np.ndarray, np.ndarray]:
    """Find the texel that holds each source."""
    x, y, z = np.asarray(sources.directions, float).T
    height, width = grid.shape
    rows = np.clip(np.arccos(np.clip(z, -1, 1)) / np.pi * height, 0, height - 1).astype(int)
    columns = ((np.arctan2(y, x) / (2 * np.pi)) % 1 * width).astype(int) % width
    return rows, columns
