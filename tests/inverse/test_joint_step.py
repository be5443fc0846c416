"""A step of light and material together.

- The derivatives of the joint step are those of the prediction: share, lobe and directions.
- A step's equations, summed by blocks, are those of whole matrices.
- A step's gain is real.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from painted_ball import SOURCE, SOURCES, photographed, task_of, with_sources

from jaxrender.inverse.factorization import blocks
from jaxrender.inverse.factorization.account import _inverse, _moves
from jaxrender.inverse.factorization.blocks import Measured, in_blocks
from jaxrender.inverse.factorization.correction import corrected
from jaxrender.inverse.factorization.joint import (
    DAMPING,
    Descent,
    _damped,
    _moved,
    descend_jointly,
)
from jaxrender.inverse.factorization.projection import Drawn, mixed, reduced_system, scatter
from jaxrender.inverse.factorization.response import Guess, MirrorResponse, specular_share
from jaxrender.inverse.factorization.slopes import lobe_slopes, prediction_slopes
from jaxrender.inverse.factorization.state import begin, free_unknowns, measured, response_of


@pytest.fixture(scope="module")
def photographs():
    return photographed()


def _slopes(response: MirrorResponse, guess: Guess, light: jax.Array) -> np.ndarray:
    (lobe,), columns = lobe_slopes([response], guess), response.columns(guess)
    return np.stack(prediction_slopes(response, lobe, guess, columns, light))


def test_derivatives_of_the_prediction(photographs):
    task = task_of(photographs)
    state = with_sources(task, [SOURCE, np.array([0.6, 0.0, 0.8])])
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


def test_rows_are_worked_off_in_blocks_of_one_length(monkeypatch):
    """Each row is found at its place, and every block has as many."""
    monkeypatch.setattr(blocks, "SAMPLES_AT_ONCE", 3)
    seen = []

    def doubled(values, more):
        seen.append(len(values))
        return 2 * values + more["one"]

    rows = np.arange(7.0)
    found = blocks.by_rows(doubled, rows, {"one": np.ones(7)})
    np.testing.assert_array_equal(found, 2 * rows + 1)
    assert seen == [3, 3, 3]


def test_the_system_by_blocks_is_that_of_whole_matrices(photographs):
    """The same equations by NumPy, and blocks that do not divide the samples."""
    task = task_of(photographs)
    state = with_sources(task, [SOURCE, np.array([0.6, 0.0, 0.8])])
    response, guess, data = response_of(task, state), state.guess, measured(task, state)
    system = reduced_system(in_blocks(response, data, 220), guess)
    solved = system.solved
    slopes = _slopes(response, guess, solved.light)
    curvature, slope, cost = 0, 0, 0
    for k, columns in enumerate(np.asarray(mixed(response.columns(guess), specular_share(guess)))):
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
    task = task_of(photographs._replace(stands_for=pixels))
    state = with_sources(task, [SOURCE])
    response, guess, data = response_of(task, state), state.guess, measured(task, state)
    found, shares = reduced_system(in_blocks(response, data), guess), task.observations.shares
    one = np.zeros(photographs.count, int)
    ours = scatter(in_blocks(response, data), guess, Drawn(shares, one), found)
    slopes, own = _slopes(response, guess, found.solved.light), 0
    for k, columns in enumerate(np.asarray(mixed(response.columns(guess), specular_share(guess)))):
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
    task = task_of(photographs)
    state = with_sources(task, [SOURCE])
    response, guess, data = response_of(task, state), state.guess, measured(task, state)
    system = reduced_system(in_blocks(response, data), guess)
    drawn = Drawn(np.ones(photographs.count), np.zeros(photographs.count, int))
    ours = scatter(in_blocks(response, data), guess, drawn, system)
    scale = np.abs(system.curvature).max()
    np.testing.assert_allclose(ours.own, system.curvature, atol=1e-9 * scale)
    np.testing.assert_allclose(ours.both, 0, atol=1e-9 * np.abs(system.across).max())


def test_groups_of_samples_move_the_answer_as_whole_matrices_say(photographs):
    """What a group leaves moves light and material by the answer to its right-hand side alone."""
    task = task_of(photographs)
    state = with_sources(task, [SOURCE])
    response, guess, data = response_of(task, state), state.guess, measured(task, state)
    system, group = (
        reduced_system(in_blocks(response, data), guess),
        np.arange(photographs.count) % 5,
    )
    free = free_unknowns(task, state)
    inverse = _inverse(system, free, state)
    drawn = Drawn(np.ones(photographs.count), group)
    ours = _moves(system, scatter(in_blocks(response, data), guess, drawn, system), inverse)
    slopes = _slopes(response, guess, system.solved.light)
    unknowns, (channels, _, parts) = slopes.shape[-1], np.shape(system.solved.normal)
    size = unknowns + channels * parts
    bread, rights = np.zeros((size, size)), np.zeros((5, size))
    bread[:unknowns, :unknowns] = np.eye(unknowns) / 4
    left = np.asarray(data.radiance) - np.asarray(system.solved.predicted)
    for k, columns in enumerate(np.asarray(mixed(response.columns(guess), specular_share(guess)))):
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
        task = task_of(some)
        state = begin(task)
        data = measured(task, state)
        # Shares have a mean of one, so what is expected of the light goes by the number of samples.
        data = data._replace(penalty=data.penalty * some.count / photographs.count)
        blocks = in_blocks(response_of(task, state), data)
        lights.append(reduced_system(blocks, state.guess).solved.light)
    np.testing.assert_allclose(*lights, atol=1e-8 * np.abs(lights[0]).max())


def test_a_penalty_belongs_to_each_part(photographs):
    """Smoothness pulls degree l by l (l + 1), and never the mean or a source."""
    task = task_of(photographs)
    data = measured(task, begin(task))
    penalty = np.asarray(data.penalty)
    assert isinstance(data, Measured)
    assert np.all(penalty[0] == 0)
    assert np.all(penalty[121:] == 0)
    np.testing.assert_allclose(penalty[4], 3 * penalty[1])


def test_reduced_curvature_is_that_of_the_projected_problem(photographs):
    """The second derivative of the cost along the shares, the light following, at the minimum."""
    task = task_of(photographs)
    state = with_sources(task, [SOURCE])
    response, data = response_of(task, state), measured(task, state)
    system = reduced_system(in_blocks(response, data), state.guess)

    def cost(step: float) -> float:
        moved = state.guess._replace(
            specular_logit=state.guess.specular_logit + jnp.array([step, 0.0, 0.0])
        )
        return float(reduced_system(in_blocks(response, data), moved).solved.cost)

    # Gauss-Newton leaves out what the residual bends: a per cent of it at this noise.
    second = (cost(3e-2) - 2 * cost(0.0) + cost(-3e-2)) / 9e-4
    assert float(system.curvature[0, 0]) == pytest.approx(second, rel=0.03)


def test_only_good_steps_count(photographs):
    """From a far start the first trials gain nothing: more damping is tried, and a step taken."""
    task = task_of(photographs)
    state = with_sources(task, [SOURCE])
    far = state.guess._replace(
        specular_logit=state.guess.specular_logit + 4, sigma=state.guess.sigma + 1
    )
    response, data = response_of(task, state), measured(task, state)
    free = free_unknowns(task, state)
    end = descend_jointly(response, far, data, free, Descent(task.bounds, 1, 1e-6))
    assert end.steps == 1
    assert float(end.solved.cost) < float(
        reduced_system(in_blocks(response, data), far).solved.cost
    )


def test_descents_that_go_on_end_where_one_does(photographs):
    """The damping goes on, too: numbers that are hardly told apart move by halves under more."""
    task = task_of(photographs)
    state = with_sources(task, [SOURCE])
    response, data = response_of(task, state), measured(task, state)
    free = free_unknowns(task, state)

    def descended(steps, guess=state.guess, damping=DAMPING):
        descent = Descent(task.bounds, steps, 0.0, damping)
        return descend_jointly(response, guess, data, free, descent)

    whole, half = descended(4), descended(2)
    assert half.damping < DAMPING
    both = descended(2, half.guess, half.damping)
    np.testing.assert_array_equal(material_numbers(both.guess), material_numbers(whole.guess))
    anew = descended(2, half.guess)
    assert np.any(material_numbers(anew.guess) != material_numbers(whole.guess))


def material_numbers(guess):
    return np.concatenate(
        [np.ravel(part) for part in (guess.specular_logit, guess.sigma, guess.mu)]
    )


def test_a_descent_without_promise_ends_where_it_is(photographs):
    """At the minimum no step is tried; a matrix without a factorization makes no end."""
    task = task_of(photographs)
    state = with_sources(task, [SOURCE])
    response, data = response_of(task, state), measured(task, state)
    free = free_unknowns(task, state)
    there = descend_jointly(response, state.guess, data, free, Descent(task.bounds, 20, 1e-9))
    again = descend_jointly(response, there.guess, data, free, Descent(task.bounds, 20, 1e-4))
    assert (again.steps, again.converged) == (0, True)
    indefinite = np.ones((len(free), len(free)))
    _, expected = _damped(indefinite, np.ones(len(free)), free, -0.5)
    assert float(expected) == np.inf
