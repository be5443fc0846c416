"""What would explain the rest where the light is unknown too.

- The derivatives are differences of the prediction, and of the parameters, of moved unknowns.
- A wrong lobe and differing exposures are named, and the error bars contain them; no cause is
  named where nothing is wrong.
- The errors of light, sources and their clusters reach as far as causes shift them.
- What light can make by itself, a gain in each channel, is no cause.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from ball_problems import BRDF, CLEAN, LIGHT, PHOTOGRAPHS, photographed
from factored_balls import SETTINGS, factored, noisy, off

from jaxrender.brdf import material_named
from jaxrender.inverse import Outcome
from jaxrender.inverse.diagnosis.light_parts import LightParts
from jaxrender.inverse.factorization.account import account_of, widened_light
from jaxrender.inverse.factorization.band_limits import task_of
from jaxrender.inverse.factorization.gauges import gauge_factors
from jaxrender.inverse.factorization.projection import mixed
from jaxrender.inverse.factorization.response import specular_share
from jaxrender.inverse.factorization.rounds import light_the_scene
from jaxrender.inverse.factorization.source_clusters import SourceCluster
from jaxrender.inverse.factorization.state import NOTHING_KNOWN, response_of
from jaxrender.inverse.factorization.suspicion import derivatives_of
from jaxrender.lighting import DirectionalSources

STEP = 1e-5


@pytest.fixture(scope="module")
def ended():
    """A task, and where its rounds ended."""
    task = task_of(noisy(PHOTOGRAPHS), BRDF, SETTINGS, NOTHING_KNOWN, None)
    return task, light_the_scene(task, lambda round_: None)


def test_the_derivatives_are_differences(ended):
    task, state = ended
    index = np.arange(0, task.observations.count, 7)
    found = derivatives_of(task, state, "dielectric", index)
    response, light = response_of(task, state), np.asarray(state.joint.solved.light)
    slow, sources = response.slow_count, np.flatnonzero(state.active)

    def predicted(guess, light):
        every = np.asarray(mixed(response.columns(guess), specular_share(guess)))[:, index]
        return np.einsum("csp,pc->sc", every, light)

    def difference(guess, light):
        return (predicted(guess, light) - predicted(state.guess, start)) / STEP * found.weights

    start = light
    moved = state.guess._replace(sigma=state.guess.sigma + STEP)
    np.testing.assert_allclose(
        found.by_unknown[:, :, 3], difference(moved, light), rtol=1e-3, atol=1e-3
    )
    for number, part in enumerate([0, slow + sources[0]]):
        more = light.copy()
        more[part, 1] += STEP
        # Of the mean, and of the first source, the channels follow each other.
        column = 3 + 2 + 2 * len(sources) + 3 * number + 1
        np.testing.assert_allclose(
            found.by_unknown[:, :, column], difference(state.guess, more), rtol=1e-5, atol=1e-6
        )
    np.testing.assert_allclose(
        found.weights * (task.radiance - predicted_all(response, state))[index], found.residual
    )


def predicted_all(response, state):
    return np.einsum(
        "csp,pc->sc",
        np.asarray(mixed(response.columns(state.guess), specular_share(state.guess))),
        np.asarray(state.joint.solved.light),
    )


def test_parameters_move_as_those_of_moved_unknowns(ended):
    task, state = ended
    found = derivatives_of(task, state, "dielectric", np.arange(10))
    before = account_of(task, state, "dielectric").parameters.value
    logit = state.guess.specular_logit + STEP * jnp.eye(3)[1]
    moved = state._replace(guess=state.guess._replace(specular_logit=logit))
    after = account_of(task, moved, "dielectric").parameters.value
    slopes = [(after.of(name) - before.of(name)) / STEP for name in ("kd", "ks")]
    np.testing.assert_allclose(found.parameters[:6, 1], np.concatenate(slopes), atol=1e-4)
    # The gauge of a metal asks for the mean radiance, which is the first coefficient.
    found = derivatives_of(task, state, "metal", np.arange(10))
    share = np.asarray(specular_share(state.guess))
    mean = np.asarray(state.joint.solved.light)[0]
    factors = [gauge_factors(share, mean + step * np.eye(3)[2], "metal") for step in (0, STEP)]
    slope = (factors[1] - factors[0]) / STEP
    column = 3 + 2 + 2 * int(state.active.sum()) + 2
    expected = np.concatenate([(1 - share) * slope, share * slope])
    np.testing.assert_allclose(found.parameters[:6, column], expected, rtol=1e-3)


def test_errors_of_the_light_reach_as_far_as_it_is_shifted(ended):
    task, state = ended
    scene = account_of(task, state, "per-channel").scene
    light = np.asarray(state.joint.solved.light)
    slow, on = task.response.slow_count, np.flatnonzero(state.active)
    brightest = on[np.argmax(light[slow + on].sum(axis=1))]
    of_light = np.zeros((*light.T.shape, 2))
    of_light[1, 2, 0] = 0.3
    of_light[:, slow + brightest, 1] = 0.04, 0.03, 0.02
    steps = np.zeros((2, len(state.active), 2))
    steps[:, brightest, 1] = 0.03, 0.04
    shifts = np.concatenate([of_light.reshape(-1, 2), steps.reshape(-1, 2)])
    alone = SourceCluster(np.array([0]), np.eye(3)[2], 0.01, 0.0, 0.0, np.ones(3), np.full(3, 0.1))
    before = scene._replace(clusters=(alone,))
    after = widened_light(task, state, before, "per-channel", shifts)
    slow_error = scene.slow_error.copy()
    slow_error[2, 1] = np.hypot(slow_error[2, 1], 0.3)
    np.testing.assert_allclose(after.slow_error, slow_error)
    energy = np.hypot(scene.energy_error[0], [0.04, 0.03, 0.02])
    np.testing.assert_allclose(after.energy_error[0], energy)
    np.testing.assert_allclose(after.direction_error[0], np.hypot(scene.direction_error[0], 0.05))
    np.testing.assert_allclose(after.direction_error[1:], scene.direction_error[1:])
    (one,) = after.clusters
    assert one.direction_error == pytest.approx(np.hypot(0.01, 0.05))
    np.testing.assert_allclose(one.irradiance_error, np.hypot(0.1, [0.04, 0.03, 0.02]))


def test_the_brightest_sources_stand_by_themselves():
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(6, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    energies = np.array([0.5, 3, 0.1, 2, 4, 1])[:, None] * np.ones(3)
    groups = LightParts.found(LIGHT, DirectionalSources(directions, energies)).sources(
        np.zeros(1, int)
    )
    brightest = [float(one.nodes.irradiance[0, 0]) for one in groups]
    assert brightest == [4, 3, 2, 1, 0.5]
    assert [len(one.nodes.directions) for one in groups] == [1, 1, 1, 1, 2]
    np.testing.assert_array_equal(groups[0].nodes.directions[0], directions[4])


def light_off(found):
    """Errors of the light's first coefficients in standard errors, rms."""
    count, level = len(LIGHT), np.mean(BRDF.kd + BRDF.ks)
    scene = found.scene
    return np.sqrt(np.mean(((scene.slow[:count] - level * LIGHT) / scene.slow_error[:count]) ** 2))


def test_nothing_is_named_where_nothing_is_wrong():
    found = factored(PHOTOGRAPHS * np.array([1.1, 1.0, 0.9]))
    assert found.outcome is Outcome.CONVERGED
    assert not found.diagnosis


@pytest.mark.slow
def test_a_wrong_lobe_is_named_and_in_the_error_bars():
    numbers = {"kd": BRDF.kd, "ks": BRDF.ks, **BRDF.numbers}
    photographs = photographed(CLEAN, brdf=material_named("ggx", numbers))
    found = factored(photographs)
    assert found.outcome is Outcome.MISFIT
    assert found.diagnosis[0].cause == "lobe"
    assert "the lobe has another shape" in found.reasons[1]
    assert not found.identifiable["mu"]
    assert found.reasons[-1].endswith("what is wrong may have moved it so far")
    exact = found.parameters.if_exact
    assert off(found) < 3.5 < off(found._replace(parameters=exact))
    # Of the light as well as of the material.
    assert light_off(found) < 1.5 < light_off(factored(photographs, diagnose=False))


@pytest.mark.slow
def test_differing_exposures_are_named():
    found = factored(PHOTOGRAPHS * (1 + 0.03 * np.cos(1.7 * CLEAN.frame))[:, None])
    assert found.diagnosis[0].cause == "exposure"
    assert off(found) < 3.5
    assert not factored(PHOTOGRAPHS + 0.03, diagnose=False).diagnosis
