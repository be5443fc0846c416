"""What every model keeps, and what each one promises.

Pinned down: reciprocity to rounding where stated, its violation where stated not; energy bounded by
1 where stated, more than 1 where the promise is withheld for a reason; turning both directions
changes nothing where isotropic and something where not; nothing below the horizon, for whatever
rank of directions; float32 agrees with float64.  Derivatives are on the page of gradients.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brdf_problems import (
    KD,
    KS,
    MODELS,
    NAMES,
    PROMISED,
    direction,
    single_precision,
    upper_directions,
)

from jaxrender.brdf import (
    BRDF,
    BRDFS,
    BlinnPhong,
    OrenNayar,
    Phong,
    TorranceSparrow,
    Ward,
    directional_albedo,
    max_albedo,
    reciprocity_error,
)
from jaxrender.brdf.distributions import DISTRIBUTIONS
from jaxrender.brdf.masking import FACET_MASKINGS
from jaxrender.geometry import Components

ROUNDING = 1e-10  # of exponents of up to some hundreds
ENERGY = 1e-3  # the quadrature's error with few nodes
evaluate = eqx.filter_jit(BRDF.evaluate)


def test_every_registered_model_is_tried():
    assert {*BRDFS} <= {*MODELS}


@pytest.mark.parametrize("name", PROMISED)
def test_promises_are_those_written_down(name):
    brdf, *promises = PROMISED[name]
    assert [brdf.reciprocal, brdf.conserves_energy, brdf.isotropic] == promises


@pytest.mark.parametrize("name", NAMES)
def test_reciprocity_where_stated_alone(name):
    brdf = MODELS[name]
    error = reciprocity_error(brdf, 64)
    assert error < ROUNDING if brdf.reciprocal else error > 0.01


@pytest.mark.parametrize("name", [name for name in NAMES if MODELS[name].conserves_energy])
def test_energy_is_conserved_where_stated(name):
    cosines = (1.0, 0.6, 0.2, 0.03)
    assert max_albedo(MODELS[name], cosines, azimuths=3, nodes=32) < 1 + ENERGY


WHITE, BLACK = np.ones(1), np.zeros(1)


@pytest.mark.parametrize("roughness", [0.1, 0.4, 1.0])
@pytest.mark.parametrize("masking", [name for name in FACET_MASKINGS if name != "none"])
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_white_facets_lose_no_more_than_what_bounces_twice(distribution, masking, roughness):
    brdf = TorranceSparrow(BLACK, WHITE, jnp.asarray(roughness), None, None, distribution, masking)
    assert brdf.conserves_energy
    albedo = directional_albedo(brdf, [1.0, 0.5, 0.1], nodes=64)
    assert np.all(albedo < 1 + ENERGY)
    assert np.all(albedo > (0.85 if roughness == 0.1 else 0.3))


@pytest.mark.parametrize(
    "brdf",
    [
        Phong(BLACK, WHITE, 20.0),
        TorranceSparrow(BLACK, WHITE, 0.3, None, masking="none"),
        Ward(BLACK, WHITE, 0.2, None, "duer"),
        OrenNayar(WHITE / np.pi, 0.3),
    ],
)
def test_energy_is_made_where_the_promise_is_withheld(brdf):
    assert not brdf.conserves_energy
    assert max_albedo(brdf, [0.02], nodes=48) > 1.02


def test_promise_of_energy_depends_on_the_amplitudes():
    assert BlinnPhong(np.full(1, 0.1), np.full(1, 0.6), 10.0).conserves_energy
    assert not BlinnPhong(np.full(1, 0.1), np.full(1, 0.8), 10.0).conserves_energy
    assert not BlinnPhong(np.full(1, -0.1), np.full(1, 0.8), 10.0).conserves_energy
    assert OrenNayar(np.full(1, 0.9 / np.pi), 0.3).conserves_energy


@pytest.mark.parametrize("name", NAMES)
def test_turning_about_the_normal(name):
    brdf = MODELS[name]
    a, b = upper_directions(64, 0), upper_directions(64, 1)
    turn = np.array([[np.cos(1), -np.sin(1), 0], [np.sin(1), np.cos(1), 0], [0, 0, 1]])
    values, turned = evaluate(brdf, a, b), evaluate(brdf, a @ turn.T, b @ turn.T)
    change = np.max(np.abs(np.asarray(turned) / np.asarray(values) - 1))
    assert change < ROUNDING if brdf.isotropic else change > 0.01


@pytest.mark.parametrize("name", NAMES)
def test_nothing_below_the_horizon_and_any_rank(name):
    brdf = MODELS[name]
    up, down = direction(0.8, 0.3), direction(-0.8, 0.3)
    many = np.stack([up, down])
    values = np.asarray(evaluate(brdf, many, np.stack([down, up])))
    np.testing.assert_array_equal(values, np.zeros((2, 2)))
    # A light's nodes against one exit direction is how the integral calls a model.
    mixed = np.asarray(evaluate(brdf, many, np.broadcast_to(up, many.shape)))
    assert np.all(mixed[0] > 0)
    lobes = eqx.filter_jit(type(brdf).transfer)(brdf, *_components(many, up))
    summed = np.stack(lobes, axis=-1) @ np.asarray(brdf.amplitudes)
    np.testing.assert_allclose(summed[0], mixed[0] * up[2], rtol=ROUNDING)


def _components(nodes, outgoing):
    return Components.of(nodes), Components.of(outgoing)


@pytest.mark.parametrize("name", NAMES)
def test_single_precision_agrees_with_double(name):
    brdf = MODELS[name]
    a, b = upper_directions(64, 5), upper_directions(64, 6)
    double = np.asarray(evaluate(brdf, a, b))
    single = evaluate(
        jax.tree.map(single_precision, brdf), a.astype(np.float32), b.astype(np.float32)
    )
    assert single.dtype == jnp.float32
    # 6e-8 in a component is some 1e-5 of exponents of up to a hundred.
    np.testing.assert_allclose(single, double, rtol=1e-3, atol=1e-6)


def test_a_model_is_no_constant_of_the_compiled_program():
    """Another roughness must not be compiled anew: parameters are arrays, not static numbers."""
    count = 0

    @eqx.filter_jit
    def value(brdf):
        nonlocal count
        count += 1
        return brdf.evaluate(upper_directions(2, 0), upper_directions(2, 1))

    for roughness in (0.1, 0.2, 0.3):
        value(TorranceSparrow(KD, KS, roughness, 1.5))
    assert count == 1
