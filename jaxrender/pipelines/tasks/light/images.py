"""A recovered light as images."""

from typing import NamedTuple

import numpy as np

from jaxrender.harmonics import LatLongGrid, band_limit_of, real_basis
from jaxrender.inverse.blas import one_blas_thread
from jaxrender.inverse.factorization import RecoveredScene, as_points, tied
from jaxrender.lighting import DirectionalSources, positive_light
from jaxrender.shapes import Float, Int

# Rows of the recovered light's image: its texels are smaller than any lobe that showed it.
_ROWS = 128


class LightImages(NamedTuple):
    """A light that is nowhere negative, as latitude-longitude images of radiance.

    ``whole`` is all of it and ``slow`` its slow part; ``sources`` are those that stand beside that.
    ``deviation`` is the standard deviation of the slow part.  Where the photographs tell nothing it
    is that of the light that was expected.
    """

    whole: Float[np.ndarray, "row column channel"]
    slow: Float[np.ndarray, "row column channel"]
    deviation: Float[np.ndarray, "row column channel"]
    sources: DirectionalSources


def light_images(scene: RecoveredScene, sigma: float) -> LightImages:
    """Draw the light; in the whole of it each source is a few texels of the same energy.

    A sum of few degrees falls below zero where the light is dark, and around a source that is too
    bright.  The light shown does not, and has the coefficients that were recovered.  Its channels
    are tied together.  ``sigma`` is the width of the lobe that showed the light.
    """
    scene = tied(scene)
    grid = LatLongGrid(_ROWS, 2 * _ROWS)
    # Small products, one after the other: BLAS's threads would only wait for each other.
    with one_blas_thread():
        light, sources = positive_light(
            scene.slow, scene.sources, scene.total_error, _ROWS, np.pi * sigma**2
        )
    slow = np.asarray(light.radiance)
    whole = slow.copy()
    points = sources if scene.widths is None else as_points(sources, scene.widths)
    rows, columns, shares = texels_of(points, grid)
    energy = shares[..., None] * np.asarray(points.irradiance)
    np.add.at(whole, (rows, columns), energy / grid.weights()[rows, columns, None])
    return LightImages(whole, slow, _deviation(scene, grid), sources)


def _deviation(scene: RecoveredScene, grid: LatLongGrid) -> Float[np.ndarray, "row column channel"]:
    """Carry the covariance of the slow coefficients to every texel."""
    towards = grid.directions().reshape(-1, 3)
    basis = np.asarray(real_basis(towards, band_limit_of(len(scene.slow))))
    count = len(scene.slow)
    seen = scene.covariance[:, :count, :count]
    variance = [np.einsum("tk,tk->t", basis @ own, basis) for own in seen]
    return np.sqrt(np.maximum(np.stack(variance, axis=-1), 0)).reshape(*grid.shape, -1)


class Texels(NamedTuple):
    """The four texels about each source, and the share of its energy that each of them gets."""

    rows: Int[np.ndarray, "4 source"]
    columns: Int[np.ndarray, "4 source"]
    shares: Float[np.ndarray, "4 source"]


def texels_of(sources: DirectionalSources, grid: LatLongGrid) -> Texels:
    """Share out each source so that the middle of its texels is where it stands."""
    x, y, z = np.asarray(sources.directions, float).T
    height, width = grid.shape
    row = np.clip(np.arccos(np.clip(z, -1, 1)) / np.pi * height - 0.5, 0, height - 1)
    column = np.arctan2(y, x) / (2 * np.pi) % 1 * width - 0.5
    top, left = np.floor(row), np.floor(column)
    down, right = row - top, column - left
    rows = np.stack([top, top, top + 1, top + 1]).clip(0, height - 1).astype(int)
    columns = np.stack([left, left + 1] * 2).astype(int) % width
    up, over = np.array([1 - down, down]), np.array([1 - right, right])
    return Texels(rows, columns, (up[:, None] * over).reshape(4, -1))
