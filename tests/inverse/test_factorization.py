"""Light and material both unknown.

- The derivatives of the joint step are those of the prediction: share, lobe and directions.
- A step's equations, summed by blocks, are those of whole matrices.
- A step's gain is real, and material and source of a small scene are found from photographs by the
  exact integral, with noise, within a few of the stated standard errors.
- Pursuit picks the source that is there; on noise alone it finds nothing worth adding.
- Two sources found for one become one; an idle source is dropped.
- Gauges: products of light and reflectance never change; one ks for all channels of a dielectric;
  light of one mean colour over a metal.
- Shadows: on a concave object the shadowed model explains what the convex one cannot.
- With a known material the last steps end at the light that fits best.
- Completed by what it lacks, the dual model is the integral.
- Too few samples and unknown gauges are refused.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import ball_samples, mu_unknown, sigma_unknown

from jaxrender.brdf import Microfacet
from jaxrender.geometry import fibonacci_sphere
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations, Outcome
from jaxrender.inverse.factorization import FactorSettings, Known, factorize
from jaxrender.inverse.factorization.account import _inverse, _moves, account_of
from jaxrender.inverse.factorization.blocks import Measured
from jaxrender.inverse.factorization.correction import change, corrected
from jaxrender.inverse.factorization.gauges import GAUGES
from jaxrender.inverse.factorization.joint import Descent, _damped, _moved, descend_jointly
from jaxrender.inverse.factorization.projection import Drawn, mixed, reduced_system, scatter
from jaxrender.inverse.factorization.pursuit import pursue
from jaxrender.inverse.factorization.response import Guess, MirrorResponse
from jaxrender.inverse.factorization.rounds import (
    settle,
    with_neighbours_merged,
    without_idle_sources,
)
from jaxrender.inverse.factorization.slopes import lobe_slopes, prediction_slopes
from jaxrender.inverse.factorization.sources import add_sources
from jaxrender.inverse.factorization.state import (
    State,
    Task,
    begin,
    descend,
    free_unknowns,
    measured,
    response_of,
)
from jaxrender.inverse.unknowns import Unknown
from jaxrender.lighting import DirectionalSources, SmoothLobes
from jaxrender.reflection import (
    integral_columns,
    polar_columns,
    radiance,
    reflect_slow_light,
)

SOURCE = np.array([-0.35, 0.8, 0.5]) / np.linalg.norm([-0.35, 0.8, 0.5])
ENERGY = np.array([1.2, 1.15, 1.05])
PAINT = Microfacet(np.array([0.245, 0.281, 0.2]), np.full(3, 0.115), 0.15, 1.38)
AREA = SmoothLobes(
    np.array([[0.9, 0.5, 0.4], [0.0, 0.0, 1.0]]),
    np.radians([65.0, 80.0]),
    np.array([[1.0, 0.97, 0.92], [0.06, 0.07, 0.09]]),
)
NOISE = NoiseModel(0.01, 0.0005)
BAND_LIMIT, SOURCES = 10, 4
SIGMA, MU = Unknown(fixed=(0.15,)), Unknown(fixed=(1.38,))


@pytest.fixture(scope="module")
def photographs() -> Observations:
    """An area light and a source on a painted ball, by the exact integral, with noise."""
    samples, _ = ball_samples(1500, 0.15, seed=1)
    columns = integral_columns(PAINT, samples, _source().nodes())
    columns = columns + polar_columns(PAINT, samples, AREA.radiance)
    exact = np.asarray(radiance(PAINT, columns))
    noisy = NOISE.add(exact, np.random.default_rng(0))
    return Observations(samples, noisy, np.zeros(len(noisy), int))


@pytest.fixture(scope="module")
def found(photographs):
    settings = FactorSettings(BAND_LIMIT, SOURCES)
    return factorize(photographs, PAINT, settings)


def _source() -> DirectionalSources:
    return DirectionalSources(SOURCE[None], ENERGY[None])


def _task(photographs: Observations) -> Task:
    response = MirrorResponse.of_convex(PAINT, photographs.samples, BAND_LIMIT, SOURCES)
    settings = FactorSettings(BAND_LIMIT, SOURCES)
    return Task(photographs, response, settings=settings)


def _with_sources(task: Task, directions: list[np.ndarray]) -> State:
    """A state at the true material with sources in the given directions, fitted."""
    known = begin(task._replace(known=Known((0.32, 0.29, 0.365), SIGMA, MU)))
    slots, active = np.array(known.guess.directions), known.active.copy()
    for slot, direction in enumerate(directions):
        slots[slot], active[slot] = direction / np.linalg.norm(direction), True
    guess = known.guess._replace(directions=jnp.asarray(slots))
    weights = 1 / np.asarray(NOISE.standard_deviation(task.radiance))
    return descend(task, known._replace(guess=guess, active=active, weights=weights), 8)


@pytest.mark.slow
def test_material_and_source_are_found(found):
    total = PAINT.kd + PAINT.ks
    value, error = found.parameters.value, found.parameters.standard_error
    for name, truth in (("kd", PAINT.kd / total), ("ks", PAINT.ks / total), ("sigma", 0.15)):
        off = np.abs(value.of(name) - truth) / error.of(name)
        assert np.all(off < 4), name
        assert np.all(error.of(name) < 0.01), name
    assert abs(value.mu - 1.38) < 4 * error.mu < 0.02
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


def test_derivatives_of_the_prediction(photographs):
    task = _task(photographs)
    state = _with_sources(task, [SOURCE, np.array([0.6, 0.0, 0.8])])
    state = corrected(task, state)
    response = response_of(task, state)
    light = state.joint.solved.light
    tangents = _slopes(response, state.guess, light)

    def predict(guess: Guess):
        share = jax.nn.sigmoid(guess.specular_logit)[:, None, None]
        diffuse, specular = response.columns(guess)
        mixed = (1 - share) * diffuse[None] + share * specular[None]
        return jnp.einsum("csp,pc->cs", mixed, light)

    for unknown in [0, 2, 3, 4, 5, 6, 5 + SOURCES, 6 + SOURCES]:
        step = np.zeros(tangents.shape[-1])
        step[unknown] = 1e-5
        bounds = task.bounds
        ahead, behind = (
            predict(_moved(state.guess, jnp.asarray(s), bounds)) for s in (step, -step)
        )
        slope = np.asarray(ahead - behind) / 2e-5
        np.testing.assert_allclose(
            tangents[..., unknown], slope, atol=2e-6 * np.abs(slope).max(), err_msg=str(unknown)
        )


def test_the_system_by_blocks_is_that_of_whole_matrices(photographs):
    """The same equations by NumPy, and blocks that do not divide the samples."""
    task = _task(photographs)
    state = _with_sources(task, [SOURCE, np.array([0.6, 0.0, 0.8])])
    response, guess, data = response_of(task, state), state.guess, measured(task, state)
    system = reduced_system(response, guess, data, at_once=220)
    solved = system.solved
    slopes = _slopes(response, guess, solved.light)
    curvature, slope, cost = 0, 0, 0
    for k, columns in enumerate(np.asarray(mixed(response, guess))):
        weighted, moved = (data.weights[:, k, None] * a for a in (columns, slopes[k]))
        seen = data.weights[:, k] * data.radiance[:, k]
        dark = np.append(np.zeros(121), ~state.active)
        normal = weighted.T @ weighted + np.diag(data.penalty[:, k] + dark)
        light = np.linalg.solve(normal, weighted.T @ seen)
        np.testing.assert_allclose(solved.light[:, k], light, atol=1e-8 * np.abs(light).max())
        np.testing.assert_allclose(solved.predicted[:, k], columns @ light, rtol=1e-7)
        left, across = seen - weighted @ light, weighted.T @ moved
        cost += (left @ left + light @ (data.penalty[:, k] * light)) / 2
        curvature += moved.T @ moved - across.T @ np.linalg.solve(normal, across)
        slope += moved.T @ left
        np.testing.assert_allclose(system.across[k], across, atol=1e-9 * np.abs(across).max())
    assert float(solved.cost) == pytest.approx(cost, rel=1e-10)
    np.testing.assert_allclose(system.curvature, curvature, atol=1e-8 * np.abs(curvature).max())
    np.testing.assert_allclose(system.slope, slope, atol=1e-7 * np.abs(moved).sum(axis=0).max())


def test_scatter_is_that_of_whole_matrices(photographs):
    """The noise of samples that stand for 1 to 3 pixels, sample by sample, by NumPy.

    The least-squares answer of light and material is linear in the noise: its covariance is
    H^-1 (J' C W J + Lambda) H^-1 over all unknowns together.
    """
    pixels = np.random.default_rng(3).uniform(1, 3, photographs.count)
    task = _task(photographs._replace(stands_for=pixels))
    state = _with_sources(task, [SOURCE])
    response, guess, data = response_of(task, state), state.guess, measured(task, state)
    found, shares = reduced_system(response, guess, data), task.observations.shares
    one = np.zeros(photographs.count, int)
    ours = scatter(response, guess, data, Drawn(shares, one), found)
    slopes, own = _slopes(response, guess, found.solved.light), 0
    for k, columns in enumerate(np.asarray(mixed(response, guess))):
        whole = np.concatenate([columns, slopes[k]], axis=1)
        parts, weights = columns.shape[1], data.weights[:, k, None]
        prior = np.diag(np.append(data.penalty[:, k], np.zeros(slopes.shape[-1])))
        bread = (weights * whole).T @ (weights * whole) + prior
        meat = (shares[:, None] * weights**2 * whole).T @ whole + prior
        dark = np.diag(np.append(np.zeros(121), ~state.active))
        answer = np.linalg.solve(bread[:parts, :parts] + dark, bread[:parts, parts:])
        # Rows that take the light's answer off the other unknowns.
        take_off = np.concatenate([-answer.T, np.eye(slopes.shape[-1])], axis=1)
        own = own + take_off @ meat @ take_off.T
        light = meat[:parts, :parts]
        np.testing.assert_allclose(ours.light[k], light, atol=1e-8 * np.abs(light).max())
        both = meat[:parts] @ take_off.T
        np.testing.assert_allclose(ours.both[k], both, atol=1e-7 * np.abs(bread).max())
    np.testing.assert_allclose(ours.own, own, atol=1e-8 * np.abs(own).max())


def test_scatter_of_single_pixels_is_the_curvature(photographs):
    task = _task(photographs)
    state = _with_sources(task, [SOURCE])
    response, guess, data = response_of(task, state), state.guess, measured(task, state)
    system = reduced_system(response, guess, data)
    drawn = Drawn(np.ones(photographs.count), np.zeros(photographs.count, int))
    ours = scatter(response, guess, data, drawn, system)
    scale = np.abs(system.curvature).max()
    np.testing.assert_allclose(ours.own, system.curvature, atol=1e-9 * scale)
    np.testing.assert_allclose(ours.both, 0, atol=1e-9 * np.abs(system.across).max())


def test_groups_of_samples_move_the_answer_as_whole_matrices_say(photographs):
    """What a group leaves moves light and material by the answer to its right-hand side alone."""
    task = _task(photographs)
    state = _with_sources(task, [SOURCE])
    response, guess, data = response_of(task, state), state.guess, measured(task, state)
    system, group = reduced_system(response, guess, data), np.arange(photographs.count) % 5
    free = free_unknowns(task, state)
    inverse = _inverse(system, free)
    drawn = Drawn(np.ones(photographs.count), group)
    ours = _moves(system, scatter(response, guess, data, drawn, system), inverse)
    slopes = _slopes(response, guess, system.solved.light)
    unknowns, (channels, _, parts) = slopes.shape[-1], np.shape(system.solved.normal)
    size = unknowns + channels * parts
    bread, rights = np.zeros((size, size)), np.zeros((5, size))
    bread[:unknowns, :unknowns] = np.eye(unknowns) / 4
    left = np.asarray(data.radiance) - np.asarray(system.solved.predicted)
    for k, columns in enumerate(np.asarray(mixed(response, guess))):
        at = np.r_[:unknowns, unknowns + k * parts : unknowns + (k + 1) * parts]
        whole = data.weights[:, k, None] * np.concatenate([slopes[k], columns], axis=1)
        dark = np.append(np.zeros(121), ~state.active)
        prior = np.diag(np.concatenate([np.zeros(unknowns), data.penalty[:, k] + dark]))
        bread[np.ix_(at, at)] += whole.T @ whole + prior
        for g in range(5):
            rows = group == g
            rights[g, at] += whole[rows].T @ (data.weights[rows, k] * left[rows, k])
    kept = np.concatenate([free, np.ones(size - unknowns, bool)])
    expected = np.zeros((5, size))
    expected[:, kept] = np.linalg.solve(bread[np.ix_(kept, kept)], rights[:, kept].T).T
    np.testing.assert_allclose(ours[:5], expected, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_array_equal(ours[5:], 0)


def test_a_sample_counts_as_often_as_it_stands_for_pixels(photographs):
    """Samples that stand for two pixels, and the same samples twice, tell of the same light."""
    pixels = 1 + np.arange(photographs.count) % 2
    twice = photographs.take(np.repeat(np.arange(photographs.count), pixels))
    lights = []
    for some in (photographs._replace(stands_for=pixels.astype(float)), twice):
        task = _task(some)
        state = begin(task)
        data = measured(task, state)
        # Shares have a mean of one, so what is expected of the light goes by the number of samples.
        data = data._replace(penalty=data.penalty * some.count / photographs.count)
        lights.append(reduced_system(response_of(task, state), state.guess, data).solved.light)
    np.testing.assert_allclose(*lights, atol=1e-8 * np.abs(lights[0]).max())


def test_only_good_steps_count(photographs):
    """From a far start the first trials gain nothing: more damping is tried, and a step taken."""
    task = _task(photographs)
    state = _with_sources(task, [SOURCE])
    far = state.guess._replace(
        specular_logit=state.guess.specular_logit + 4, sigma=state.guess.sigma + 1
    )
    response, data = response_of(task, state), measured(task, state)
    free = free_unknowns(task, state)
    end = descend_jointly(response, far, data, free, Descent(task.bounds, 1, 1e-6))
    assert end.steps == 1
    assert float(end.solved.cost) < float(reduced_system(response, far, data).solved.cost)


def _slopes(response: MirrorResponse, guess: Guess, light: jax.Array) -> np.ndarray:
    lobe, columns = lobe_slopes(response, guess), response.columns(guess)
    return np.stack(prediction_slopes(response, lobe, guess, columns, light))


def test_reduced_curvature_is_that_of_the_projected_problem(photographs):
    """The second derivative of the cost along the shares, the light following, at the minimum."""
    task = _task(photographs)
    state = _with_sources(task, [SOURCE])
    response, data = response_of(task, state), measured(task, state)
    system = reduced_system(response, state.guess, data)

    def cost(step: float) -> float:
        moved = state.guess._replace(
            specular_logit=state.guess.specular_logit + jnp.array([step, 0.0, 0.0])
        )
        return float(reduced_system(response, moved, data).solved.cost)

    # Gauss-Newton leaves out what the residual bends: a per cent of it at this noise.
    second = (cost(3e-2) - 2 * cost(0.0) + cost(-3e-2)) / 9e-4
    assert float(system.curvature[0, 0]) == pytest.approx(second, rel=0.03)


def test_pursuit_finds_the_source_and_then_nothing(photographs):
    task = _task(photographs)
    dark = _with_sources(task, [])
    towards = np.concatenate([fibonacci_sphere(500), SOURCE[None]])
    pursued = pursue(response_of(task, dark), dark.guess, measured(task, dark), towards, 1)
    assert int(pursued.chosen[0]) == 500
    lit = _with_sources(task, [SOURCE])
    # Once the exact integral has put right what the dual model leaves out.
    lit = descend(task, corrected(task, lit), 8)
    assert np.array_equal(add_sources(task, lit, 2).active, lit.active)


def test_pursued_gains_are_what_the_cost_loses(photographs):
    """At fixed material and light of full rank, the gain promised is the gain had."""
    task = _task(photographs)
    dark = _with_sources(task, [])
    data, response = measured(task, dark), response_of(task, dark)
    pursued = pursue(response, dark.guess, data, SOURCE[None], 1)
    before = reduced_system(response, dark.guess, data).solved
    guess = dark.guess._replace(directions=jnp.asarray(np.tile(SOURCE, (SOURCES, 1))))
    one = np.zeros((len(task.radiance), SOURCES))
    one[:, 0] = 1
    lit = eqx.tree_at(lambda r: r.lit, response, jnp.asarray(one))
    after = reduced_system(lit, guess, data).solved
    assert float(pursued.gains[0]) == pytest.approx(2 * float(before.cost - after.cost), rel=1e-5)


def test_one_source_found_twice_becomes_one(photographs):
    task = _task(photographs)
    aside = np.cross(SOURCE, [0.0, 0.0, 1.0]) * 0.04
    twice = _with_sources(task, [SOURCE + aside, SOURCE - aside])
    merged = with_neighbours_merged(task, twice)
    assert np.count_nonzero(merged.active) == 1
    assert np.asarray(merged.guess.directions)[merged.active][0] @ SOURCE > np.cos(2e-3)


def test_idle_sources_are_switched_off(photographs):
    task = _task(photographs)
    idle = _with_sources(task, [SOURCE, np.array([-0.6, -0.7, -0.3])])
    idle = descend(task, corrected(task, idle), 8)
    kept = without_idle_sources(task, idle)
    assert np.count_nonzero(kept.active) == 1
    assert np.asarray(kept.guess.directions)[kept.active][0] @ SOURCE > 0.9999


@pytest.mark.parametrize("gauge", ["dielectric", "metal"])
def test_gauges_keep_the_product_of_light_and_reflectance(photographs, gauge):
    task = _task(photographs)
    state = _with_sources(task, [SOURCE])
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
    first = begin(_task(photographs)._replace(known=known)).guess
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
    task = _task(photographs)._replace(known=Known(shares, SIGMA, MU))
    # Too dim by a third, as after a search on other samples.
    darker = photographs._replace(radiance=0.7 * task.radiance)
    start = _with_sources(task._replace(observations=darker), [SOURCE])
    end = settle(task, start, lambda _: None)
    assert end.settled
    assert corrected(task, end) is end
    at_once = settle(task, _with_sources(task, [SOURCE]), lambda _: None)
    light = np.asarray(at_once.joint.solved.light)
    np.testing.assert_allclose(end.joint.solved.light, light, atol=2e-3 * np.abs(light).max())


def test_what_the_dual_model_lacks_makes_it_the_integral(photographs):
    """What it lacks is found at the guess, by rotations of the lobe and not of the light."""
    task = _task(photographs)
    state = corrected(task, _with_sources(task, []))
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
    task = _task(photographs)
    with pytest.raises(ValueError, match="gauge='plastic': choose one of per-channel"):
        account_of(task, _with_sources(task, []), "plastic")


def test_no_gauge_changes_what_is_known_of_the_specular_share(photographs):
    """The ratio of kd and ks has one error in every gauge.

    A gauge that rests on what was found is uncertain itself: kd of a dielectric is known no better
    than that ratio.
    """
    task = _task(photographs)
    state = _with_sources(task, [SOURCE])
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


def test_a_penalty_belongs_to_each_part(photographs):
    """Smoothness pulls degree l by l (l + 1), and never the mean or a source."""
    task = _task(photographs)
    data = measured(task, begin(task))
    penalty = np.asarray(data.penalty)
    assert isinstance(data, Measured)
    assert np.all(penalty[0] == 0)
    assert np.all(penalty[121:] == 0)
    np.testing.assert_allclose(penalty[4], 3 * penalty[1])


def test_a_descent_without_promise_ends_where_it_is(photographs):
    """At the minimum no step is tried; a matrix without a factorization makes no end."""
    task = _task(photographs)
    state = _with_sources(task, [SOURCE])
    response, data = response_of(task, state), measured(task, state)
    free = free_unknowns(task, state)
    there = descend_jointly(response, state.guess, data, free, Descent(task.bounds, 20, 1e-9))
    again = descend_jointly(response, there.guess, data, free, Descent(task.bounds, 20, 1e-4))
    assert (again.steps, again.converged) == (0, True)
    indefinite = np.ones((len(free), len(free)))
    _, expected = _damped(indefinite, np.ones(len(free)), free, -0.5)
    assert float(expected) == np.inf
