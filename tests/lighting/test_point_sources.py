"""Point sources as places see them.

- Irradiance is intensity over the squared distance, place by place (L 2.10), as of a point light.
- Far away they are directional sources; a place at a source is lit by nothing.
- They have no nodes of their own, and what is no source is refused.
- A config states them, and beside other light they add up.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.lighting import (
    DirectionalSources,
    IsotropicIntensity,
    LightSum,
    PointLight,
    PointSources,
    light_of,
)

PLACES = np.array([[2.0, 0.0, 1.0], [-1.0, 3.0, 0.5]])
INTENSITY = np.array([[4.0, 3.0, 2.0], [1.0, 1.0, 5.0]])
LAMPS = PointSources(PLACES, INTENSITY)
POINTS = np.random.default_rng(0).uniform(-0.5, 0.5, size=(7, 3))


def test_irradiance_falls_with_the_square_of_the_distance():
    directions, irradiance = (np.asarray(part) for part in LAMPS.at(POINTS))
    for point, towards, energy in zip(POINTS, directions, irradiance, strict=True):
        for k in range(2):
            arrow = PLACES[k] - point
            distance = np.linalg.norm(arrow)
            np.testing.assert_allclose(towards[k], arrow / distance, rtol=1e-12)
            np.testing.assert_allclose(energy[k], INTENSITY[k] / distance**2, rtol=1e-12)
        seen = LAMPS.seen_from(point)
        np.testing.assert_allclose(seen.directions, towards, rtol=1e-12)
        np.testing.assert_allclose(seen.irradiance, energy, rtol=1e-12)


def test_it_is_a_point_light_of_even_intensity():
    directions, irradiance = LAMPS.at(POINTS)
    for k in range(2):
        twin = PointLight(PLACES[k], IsotropicIntensity(INTENSITY[k])).arriving(POINTS)
        np.testing.assert_allclose(directions[:, k], twin.directions, rtol=1e-12)
        energy = twin.intensity / twin.distance[:, None] ** 2
        np.testing.assert_allclose(irradiance[:, k], energy, rtol=1e-12)


def test_far_away_they_are_directional():
    far = PointSources(1e6 * PLACES, 1e12 * INTENSITY)
    directions, irradiance = far.at(POINTS)
    expected = DirectionalSources(PLACES, INTENSITY / np.sum(PLACES**2, axis=1, keepdims=True))
    for towards, energy in zip(directions, irradiance):
        np.testing.assert_allclose(towards, expected.directions, atol=2e-6)
        np.testing.assert_allclose(energy, expected.irradiance, rtol=4e-6)


def test_a_place_at_a_source_is_lit_by_the_others():
    directions, irradiance = LAMPS.at(PLACES[:1])
    np.testing.assert_array_equal(irradiance[0, 0], 0)
    np.testing.assert_array_equal(directions[0, 0], 0)
    assert np.all(np.asarray(irradiance[0, 1]) > 0)
    with pytest.raises(ValueError, match=r"a source lies at \[2\.0, 0\.0, 1\.0\] itself"):
        LAMPS.seen_from(PLACES[0])


def test_places_are_differentiable():
    def lit(places):
        return jnp.sum(PointSources(places, INTENSITY).at(POINTS).irradiance)

    found, step = jax.grad(lit)(jnp.asarray(PLACES)), 1e-6
    for k in np.ndindex(PLACES.shape):
        moved = np.zeros_like(PLACES)
        moved[k] = step
        difference = (lit(PLACES + moved) - lit(PLACES - moved)) / (2 * step)
        np.testing.assert_allclose(found[k], difference, rtol=1e-6)


def test_a_config_states_them():
    entries = [{"position": p, "intensity": i} for p, i in zip(PLACES, INTENSITY)]
    made = light_of("point", entries)
    np.testing.assert_allclose(made.positions, PLACES)
    np.testing.assert_allclose(made.intensity, INTENSITY)


def test_they_have_no_nodes():
    other = DirectionalSources(np.eye(3)[:1], np.ones((1, 3)))
    for light in (LAMPS, LAMPS + other, LightSum((other, LAMPS))):
        with pytest.raises(ValueError, match=r"point sources lie .* use seen_from\(place\)"):
            light.nodes()
    assert (other + LAMPS).parts == (other, LAMPS)


@pytest.mark.parametrize(
    ("places", "intensity", "message"),
    [
        (PLACES, INTENSITY[:1], "2 positions but 1 intensities"),
        (PLACES * [[1], [np.nan]], INTENSITY, "point source 1 has the position .* finite"),
        (PLACES, INTENSITY * [[1], [-1]], "point source 1 has the intensity .* 0 or more"),
        (PLACES, INTENSITY * [[np.inf], [1]], "point source 0 has the intensity .* finite"),
    ],
)
def test_what_is_no_source_is_refused(places, intensity, message):
    with pytest.raises(ValueError, match=message):
        PointSources(places, intensity)
