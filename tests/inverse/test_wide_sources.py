"""Sources with a width.

- The seven points of a source have the moments of a Gaussian, and its energy.
- What a wide source sends is the integral over a Gaussian window.
- Derivatives by the width are those of the prediction; at a bound it goes nowhere.
- A window narrower than the lobe: a point makes the lobe too wide, a width does not.
- Three sources in a row are a crowd, two are not.  Crowds have grain between their sources, of
  which the errors know; other light has none.  They reach as far as the likeliest grain would move
  the numbers.
"""

import functools

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import ball_samples, unit

from jaxrender.brdf import Microfacet
from jaxrender.geometry import world_from_local
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations
from jaxrender.inverse.factorization import FactorSettings, Known, as_points
from jaxrender.inverse.factorization.account import account_of
from jaxrender.inverse.factorization.blocks import in_blocks
from jaxrender.inverse.factorization.crowds import Grain, crowded, with_grain
from jaxrender.inverse.factorization.joint import _moved, movable, unknown_count
from jaxrender.inverse.factorization.projection import reduced_system
from jaxrender.inverse.factorization.response import MirrorResponse
from jaxrender.inverse.factorization.rounds import at_standstill
from jaxrender.inverse.factorization.slopes import lobe_slopes, prediction_slopes
from jaxrender.inverse.factorization.source_nodes import nodes_of, range_of, summed
from jaxrender.inverse.factorization.state import (
    State,
    Task,
    begin,
    descend,
    free_unknowns,
    measured,
    response_of,
)
from jaxrender.inverse.factorization.widths import _by_variance, may_be_wide, pays, with_widths
from jaxrender.lighting import DirectionalSources, LightNodes
from jaxrender.reflection import integral_columns, polar_columns, radiance

MU = 1.45
PAINT = Microfacet(np.array([0.24, 0.28, 0.2]), np.full(3, 0.12), 0.2, MU)
NOISE = NoiseModel(0.01, 0.0005)
MIDDLE = unit(np.array([-0.35, 0.8, 0.5]))
# Per axis: .06 beside the lobe's .2.
WIDTH = np.sqrt(2) * 0.06
BAND_LIMIT = 2


def window() -> LightNodes:
    """A Gaussian window of the energy 1, by 600 points."""
    share = (np.arange(600) + 0.5) / 600
    away, turn = WIDTH * np.sqrt(-np.log(1 - share)), np.pi * (3 - np.sqrt(5)) * np.arange(600)
    frame = np.asarray(world_from_local(jnp.asarray(MIDDLE)))
    aside = away[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1) @ frame[:, :2].T
    return LightNodes(unit(MIDDLE + aside), np.full((600, 3), 1 / 600))


@functools.cache
def photographed() -> Observations:
    samples, _ = ball_samples(900, 0.15, seed=1)
    columns = integral_columns(PAINT, samples, window())
    columns = columns + polar_columns(PAINT, samples, lambda towards: 0.1 + 0 * towards)
    exact = np.asarray(radiance(PAINT, columns))
    noisy = NOISE.add(exact, np.random.default_rng(0))
    return Observations(samples, noisy, np.zeros(len(noisy), int))


def beside(angles: list[float]) -> np.ndarray:
    """Directions on a great circle through the middle of the window."""
    aside = np.asarray(world_from_local(jnp.asarray(MIDDLE)))[:, 0]
    return np.array([np.cos(a) * MIDDLE + np.sin(a) * aside for a in angles])


def task_of(sources: int) -> Task:
    seen = photographed()
    response = MirrorResponse.of_convex(PAINT, seen.samples, BAND_LIMIT, sources)
    return Task(seen, response, settings=FactorSettings(BAND_LIMIT, sources, noise=NOISE))


def lit(task: Task, directions: np.ndarray) -> State:
    """Begin at the true material, lit by the sources alone."""
    share = tuple(PAINT.ks / (PAINT.kd + PAINT.ks))
    state = begin(task._replace(known=Known(share)), 0.2)
    guess = state.guess._replace(directions=jnp.asarray(directions), mu=jnp.asarray(np.log(MU - 1)))
    weights = 1 / np.asarray(NOISE.standard_deviation(task.radiance))
    return state._replace(guess=guess, active=np.ones(len(directions), bool), weights=weights)


def test_points_have_the_moments_of_a_gaussian():
    variance = 1e-4
    nodes = np.asarray(nodes_of(MIDDLE[None], np.array([variance])))
    frame = np.asarray(world_from_local(jnp.asarray(MIDDLE)))[:, :2]
    x, y = (nodes @ frame).T
    of = {"x2": x**2, "y2": y**2, "xy": x * y, "x4": x**4, "y4": y**4, "x2y2": x**2 * y**2}
    moments = dict(zip(of, np.asarray(summed(jnp.stack([*of.values()])))[:, 0]))
    for name, factor in {"x2": 1, "y2": 1}.items():
        assert moments[name] == pytest.approx(factor * variance, rel=2e-3)
    for name, factor in {"x4": 3, "y4": 3, "x2y2": 1}.items():
        assert moments[name] == pytest.approx(factor * variance**2, rel=2e-3)
    assert moments["xy"] == pytest.approx(0, abs=1e-12)


def test_as_points_it_is_the_same_light():
    energies = np.array([[1.0, 2.0, 3.0], [2.0, 2.0, 2.0]])
    sources = DirectionalSources(beside([0.0, 0.5]), energies)
    points = as_points(sources, np.array([0.0, 0.1]))
    assert len(points.directions) == 1 + 7
    np.testing.assert_allclose(points.irradiance.sum(axis=0), energies.sum(axis=0))
    np.testing.assert_allclose(points.irradiance[:2], [energies[0], energies[1] / 2])
    apart = np.asarray(points.directions)[1:] @ beside([0.5])[0]
    # Of the width w each axis has the variance w^2 / 2, and the hexagon lies at sqrt(2) w.
    np.testing.assert_allclose(np.arccos(apart.clip(-1, 1))[1:], np.arctan(np.sqrt(2) * 0.1))
    assert as_points(sources, np.zeros(2)) is sources


def test_a_wide_source_sends_what_the_window_does():
    task = task_of(1)
    state = lit(task, MIDDLE[None])
    guess = state.guess._replace(variance=jnp.asarray([WIDTH**2 / 2]))
    seen = np.asarray(response_of(task, state).source_specular(guess))[:, 0]
    lamp = LightNodes(MIDDLE[None], np.ones((1, 3)))
    exact, point = (
        np.asarray(integral_columns(PAINT, photographed().samples, nodes))[:, 1, 0]
        for nodes in (window(), lamp)
    )
    assert np.abs(seen - exact).max() < 4e-3 * exact.max()
    assert np.abs(point - exact).max() > 5e-2 * exact.max()


def test_derivatives_by_the_width_and_its_bounds():
    task = task_of(2)
    state = lit(task, beside([0.0, 0.3]))
    least, most = (float(bound) for bound in range_of(state.guess.sigma))
    guess = state.guess._replace(variance=jnp.asarray([0.1 * most, 0.5 * most]))
    response = response_of(task, state)
    light = jnp.concatenate([jnp.zeros((9, 3)), jnp.asarray([[1.0, 2, 3], [2, 1, 1]])])
    (lobe,) = lobe_slopes([response], guess)
    tangents = np.asarray(prediction_slopes(response, lobe, guess, response.columns(guess), light))
    assert tangents.shape[-1] == 3 + 2 + 3 * 2
    share = PAINT.ks / (PAINT.kd + PAINT.ks)

    def predict(there) -> np.ndarray:
        diffuse, specular = (np.asarray(part @ light).T for part in response.columns(there))
        return np.asarray((1 - share)[:, None] * diffuse + share[:, None] * specular)

    for unknown in (5, 8, 9, 10):
        step = np.zeros(11)
        step[unknown] = 1e-5
        ahead, behind = (
            predict(_moved(guess, jnp.asarray(one), task.bounds)) for one in (step, -step)
        )
        slope = (ahead - behind) / 2e-5
        # Where a source moves, its hexagon tilts along, which shows little.
        near = (1e-4 if unknown > 8 else 1e-2) * np.abs(slope).max()
        np.testing.assert_allclose(tangents[..., unknown], slope, atol=near, err_msg=str(unknown))
    at_bounds = guess._replace(variance=jnp.asarray([least, most]))
    downwards, upwards = np.full(11, -1.0), np.ones(11)
    free = np.ones(11, bool)
    assert movable(at_bounds, downwards, free).tolist() == [True] * 9 + [False, True]
    assert movable(at_bounds, upwards, free).tolist() == [True] * 9 + [True, False]
    assert movable(state.guess, downwards, free) is free


def test_a_narrow_window_is_found_with_its_width():
    """A source with a width costs no knowledge of sigma; a point takes it for gloss."""
    task = task_of(1)
    point = descend(task, lit(task, MIDDLE[None]), 12, 1e-6)
    wide = descend(task, with_widths(point), 20, 1e-6)
    off = {}
    for name, state in {"point": point, "wide": wide}.items():
        found, scene = account_of(task, state, "per-channel")
        off[name] = abs(found.value.of("sigma") - PAINT.sigma) / found.standard_error.of("sigma")
    assert off["point"] > 4
    assert off["wide"] < 3
    assert pays(task, point, wide)
    assert not pays(task, wide, wide)
    assert scene.widths == pytest.approx([WIDTH], rel=0.1)
    # What it sends is in the light's coefficients, as a window's of this width.
    assert len(scene.points.directions) == 7
    assert may_be_wide(task, point)
    np.testing.assert_allclose(
        scene.total[0], scene.slow[0] + scene.sources.irradiance[0] / np.sqrt(4 * np.pi)
    )


def test_derivatives_by_a_width_of_none_are_those_of_a_wide_source():
    """More sources than the programs have at once, of which one is off and one is hidden."""
    task, energies = task_of(3), np.array([1.0, 2.0, 0.0])
    state = descend(task, lit(task, beside([0.0, 0.6, 1.2])), 1)
    assert state.joint is not None
    light = np.concatenate([np.zeros((9, 3)), energies[:, None] * np.ones(3)])
    solved = state.joint.solved._replace(light=light)
    state = state._replace(
        joint=state.joint._replace(solved=solved), active=np.array([True, True, False])
    )
    found = _by_variance(task, state)
    assert found.shape == (task.observations.count, 3, 2)
    share, little = PAINT.ks / (PAINT.kd + PAINT.ks), 2e-3 * PAINT.sigma**2
    response = response_of(task, state)

    def sent(variance: float) -> np.ndarray:
        there = state.guess._replace(variance=jnp.full(3, variance))
        diffuse, specular = response.source_diffuse(there), response.source_specular(there)
        own = (np.asarray(part)[:, None, :2] * energies[:2] for part in (diffuse, specular))
        return sum(w[:, None] * part for w, part in zip((1 - share, share), own))

    slopes = (sent(2 * little) - sent(little)) / little
    np.testing.assert_allclose(found, slopes, atol=0.05 * np.abs(slopes).max())
    np.testing.assert_allclose(
        np.linalg.norm(found, axis=0), np.linalg.norm(slopes, axis=0), rtol=0.05
    )


def test_a_source_of_no_width_is_a_point():
    seen = photographed()
    exact = integral_columns(PAINT, seen.samples, LightNodes(MIDDLE[None], np.ones((1, 3))))
    exact = exact + polar_columns(PAINT, seen.samples, lambda towards: 0.1 + 0 * towards)
    noisy = NOISE.add(np.asarray(radiance(PAINT, exact)), np.random.default_rng(1))
    task = task_of(1)._replace(observations=seen._replace(radiance=noisy))
    assert not may_be_wide(task, descend(task, lit(task, MIDDLE[None]), 12, 1e-6))


def test_three_in_a_row_are_a_crowd():
    task = task_of(4)
    state = lit(task, beside([0.0, 0.35, 0.7, 1.3]))
    assert crowded(state).tolist() == [True, True, True, False]
    assert not crowded(state._replace(active=np.array([True, True, False, True]))).any()


def test_errors_know_of_the_grain_of_a_crowd():
    task = task_of(3)
    state = at_standstill(task, with_widths(lit(task, beside([-0.15, 0.0, 0.15]))))
    grain = with_grain(task, state)
    count = len(grain.state.active)
    assert grain.count == 3 < count
    assert count % 8 == 3
    # Between the sources and about them, but never beside one.
    apart = np.asarray(grain.state.guess.directions)[grain.state.active]
    nearest = np.sort(apart @ apart.T, axis=1)[:, -2]
    sigma = float(jnp.exp(state.guess.sigma))
    assert np.all(nearest[3:] < np.cos(0.79 * sigma))
    assert np.all(nearest[3:] > np.cos(1.6 * sigma))
    plain = measured(task, state).penalty
    np.testing.assert_array_equal(grain.penalty[: len(plain)], plain)
    assert np.all(grain.penalty[len(plain) :] > 0)
    known = account_of(task, state, "per-channel").parameters
    assert known.if_exact is not None
    system = reduced_system(in_blocks(response_of(task, state), measured(task, state)), state.guess)
    free = free_unknowns(task, state)
    alone = np.linalg.inv(
        np.asarray(system.curvature)[np.ix_(free, free)] + 1e-9 * np.eye(free.sum())
    )
    exact, stated = (one.standard_error.of("sigma") for one in (known.if_exact, known))
    assert exact > 1.1 * sigma * np.sqrt(alone[3, 3])
    assert stated >= exact
    points = state._replace(guess=state.guess._replace(variance=None))
    assert with_grain(task, points).state.guess.variance is None
    assert len(with_grain(task, points).state.active) == count
    two = state._replace(active=np.array([True, True, False]))
    assert with_grain(task, two).state is two


def test_errors_reach_as_far_as_the_likeliest_grain(monkeypatch):
    task = task_of(3)
    state = at_standstill(task, with_widths(lit(task, beside([-0.15, 0.0, 0.15]))))
    whole = account_of(task, state, "per-channel").parameters.standard_error.of("sigma")
    found, own = [], Grain.moved

    def nowhere(*asked):
        found.append(own(*asked))
        return 0 * found[0]

    monkeypatch.setattr(Grain, "moved", nowhere)
    without = account_of(task, state, "per-channel").parameters.standard_error.of("sigma")
    grain = with_grain(task, state)
    sigma = float(jnp.exp(state.guess.sigma))
    reach = sigma * found[0][3]
    assert abs(reach) > 0.1 * without
    assert whole**2 - without**2 == pytest.approx(reach**2, rel=1e-6)
    # There the light with grain is at its best: nothing pulls any more.
    step = np.zeros(unknown_count(grain.state.guess))
    own_unknowns = grain.kept(len(grain.state.active), 0)[: len(step)]
    step[own_unknowns] = found[0][: len(own_unknowns)]
    data = measured(task, state)._replace(penalty=grain.penalty)
    blocks = in_blocks(response_of(task, grain.state), data)
    moved = _moved(grain.state.guess, jnp.asarray(step), task.bounds)
    before, after = (
        np.abs(np.asarray(reduced_system(blocks, guess).slope)[3])
        for guess in (grain.state.guess, moved)
    )
    assert after < 0.2 * before
