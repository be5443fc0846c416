"""Pictures of a recovered light.

- Where slow light rings below zero its picture is no brighter than the light found.
- The texels of a source have their middle where it stands.
"""

import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics import LatLongGrid, analyse, degrees, real_basis
from jaxrender.inverse.factorization import RecoveredScene
from jaxrender.lighting import DirectionalSources
from jaxrender.pipelines.tasks.light import light_images
from jaxrender.pipelines.tasks.light.images import texels_of


def test_the_image_of_a_dark_sky_is_no_brighter_than_the_light_found():
    """A broad source to degree 3 rings below zero: merely cut off, it is out by 27 errors."""
    towards = jnp.array([[0.0, 0.6, 0.8]])
    fading = np.exp(-0.05 * degrees(3) * (degrees(3) + 1))[:, None]
    slow = fading * np.asarray(real_basis(towards, 3)).T * np.array([[1.0, 0.8, 0.6]])
    slow[0] += 0.05
    error = np.full_like(slow, 0.01 * slow[0].mean())
    covariance = np.stack([np.diag(column**2) for column in error.T])
    none = DirectionalSources.none()
    scene = RecoveredScene(slow, none, covariance, np.zeros(0), np.ones(4))
    image = light_images(scene, 0.2).slow
    assert image.min() >= 0
    off = np.asarray(analyse(LatLongGrid(*image.shape[:2]), jnp.asarray(image), 3)) - slow
    assert np.max(np.abs(off) / error) < 1.5


def test_the_middle_of_a_sources_texels_is_where_it_stands():
    rng = np.random.default_rng(0)
    drawn = rng.normal(size=(200, 3)) * [1, 1, 0.6]
    poles = np.array([[0, 0, 1.0], [0, 0, -1], [1e-3, 0, 1], [1.0, -1e-6, 0]])
    sources = DirectionalSources(np.concatenate([drawn, poles]), np.ones((204, 3)))
    grid = LatLongGrid(64, 128)
    rows, columns, shares = texels_of(sources, grid)
    np.testing.assert_allclose(shares.sum(axis=0), 1, atol=1e-12)
    assert shares.min() >= 0
    middle = np.einsum("ks,ksi->si", shares, grid.directions()[rows, columns])
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    away = np.linalg.norm(middle - np.asarray(sources.directions), axis=1)
    # A texel is 2.8 degrees wide.
    assert np.all(away[np.abs(middle[:, 2]) < 0.8] < np.radians(0.05))
    assert np.all(away < np.radians(1.5))
