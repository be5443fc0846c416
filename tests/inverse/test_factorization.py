"""Light and material both unknown.

- Material and source of a small scene are found from photographs by the exact integral, with noise,
  within a few of the stated standard errors.
- Pursuit picks the source that is there; on noise alone it finds nothing worth adding.
- Two sources found for one become one; an idle source is dropped.
- Gauges: products of light and reflectance never change; one ks for all channels of a dielectric;
  light of one mean colour over a metal.
- With a known material the last steps end at the light that fits best.
- Completed by what it lacks, the dual model is the integral.
- Too few samples and unknown gauges are refused.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import mu_unknown, sigma_unknown
from painted_ball import (
    AREA,
    BAND_LIMIT,
    ENERGY,
    MU,
    PAINT,
    SIGMA,
    SOURCE,
    SOURCES,
    photographed,
    task_of,
    with_sources,
)

from jaxrender.geometry import fibonacci_sphere
from jaxrender.inverse import Outcome
from jaxrender.inverse.factorization import FactorSettings, Known, factorize
from jaxrender.inverse.factorization.account import account_of
from jaxrender.inverse.factorization.blocks import in_blocks
from jaxrender.inverse.factorization.correction import change, corrected
from jaxrender.inverse.factorization.gauges import GAUGES
from jaxrender.inverse.factorization.projection import reduced_system
from jaxrender.inverse.factorization.pursuit import pursue
from jaxrender.inverse.factorization.response import Guess
from jaxrender.inverse.factorization.rounds import (
    _material_moved,
    settle,
    with_neighbours_merged,
    without_idle_sources,
)
from jaxrender.inverse.factorization.sources import add_sources
from jaxrender.inverse.factorization.state import (
    begin,
    descend,
    free_unknowns,
    measured,
    response_of,
)
from jaxrender.reflection import reflect_slow_light


@pytest.fixture(scope="module")
def photographs():
    return photographed()


@pytest.fixture(scope="module")
def found(photographs):
    settings = FactorSettings(BAND_LIMIT, SOURCES)
    return factorize(photographs, PAINT, settings)


@pytest.mark.slow
def test_material_and_source_are_found(found):
    total = PAINT.kd + PAINT.ks
    value, error = found.parameters.value, found.parameters.standard_error
    for name, truth in (("kd", PAINT.kd / total), ("ks", PAINT.ks / total), ("sigma", 0.15)):
        off = np.abs(value.of(name) - truth) / error.of(name)
        assert np.all(off < 4), name
        assert np.all(error.of(name) < 0.01), name
    assert abs(value.of("mu") - 1.38) < 4 * error.of("mu") < 0.02
    assert found.relative_rms == pytest.approx(0.01, rel=0.1)
    # The source: within a twentieth of a degree, its energy as its error says, in the gauge.
    assert found.scene.sources.directions[0] @ SOURCE > np.cos(np.radians(0.05))
    off = found.scene.sources.irradiance[0] - ENERGY * total
    assert np.all(np.abs(off) < 4 * found.scene.energy_error[0])
    assert np.all(found.scene.energy_error[0] < 0.01 * ENERGY)
    assert found.outcome.value == "converged"
    assert all(found.identifiable.values())


@pytest.mark.slow
def test_the_light_is_found(found):
    """The first nine coefficients, source included, by a quadrature that knows of no fit."""
    from jaxrender.harmonics import LatLongGrid, analyse, real_basis

    grid = LatLongGrid(64, 128)
    image = AREA.radiance(jnp.asarray(grid.directions().reshape(-1, 3))).reshape(64, 128, 3)
    source = np.asarray(real_basis(jnp.asarray(SOURCE[None]), 2)).T * ENERGY
    truth = (np.asarray(analyse(grid, image, 2)) + source) * (PAINT.kd + PAINT.ks)
    np.testing.assert_allclose(found.scene.total[:9], truth, atol=6e-3 * np.abs(truth[0]).max())
    assert np.all(found.scene.slow_error > 0)


def test_pursuit_finds_the_source_and_then_nothing(photographs):
    task = task_of(photographs)
    dark = with_sources(task, [])
    towards = np.concatenate([fibonacci_sphere(500), SOURCE[None]])
    pursued = pursue(response_of(task, dark), dark.guess, measured(task, dark), towards, 1)
    assert int(pursued.chosen[0]) == 500
    lit = with_sources(task, [SOURCE])
    # Once the exact integral has put right what the dual model leaves out.
    lit = descend(task, corrected(task, lit), 8)
    assert np.array_equal(add_sources(task, lit, 2).active, lit.active)


def test_pursued_gains_are_what_the_cost_loses(photographs):
    """At fixed material and light of full rank, the gain promised is the gain had."""
    task = task_of(photographs)
    dark = with_sources(task, [])
    data, response = measured(task, dark), response_of(task, dark)
    pursued = pursue(response, dark.guess, data, SOURCE[None], 1)
    before = reduced_system(in_blocks(response, data), dark.guess).solved
    guess = dark.guess._replace(directions=jnp.asarray(np.tile(SOURCE, (SOURCES, 1))))
    one = np.zeros((len(task.radiance), SOURCES))
    one[:, 0] = 1
    lit = eqx.tree_at(lambda r: r.lit, response, jnp.asarray(one))
    after = reduced_system(in_blocks(lit, data), guess).solved
    assert float(pursued.gains[0]) == pytest.approx(2 * float(before.cost - after.cost), rel=1e-5)


def test_one_source_found_twice_becomes_one(photographs):
    task = task_of(photographs)
    aside = np.cross(SOURCE, [0.0, 0.0, 1.0]) * 0.04
    twice = with_sources(task, [SOURCE + aside, SOURCE - aside])
    merged = with_neighbours_merged(task, twice)
    assert np.count_nonzero(merged.active) == 1
    assert np.asarray(merged.guess.directions)[merged.active][0] @ SOURCE > np.cos(2e-3)


def test_idle_sources_are_switched_off(photographs):
    task = task_of(photographs)
    idle = with_sources(task, [SOURCE, np.array([-0.6, -0.7, -0.3])])
    idle = descend(task, corrected(task, idle), 8)
    kept = without_idle_sources(task, idle)
    assert np.count_nonzero(kept.active) == 1
    assert np.asarray(kept.guess.directions)[kept.active][0] @ SOURCE > 0.9999


@pytest.mark.parametrize("gauge", ["dielectric", "metal"])
def test_gauges_keep_the_product_of_light_and_reflectance(photographs, gauge):
    task = task_of(photographs)
    state = with_sources(task, [SOURCE])
    plain, light = account_of(task, state, "per-channel")
    other, changed = account_of(task, state, gauge)
    np.testing.assert_allclose(
        other.value.kd[None, :] * changed.total, plain.value.kd[None, :] * light.total, rtol=1e-12
    )
    assert np.mean(other.value.kd + other.value.ks) == pytest.approx(1)
    if gauge == "dielectric":
        np.testing.assert_allclose(other.value.ks, other.value.ks[0])
        # The paint's own colour comes out, because its specular lobe has none.
        np.testing.assert_allclose(
            other.value.kd / other.value.kd[0], PAINT.kd / PAINT.kd[0], rtol=0.02
        )
    else:
        np.testing.assert_allclose(changed.slow[0], changed.slow[0, 0])


def test_what_is_known_stays(photographs):
    settings = FactorSettings(BAND_LIMIT, SOURCES, refine=False)
    found = factorize(photographs, PAINT, settings, Known(sigma=SIGMA, mu=MU))
    assert float(found.brdf.sigma) == pytest.approx(0.15)
    assert found.parameters.standard_error.numbers["sigma"] == 0
    assert set(found.identifiable) == {"kd", "ks"}


def test_a_search_begins_at_the_stated_start_and_inside_the_bounds(photographs):
    known = Known(sigma=sigma_unknown(0.3, 0.5, start=0.4), mu=mu_unknown(2.0, 3.0))
    first = begin(task_of(photographs)._replace(known=known)).guess
    assert float(jnp.exp(first.sigma)) == pytest.approx(0.4)
    assert 1 + float(jnp.exp(first.mu)) == pytest.approx(2)


@pytest.mark.parametrize(
    ("name", "known", "bound"),
    [
        ("sigma", Known(sigma=sigma_unknown(0.2, 0.5), mu=MU), 0.2),
        pytest.param(
            "mu", Known(sigma=SIGMA, mu=mu_unknown(2.0, 3.0)), 2.0, marks=pytest.mark.slow
        ),
    ],
    ids=["sigma", "mu"],
)
def test_bounds_are_honoured(photographs, name, known, bound):
    """The truth, sigma .15 and mu 1.38, lies below the bounds."""
    settings = FactorSettings(BAND_LIMIT, SOURCES, refine=False)
    found = factorize(photographs, PAINT, settings, known)
    assert found.outcome is Outcome.AT_BOUND
    assert float(getattr(found.brdf, name)) == pytest.approx(bound)
    assert f"{name} is at a bound of its range" in found.reasons
    assert not found.identifiable[name]


def test_with_a_known_material_it_ends_when_the_light_has_settled(photographs):
    """Material that cannot move says nothing of what is still to come."""
    shares = tuple((PAINT.ks / (PAINT.kd + PAINT.ks)).tolist())
    task = task_of(photographs)._replace(known=Known(shares, SIGMA, MU))
    # Too dim by a third, as after a search on other samples.
    darker = photographs._replace(radiance=0.7 * task.radiance)
    start = with_sources(task._replace(observations=darker), [SOURCE])
    end = settle(task, start, lambda _: None)
    assert end.settled
    assert corrected(task, end) is end
    at_once = settle(task, with_sources(task, [SOURCE]), lambda _: None)
    light = np.asarray(at_once.joint.solved.light)
    np.testing.assert_allclose(end.joint.solved.light, light, atol=2e-3 * np.abs(light).max())


def test_moves_of_the_material_are_told_in_standard_errors(photographs):
    """A standard error of one number, and what goes with it in the others, is a move of one."""
    task = task_of(photographs)
    state = descend(task, with_sources(task, [SOURCE]), 8)
    free = free_unknowns(task, state)
    channels = len(state.guess.specular_logit)
    own = free[: channels + 2]
    curvature = np.asarray(state.joint.curvature)[np.ix_(free, free)]
    covariance = np.linalg.inv(curvature)[: own.sum(), : own.sum()]
    for number in range(own.sum()):
        step = np.zeros(len(own))
        step[own] = covariance[number] / np.sqrt(covariance[number, number])
        guess = state.guess._replace(
            specular_logit=state.guess.specular_logit + step[:channels],
            sigma=state.guess.sigma + step[channels],
            mu=state.guess.mu + step[channels + 1],
        )
        moved = state._replace(guess=guess)
        assert _material_moved(task, state, moved) == pytest.approx(1, rel=1e-6)


def test_what_the_dual_model_lacks_makes_it_the_integral(photographs):
    """What it lacks is found at the guess, by rotations of the lobe and not of the light."""
    task = task_of(photographs)
    state = corrected(task, with_sources(task, []))
    response, light = response_of(task, state), np.random.default_rng(3).normal(size=(121, 3))

    def parts(guess: Guess) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The integral, the response completed at the guess of the state, the dual model."""
        passed, lobe = response.passed(guess), response.lobe(guess)
        exact = reflect_slow_light(lobe, photographs.samples, light)
        completed = response.slow_specular(passed, guess) @ light
        return tuple(map(np.asarray, (exact, completed, response.slow_columns(passed) @ light)))

    exact, completed, dual = parts(state.guess)
    np.testing.assert_allclose(completed, exact, atol=1e-10)
    assert np.abs(dual - exact).max() > 1e-2
    assert change(state, corrected(task, state)) == 0
    # Beside the guess, what it lacks is followed to first order in each number of the lobe.
    for step in ({"sigma": 0.01}, {"mu": 0.05}):
        near = {name: getattr(state.guess, name) + by for name, by in step.items()}
        beside, followed, there = parts(state.guess._replace(**near))
        changed = (beside - there) - (exact - dual)
        assert np.abs(followed - beside).max() < 0.1 * np.abs(changed).max(), step


def test_too_few_samples_are_refused(photographs):
    few = photographs.take(np.arange(100))
    with pytest.raises(ValueError, match="100 samples for light of 121 coefficients"):
        factorize(few, PAINT, FactorSettings(BAND_LIMIT, SOURCES))


def test_unknown_gauge_is_refused(photographs):
    task = task_of(photographs)
    with pytest.raises(ValueError, match="gauge='plastic': choose one of per-channel"):
        account_of(task, with_sources(task, []), "plastic")


def test_no_gauge_changes_what_is_known_of_the_specular_share(photographs):
    """The ratio of kd and ks has one error in every gauge.

    A gauge that rests on what was found is uncertain itself: kd of a dielectric is known no better
    than that ratio.
    """
    task = task_of(photographs)
    state = with_sources(task, [SOURCE])
    ratio = np.concatenate([np.eye(3), -np.eye(3), np.zeros((3, 4))], axis=1)
    known = {}
    for gauge in GAUGES:
        found, _ = account_of(task, state, gauge)
        slopes = ratio / np.concatenate([found.value.kd, found.value.ks, np.ones(4)])
        known[gauge] = slopes @ found.covariance @ slopes.T, found
        np.testing.assert_allclose(known[gauge][0], known["per-channel"][0], rtol=1e-6, atol=1e-12)
    variance, found = known["dielectric"]
    np.testing.assert_allclose(found.value.ks, found.value.ks[0])
    # Three channels share one ks, whose error has a part of each of theirs.
    error = found.standard_error.kd / found.value.kd
    assert np.all(error > 0.5 * np.sqrt(np.diag(variance)))
