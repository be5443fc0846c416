"""Skies as lights.

- The overcast sky: one third at the horizon, 7 pi / 9 of the zenith on a horizontal plane.
- The clear sky: one at the zenith, the CIE's own 1973 constants .91 + 10 exp(-3 X) + .45 cos^2 X,
  brightest at the sun of its elevation, the same to either side of it; Preetham's constants.
- Nothing below the horizon; nodes and image hold the same energy.
- A sun that is no direction, and a turbidity outside the model, are refused.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.lighting import CLEAR_SKIES, ClearSky, OvercastSky, preetham

ZENITH = np.array([1.0, 2.0])
SUN = np.array([0.6, 0.0, 0.8])


def unit_vectors(count):
    vectors = np.random.default_rng(0).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_overcast_radiance_and_irradiance():
    sky = OvercastSky(ZENITH)
    towards = np.array([[0, 0, 1.0], [1.0, 0, 1e-12], [0, 0.6, -0.8]])
    expected = np.array([1, 1 / 3, 0])[:, None] * ZENITH
    np.testing.assert_allclose(sky.radiance(towards), expected, atol=1e-11)
    directions, irradiance = sky.nodes()
    horizontal = np.asarray(directions)[:, 2] @ np.asarray(irradiance)
    np.testing.assert_allclose(horizontal, 7 * np.pi / 9 * ZENITH, rtol=1e-12)


def test_clear_sky_of_1973():
    towards = unit_vectors(200)
    towards = towards[towards[:, 2] > 0.01]

    def indicatrix(cosine):
        return 0.91 + 10 * np.exp(-3 * np.arccos(cosine)) + 0.45 * cosine**2

    def gradation(cosine):
        return 1 - np.exp(-0.32 / cosine)

    expected = indicatrix(towards @ SUN) * gradation(towards[:, 2])
    expected /= indicatrix(SUN[2]) * gradation(1)
    found = ClearSky(SUN, np.ones(1)).radiance(towards)[:, 0]
    # .91 is rounded in the standard: 1 - 10 exp(-3 pi / 2) = .9102.
    np.testing.assert_allclose(found, expected, rtol=3e-4)


@pytest.mark.parametrize("shape", [*CLEAR_SKIES.values(), preetham(2.0)])
def test_shape_of_the_clear_skies(shape):
    sky = ClearSky(3 * SUN, ZENITH, shape)
    towards = unit_vectors(500)
    radiance = np.asarray(sky.radiance(towards))
    assert np.all(radiance[towards[:, 2] < 0] == 0)
    assert np.all(radiance[towards[:, 2] > 0] > 0)
    np.testing.assert_allclose(sky.radiance(np.array([[0, 0, 1.0]]))[0], ZENITH, rtol=1e-12)
    mirrored = sky.radiance(towards * np.array([1, -1, 1]))
    np.testing.assert_allclose(radiance, mirrored, rtol=1e-12)
    azimuth = np.linspace(0.1, 2 * np.pi - 0.1, 50)
    around = np.stack([0.6 * np.cos(azimuth), 0.6 * np.sin(azimuth), np.full(50, 0.8)], axis=1)
    assert np.all(np.asarray(sky.radiance(SUN[None])) > np.asarray(sky.radiance(around)))


def test_preetham_at_turbidity_two():
    found = preetham(2.0)
    np.testing.assert_allclose(found[:5], [-1.1056, -0.2833, 5.2797, -2.3359, 0.2363], atol=1e-12)
    assert found.offset == 0


def test_nodes_and_image_agree():
    sky = ClearSky(SUN, ZENITH)
    from_nodes = np.asarray(sky.nodes().irradiance).sum(axis=0)
    image = sky.to_environment(256)
    from_image = np.asarray(image.nodes().irradiance).sum(axis=0)
    np.testing.assert_allclose(from_nodes, from_image, rtol=2e-3)


def test_gradient_is_finite_at_the_sun():
    def at_the_sun(sun):
        return ClearSky(sun, jnp.ones(1)).radiance(jnp.asarray(SUN)[None])[0, 0]

    assert np.all(np.isfinite(jax.grad(at_the_sun)(jnp.asarray(SUN))))


def test_refusals():
    for sun in ([0, 0, -1.0], [0, 0, 0.0], [np.nan, 0, 1]):
        with pytest.raises(ValueError, match="at or above the horizon"):
            ClearSky(np.array(sun), ZENITH)
    with pytest.raises(ValueError, match=r"turbidity=1\.0: the model holds from 1\.8"):
        preetham(1.0)
