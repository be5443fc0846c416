"""Light that is nowhere negative, from measured coefficients.

- A light that is positive as it is stays as it is; a channel without light stays dark.
- Of sources seen through few degrees, whose sum rings below zero, the positive part has the
  coefficients within their errors, where cutting off is out by many.
- What is least known gives way: a coefficient with a large error takes up the change.
- A source gives way where slow light makes up for it; else it keeps its energy.
- Coefficients that no light can have are met as well as their errors ask for.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.harmonics import LatLongGrid, analyse, degrees, real_basis, synthesise
from jaxrender.lighting import DirectionalSources, positive_light, positive_part_of

LIMIT = 8
GRID = LatLongGrid(96, 192)
DEGREE = degrees(LIMIT)
SOURCES = np.array([[0.3, -0.5, 0.81], [-0.8, 0.2, 0.1]])
SOURCES /= np.linalg.norm(SOURCES, axis=1, keepdims=True)
BREADTH = 0.02


def ringing(background=0.02):
    """Two broad sources over a dark sky, to degree 8, in two channels."""
    basis = np.asarray(real_basis(jnp.asarray(SOURCES), LIMIT))
    found = basis.T @ np.array([[1.0, 0.5], [0.4, 0.9]])
    found *= np.exp(-BREADTH * DEGREE * (DEGREE + 1))[:, None]
    found[0] += background * np.sqrt(4 * np.pi)
    return found


def coefficients_of(light):
    return np.asarray(analyse(GRID, jnp.asarray(np.maximum(light, 0)), LIMIT))


def picture(coefficients):
    return np.asarray(synthesise(GRID, jnp.asarray(coefficients)))


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def test_positive_light_stays():
    coefficients = 0.02 * ringing()
    coefficients[0] += np.sqrt(4 * np.pi)
    assert picture(coefficients).min() > 0
    errors = np.full_like(coefficients, 1e-3)
    np.testing.assert_allclose(positive_part_of(coefficients, errors), coefficients, atol=1e-7)


def test_a_dark_channel_stays_dark():
    coefficients = ringing()
    coefficients[:, 1] = 0
    found = positive_part_of(coefficients, np.full_like(coefficients, 1e-3))
    np.testing.assert_array_equal(found[:, 1], 0)


@pytest.mark.parametrize("error", [1e-3, 1e-2])
def test_the_positive_part_has_the_coefficients_that_were_measured(error):
    coefficients = ringing()
    errors = np.full_like(coefficients, error * coefficients[0].mean())
    cut = (coefficients_of(picture(coefficients)) - coefficients) / errors
    kept = coefficients_of(picture(positive_part_of(coefficients, errors))) - coefficients
    assert rms(cut[DEGREE <= 2]) > 3
    assert rms(kept / errors) < 0.5
    # Cutting off brightens the sky; no picture of a diffuse body is to be brighter.
    assert np.all(np.abs(kept[0]) < 0.02 * (errors * cut)[0])


def test_what_is_least_known_gives_way():
    coefficients = ringing()
    errors = np.full_like(coefficients, 1e-3)
    errors[DEGREE == 3] = 1.0
    coefficients[DEGREE == 3] = 0
    off = coefficients_of(picture(positive_part_of(coefficients, errors))) - coefficients
    assert rms(off[DEGREE == 3]) > 20 * rms(off[DEGREE != 3])


def test_what_no_light_can_have_is_met_by_its_errors():
    """More of degree 1 than of degree 0: the better known of both is kept."""
    coefficients = np.zeros((4, 1))
    coefficients[0], coefficients[3] = 1, 3
    for sure, unsure in ((0, 3), (3, 0)):
        errors = np.full((4, 1), 0.01)
        errors[unsure] = 1.0
        series = positive_part_of(coefficients, errors)
        light = np.maximum(np.asarray(synthesise(GRID, jnp.asarray(series))), 0)
        off = np.abs(np.asarray(analyse(GRID, jnp.asarray(light), 1)) - coefficients)[:, 0]
        assert np.all(np.isfinite(series))
        assert off[sure] < 0.1 * off[unsure]


def test_without_errors_all_count_alike():
    coefficients = ringing()
    alike = np.tile(0.01 * coefficients[0], (len(coefficients), 1))
    np.testing.assert_array_equal(
        positive_part_of(coefficients), positive_part_of(coefficients, alike)
    )


def test_a_source_gives_way_where_slow_light_makes_up_for_it():
    """Slow light is negative about a source of too much energy: both together are what is known."""
    towards = np.asarray(real_basis(jnp.asarray(SOURCES[:1]), LIMIT))
    dip = np.exp(-BREADTH * DEGREE * (DEGREE + 1))[:, None] * towards.T
    slow = np.array([[0.4, 0.3]]) * np.sqrt(4 * np.pi) * (DEGREE == 0)[:, None] - 0.3 * dip
    energies = np.array([[1.0, 0.8]])
    total = slow + towards.T @ energies
    assert picture(slow).min() < -0.1
    errors = np.full_like(slow, 1e-3)
    sources = DirectionalSources(SOURCES[:1], energies)
    image, beside = positive_light(slow, sources, errors, 96, 0.05)
    kept = np.asarray(beside.irradiance)
    assert np.all((kept < 0.95 * energies) & (kept > 0))
    np.testing.assert_allclose(beside.directions, SOURCES[:1], atol=1e-6)
    found = coefficients_of(np.asarray(image.radiance)) + towards.T @ kept
    assert rms((found - total) / errors) < 1
    # Made positive alone, slow light keeps to its own coefficients, and is out by many errors.
    alone = coefficients_of(picture(positive_part_of(slow, 30 * errors))) + towards.T @ energies
    assert rms((alone - total) / errors) > 5


def test_light_that_is_positive_keeps_its_sources():
    slow = np.sqrt(4 * np.pi) * (DEGREE == 0)[:, None] * np.array([[0.4, 0.3]])
    sources = DirectionalSources(SOURCES, np.array([[1.0, 0.8], [0.2, 0.3]]))
    image, beside = positive_light(slow, sources, np.full_like(slow, 1e-3), 96, 0.05)
    np.testing.assert_allclose(beside.irradiance, sources.irradiance, rtol=1e-4)
    np.testing.assert_allclose(image.radiance, picture(slow), rtol=1e-4)
