"""Facets of any smooth distribution: their area, what hides them, and their Fresnel curve."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxrender.brdf import FreeDistribution, FreeFacets
from jaxrender.brdf.distributions import TrowbridgeReitz
from jaxrender.brdf.fresnel import normalised_fresnel
from jaxrender.geometry import Components

GREY = np.full(3, 0.1)
ODD = FreeDistribution(0.3, 3.1, (-0.5, 0.3, 0.2))
LONG_TAIL = FreeDistribution(0.2, 1.8, (0.3, 0.0, -0.2))


def tilted(angles) -> Components:
    angles = jnp.asarray(angles, float)
    return Components(jnp.sin(angles), jnp.zeros_like(angles), jnp.cos(angles))


@pytest.mark.parametrize("sigma", [0.05, 0.3, 1.0])
def test_without_waves_it_is_ggx(sigma):
    directions = tilted(np.deg2rad([1, 10, 30, 50, 70, 80, 88, 89.5]))
    ours, ggx = FreeDistribution(sigma, 2.0, (0.0,) * 3), TrowbridgeReitz(sigma)
    assert_allclose(ours.density(directions), ggx.density(directions), rtol=1e-12)
    facing = (1 + one.smith_lambda(directions) for one in (ours, ggx))
    assert_allclose(*facing, rtol=3e-5)


def test_its_width_is_where_it_falls_to_a_part_of_its_peak():
    """A steep tail makes it narrow: Beckmann's of .15 falls to 1 / e where tan t is .15."""
    assert float(FreeDistribution(0.2).width) == pytest.approx(0.2, rel=0.03)
    beckmann = FreeDistribution(0.15 * np.sqrt(50), 50.0)
    assert float(beckmann.width) == pytest.approx(0.15 / np.sqrt(np.sqrt(np.e) - 1), rel=0.03)
    assert float(FreeFacets(GREY, GREY, 1.0, 50.0).width) < 0.2


@pytest.mark.parametrize("facets", [ODD, LONG_TAIL])
def test_the_facets_cover_the_surface_and_hide_one_another_by_the_integral(facets):
    """Both by a quadrature of many nodes over the tilt, and over the azimuth."""
    nodes, weights = np.polynomial.legendre.leggauss(800)
    # The cube of the node is dense near the normal, where a highlight is.
    share = (nodes + 1) / 2
    tilt, weights = np.pi / 2 * share**3, weights / 2 * np.pi / 2 * 3 * share**2
    density = np.asarray(facets.density(tilted(tilt))) * np.sin(tilt) * weights
    assert_allclose(2 * np.pi * np.sum(density * np.cos(tilt)), 1, rtol=1e-5)
    azimuth = (np.arange(360) + 0.5) / 360 * 2 * np.pi
    for angle in (0.3, 1.0, 1.4):
        along = np.sin(angle) * np.sin(tilt)[:, None] * np.cos(azimuth)
        facing = np.maximum(np.cos(angle) * np.cos(tilt)[:, None] + along, 0).mean(axis=1)
        seen = 2 * np.pi * np.sum(density * facing) / np.cos(angle)
        assert_allclose(1 + facets.smith_lambda(tilted(angle)), seen, rtol=5e-4)


def test_the_fresnel_curve_is_that_of_glass_unless_it_is_told_otherwise():
    cosines = jnp.cos(jnp.deg2rad(jnp.arange(0, 91, 3.0)))
    found = FreeFacets(GREY, GREY, 0.2).fresnel_ratio(cosines)
    assert_allclose(found, normalised_fresnel(1.5, cosines), rtol=1e-5)


def test_the_fresnel_curve_passes_through_its_knots_and_only_rises_beyond_45_degrees():
    rng = np.random.default_rng(0)
    for _ in range(20):
        first, rises = rng.uniform(0.3, 3), 1 + 6 * rng.uniform(size=3) ** 3
        material = FreeFacets(GREY, GREY, 0.2, 2.0, 0, 0, 0, first, *rises)
        knots = jnp.cos(jnp.deg2rad(jnp.array([0.0, 45, 60, 75, 90])))
        expected = np.cumprod([1, first, *rises])
        assert_allclose(material.fresnel_ratio(knots), expected, rtol=1e-4)
        beyond = np.asarray(material.fresnel_ratio(jnp.cos(jnp.deg2rad(jnp.arange(45, 90.1, 0.5)))))
        assert np.all(np.diff(beyond) >= -1e-9 * beyond[1:])
    level = FreeFacets(GREY, GREY, 0.2, 2.0, 0, 0, 0, 1.0, 1.0, 1.0, 1.0)
    assert_allclose(level.fresnel_ratio(jnp.linspace(0, 1, 50)), 1)


@pytest.mark.parametrize(
    ("numbers", "named"),
    [
        ({"sigma": 0.0}, "sigma"),
        ({"sigma": 0.2, "tail": 1.4}, "tail"),
        ({"sigma": 0.2, "rise_75": 0.9}, "rise_75"),
    ],
)
def test_numbers_out_of_range_are_refused_by_name(numbers, named):
    with pytest.raises(ValueError, match=f"{named}="):
        FreeFacets(GREY, GREY, **numbers)
