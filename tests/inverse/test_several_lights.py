"""Captures of one object, each in a light of its own.

- What the samples of a capture are lit by is that capture's light: environment, sources, rotation.
- Two captures together tell more than each alone, as much as is foreseen, and the truth comes back.
- Each environment has a rotation of its own, and both are found with the material.
- Dropped photographs take their light with them; what does not fit together is refused.

Photographs are integrals over images twice as fine as those that fits are told, with noise.
"""

import dataclasses

import numpy as np
import pytest
from ball_problems import BRDF, CLEAN, ENERGY, LAMP, LIGHT, photographed
from inverse_problems import parameter_vector
from scipy.spatial.transform import Rotation

from jaxrender.geometry import Sphere, SurfacePlaces, SurfaceSamples
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import (
    FitSettings,
    KnownLight,
    Observations,
    Outcome,
    Scene,
    fit,
    fit_brdf,
    unknown,
    unknowns_of,
)
from jaxrender.inverse.forecast import Situation, Supposed, forecast_material, foresee
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import ExactModel
from jaxrender.lighting import DirectionalSources, HarmonicLight

SEEN = CLEAN.take(np.arange(0, CLEAN.count, 3))
VIEWS = SEEN.frames
NOISE = NoiseModel(0.01, 0.0)
NONE = DirectionalSources.none()
# The same detail elsewhere: its rotation shows as well as that of the first.
OTHER = np.concatenate([LIGHT[:1], np.roll(LIGHT[1:], 5, axis=0)])


def lit(coefficients, rows=32, turn=None):
    image = HarmonicLight(coefficients).to_environment(rows)
    return image if turn is None else image.turned(turn)


def noisy(pixels, seed):
    return NOISE.add(pixels, np.random.default_rng(seed))


def together(first, second):
    """Put two captures of the same cameras behind each other."""

    def both(own):
        return np.concatenate([np.asarray(own), np.asarray(own)])

    return Observations(
        SurfaceSamples(*map(both, SEEN.samples)),
        np.concatenate([first, second]),
        np.concatenate([SEEN.frame, SEEN.frame + VIEWS]),
        SurfacePlaces(*map(both, SEEN.places)),
        pixel=both(SEEN.pixel),
        eyes=both(SEEN.eyes),
    )


FIRST = KnownLight(lit(LIGHT), NONE)
SECOND = KnownLight(lit(OTHER), DirectionalSources(LAMP, ENERGY))
BOTH = KnownLight.joined([FIRST, SECOND], [VIEWS, VIEWS])
PIXELS = (
    noisy(photographed(SEEN, lit(LIGHT, 64), energy=0 * ENERGY), 0),
    noisy(photographed(SEEN, lit(OTHER, 64)), 1),
)
CAPTURES = together(*PIXELS)
KIND = dataclasses.replace(BRDF, sigma=0.1)


def fitted(observations, light, **settings):
    chosen = FitSettings(starts=1, refine_samples=2000, noise=NOISE, **settings)
    unknowns = unknowns_of(KIND)
    return fit_brdf(observations, light, unknowns, KIND, chosen, shape=Sphere(), pool=observations)


def off(found):
    """Say how many standard errors the material is off, at the worst."""
    truth = [*BRDF.kd, BRDF.ks[0], BRDF.sigma, BRDF.mu]
    wrong = parameter_vector(found.parameters.value) - truth
    return np.max(np.abs(wrong / parameter_vector(found.parameters.standard_error)))


def under(observations, light):
    """Integrate the material over a light's point masses."""
    nodes = exact_nodes(light, np.asarray(observations.frame), 1.0)
    columns = ExactModel(BRDF, observations.samples, nodes).columns(BRDF.numbers)
    return np.asarray(columns.times(BRDF.amplitudes))


def test_each_photograph_is_lit_as_its_capture_is():
    turns = Rotation.random(2, random_state=3).as_matrix()
    light = dataclasses.replace(BOTH, turns=turns[BOTH.image_of_frame])
    some = CAPTURES.take(np.arange(0, CAPTURES.count, 40))
    found = under(some, light)
    for capture, (own, turn) in enumerate(zip((FIRST, SECOND), turns)):
        mine = np.flatnonzero(np.asarray(some.frame) // VIEWS == capture)
        alone = dataclasses.replace(own, turn=turn)
        np.testing.assert_allclose(found[mine], under(some.take(mine), alone), rtol=1e-12)
        np.testing.assert_array_equal(
            light.upright.of_frame(capture * VIEWS).environment.radiance,
            alone.upright.environment.radiance,
        )


def errors_of(parameters):
    return parameter_vector(parameters.standard_error)


def foreseen(observations, light):
    """Foresee the errors of all numbers."""
    situation = Situation(observations.samples, observations.frame, light)
    expected = foresee(situation, Supposed(BRDF, NOISE), count=observations.count)
    return errors_of(forecast_material(expected, explain=False).parameters)


@pytest.mark.slow
def test_two_captures_tell_what_both_tell():
    found = fitted(CAPTURES, BOTH)
    assert found.outcome is Outcome.CONVERGED
    assert off(found) < 4
    expected = foreseen(CAPTURES, BOTH)
    np.testing.assert_allclose(errors_of(found.parameters), expected, rtol=0.2)
    for first in (0, VIEWS):
        alone = BOTH.of_frames(range(first, first + VIEWS))
        assert np.all(expected < foreseen(SEEN, alone))


@pytest.mark.slow
def test_each_environment_turns_by_itself():
    turns = np.radians([[0.0, 0.0, 2.0], [-1.5, 0.5, 0.0]])
    images = [
        lit(coefficients, 64, Rotation.from_rotvec(turn).as_matrix())
        for coefficients, turn in zip((LIGHT, OTHER), turns)
    ]
    first = noisy(photographed(SEEN, images[0], energy=0 * ENERGY), 2)
    wrong = together(first, noisy(photographed(SEEN, images[1]), 3))
    found = fitted(wrong, BOTH, free=("environment",))
    assert off(found) < 4
    apart = found.calibration.corrections.environment - turns
    error = found.calibration.errors["environment"].reshape(2, 3)
    assert np.max(np.abs(apart) / error) < 4
    assert np.max(error) < np.radians(0.2)


def test_dropped_photographs_take_their_light_with_them():
    kept = BOTH.of_frames([0, VIEWS + 1])
    assert kept.frames == 2
    assert [kept.environment_of(frame) for frame in range(2)] == [
        FIRST.environment,
        SECOND.environment,
    ]
    np.testing.assert_array_equal(kept.of_frame(1).directional.irradiance, ENERGY)
    lamp = KnownLight(None, DirectionalSources(LAMP, ENERGY))
    last = KnownLight.joined([FIRST, lamp], [1, 1]).of_frames([1])
    assert not last.has_environment
    np.testing.assert_allclose(last.of_frame(0).directional.directions, LAMP)


def test_what_does_not_fit_together_is_refused():
    scene = Scene(unknown("ggx"), Sphere(), (lit(LIGHT), lit(OTHER)))
    with pytest.raises(ValueError, match="2 lights for 1 captures; give each capture its light"):
        fit(scene, CAPTURES)
    with pytest.raises(ValueError, match="no photographs; give at least one capture"):
        fit(scene, [])
    with pytest.raises(ValueError, match="per_frame lights 1 photographs of 3"):
        scene._replace(per_frame=(NONE,)).known_light([1, 2], 3)
    with pytest.raises(ValueError, match="one environment for all photographs, or one for each"):
        KnownLight(lit(LIGHT), NONE, environments=(lit(LIGHT),))
