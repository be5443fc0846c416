"""The dual model as a table over roughness.

Pinned down: the columns are those of ``dual_columns`` over the whole range of sigma and mu, for
every variant, with lights of single frames; so are the derivatives; padding with dark sources
changes nothing; the spline reproduces cubics, its weights are a partition of unity; the polynomial
over mu is one, and of one mu alone there is one node; a lobe that fades with mu is followed.
"""

from functools import lru_cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reflection_problems import lit_room, microfacet, random_samples, unit_vectors

from jaxrender import reflection
from jaxrender.brdf import TorranceSparrow
from jaxrender.geometry import SurfaceSamples
from jaxrender.lighting import DirectionalSources, candidates, take
from jaxrender.reflection import DualLight, FrameNodes, dual_light, roughness_table
from jaxrender.reflection.knots import ChebyshevNodes, KnotRange

TABLE = 1e-4  # what the module promises, relative to the brightest sample
SIGMA_ALONE = 2e-5  # where the table has no knots over mu: 24 knots over a factor of 3 in sigma
dual_columns = eqx.filter_jit(reflection.dual_columns)

RNG = np.random.default_rng(0)
SAMPLES = random_samples(24)
SOURCES = DirectionalSources(unit_vectors(2, 1), RNG.uniform(0.5, 2, (2, 3)))
FRAMES = FrameNodes(
    np.stack([unit_vectors(2, 4), unit_vectors(2, 5)]),
    RNG.uniform(0, 1, (2, 2, 3)),
    np.arange(24) % 2,
)
ROOM = lit_room(32, finest=128)
LIGHT = dual_light(take(ROOM, candidates(ROOM, 0.15), 20, 0.15), SOURCES, 12, FRAMES)
RANGE = (0.1, 0.3)
VARIANTS = [
    ("exit", "none", 1.5),
    pytest.param(("half", "smith", 1.5), marks=pytest.mark.slow),
    ("exit", "none", None),
]


@lru_cache
def table_of(fresnel, masking, mu):
    return roughness_table(microfacet(0.2, mu, fresnel, masking), SAMPLES, LIGHT, RANGE)


def scalar(value):
    return None if value is None else jnp.asarray(value)


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_table_is_the_dual_model(variant):
    fresnel, masking, mu = variant
    table = table_of(*variant)
    specular = eqx.filter_jit(table.specular)
    for sigma in (0.1, 0.1037, 0.2241, 0.3):
        for index in (None,) if mu is None else (1.1, 1.33, 4.0):
            brdf = microfacet(scalar(sigma), scalar(index), fresnel, masking)
            columns = np.asarray(dual_columns(brdf, SAMPLES, LIGHT))
            found = np.asarray(specular(scalar(sigma), scalar(index)))
            tolerance = TABLE if fresnel == "half" else SIGMA_ALONE
            assert np.abs(found - columns[:, 1]).max() < tolerance * columns[:, 1].max()
            np.testing.assert_allclose(table.diffuse, columns[:, 0], rtol=1e-12)


@pytest.mark.parametrize(
    "variant", [("exit", "none"), pytest.param(("half", "smith"), marks=pytest.mark.slow)]
)
def test_derivatives_are_those_of_the_dual_model(variant):
    table = table_of(*variant, 1.5)
    sigma, mu = jnp.asarray(0.17), jnp.asarray(1.6)

    def column(sigma, mu):
        return dual_columns(microfacet(sigma, mu, *variant), SAMPLES, LIGHT)[:, 1]

    step = 1e-4  # truncation 1e-6 relative
    numeric = (
        (column(sigma + step, mu) - column(sigma - step, mu)) / (2 * step),
        (column(sigma, mu + step) - column(sigma, mu - step)) / (2 * step),
    )
    found = jax.jit(jax.jacfwd(table.specular, (0, 1)))(sigma, mu)
    for exact, slope in zip(numeric, found):
        # The derivative of a cubic spline loses one order: step / 3 of it.
        assert np.abs(slope - exact).max() < 1e-3 * np.abs(exact).max()


def test_the_transfer_is_chosen_by_name():
    table = roughness_table(microfacet(0.2), SAMPLES, LIGHT, RANGE, transfer="gaussian")
    brdf = microfacet(jnp.asarray(0.2), jnp.asarray(1.5))
    expected = np.asarray(dual_columns(brdf, SAMPLES, LIGHT, "gaussian"))[:, 1]
    found = np.asarray(table.specular(jnp.asarray(0.2), jnp.asarray(1.5)))
    assert np.abs(found - expected).max() < TABLE * expected.max()


@pytest.mark.parametrize("count", [0, 65, 300])
def test_blocks_of_sources_filled_up_with_dark_ones_do_not_show(count):
    sources = DirectionalSources(unit_vectors(count, 7), np.ones((count, 1)))
    light = DualLight(np.ones((4, 1)), sources)
    table = roughness_table(microfacet(0.2, channels=1), SAMPLES, light, RANGE)
    columns = dual_columns(microfacet(0.2, channels=1), SAMPLES, light)
    found = table.specular(jnp.asarray(0.2), jnp.asarray(1.5))
    np.testing.assert_allclose(found, columns[:, 1], atol=TABLE * float(columns[:, 1].max()))
    np.testing.assert_allclose(table.diffuse, columns[:, 0], rtol=1e-12, atol=1e-12)


def test_the_spline_follows_a_smooth_curve():
    """exp over [0, 1], and lines exactly.

    The natural ends err by step^2 / 6 times the curvature, and that falls by .27 a knot: 5e-5 after
    three knots.
    """
    knots = KnotRange.over(0.0, 1.0, 17)
    for curve, bound in ((np.exp, 5e-5), (lambda x: 2 * x - 1, 1e-14)):
        coefficients = knots.spline_from_values() @ curve(knots.values())
        for x in np.linspace(0, 1, 23):
            first, weights = knots.locate(jnp.asarray(x))
            assert float(weights.sum()) == pytest.approx(1, rel=1e-14)
            value = coefficients[int(first) : int(first) + 4] @ np.asarray(weights)
            assert value == pytest.approx(curve(x), abs=bound)


def test_the_polynomial_over_mu_is_one():
    """It passes through its nodes, and is what it is of a polynomial of that degree anywhere."""
    nodes = ChebyshevNodes.over(np.log(0.1), np.log(3.0), 6)
    values = nodes.values()
    assert np.log(0.1) < values.min() < values.max() < np.log(3.0)
    for x in (*values, -3.0, 0.2, 1.5):
        weights = np.asarray(nodes.weights(jnp.asarray(x)))
        assert weights @ values**5 == pytest.approx(x**5, rel=1e-10, abs=1e-10)
    np.testing.assert_allclose(nodes.weights(jnp.asarray(values[2])), np.eye(6)[2], atol=1e-12)


@pytest.mark.parametrize("mu", [1.02, 1.1, 6.0])
def test_a_lobe_that_fades_with_its_index_is_followed(mu):
    """With Fresnel's factor itself the column falls by four decades from 6 to 1.02."""
    brdf = TorranceSparrow(np.ones(3), np.ones(3), jnp.asarray(0.2), jnp.asarray(mu))
    expected = np.asarray(dual_columns(brdf, SAMPLES, LIGHT))[:, 1]
    found = np.asarray(faded().specular(jnp.asarray(0.2), jnp.asarray(mu)))
    assert np.abs(found - expected).max() < 3 * TABLE * expected.max()


@lru_cache
def faded():
    brdf = TorranceSparrow(np.ones(3), np.ones(3), 0.2, 1.5)
    return roughness_table(brdf, SAMPLES, LIGHT, RANGE)


@pytest.mark.slow
def test_a_table_of_one_mu_is_that_of_all_there():
    """Fewer rows, the same column; the ends of all that is searched hold, too."""
    variant, sigma = ("half", "smith"), jnp.asarray(0.17)
    for mu in (1.02, 1.5, 6.0):
        brdf = microfacet(jnp.asarray(0.2), jnp.asarray(mu), *variant)
        alone = roughness_table(brdf, SAMPLES, LIGHT, RANGE, (mu, mu))
        assert alone.spline.shape[0] == 1
        one, every = (
            np.asarray(table.specular(sigma, jnp.asarray(mu)))
            for table in (alone, table_of(*variant, 1.5))
        )
        assert np.abs(one - every).max() < 5 * TABLE * every.max()


def test_single_precision():
    samples = SurfaceSamples(*(a.astype(np.float32) for a in SAMPLES))
    single = roughness_table(microfacet(0.2), samples, LIGHT, RANGE)
    double = table_of("exit", "none", 1.5)
    found = single.specular(jnp.float32(0.15), jnp.float32(1.5))
    assert single.diffuse.dtype == found.dtype == jnp.float32
    expected = np.asarray(double.specular(jnp.asarray(0.15), jnp.asarray(1.5)))
    assert np.abs(np.asarray(found) - expected).max() < 5e-4 * expected.max()
