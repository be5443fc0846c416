"""To which degree slow light is followed.

- Light with bright spots, of more degrees than the rounds follow: it is followed as far as the lobe
  shows it, and then the photographs are explained to their noise.
- A recovery does so by itself where neighbouring pixels show that it leaves more than noise.
- Light of few degrees is not followed farther; nor is a degree that was stated, light seen by few
  samples, a lobe that shows no more, or a material without a frequency view.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import ball_samples, photograph, unit

from jaxrender.brdf import Microfacet, Parametric, brdf_named
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations, Outcome
from jaxrender.inverse.factorization import FIRST_DEGREE, FactorSettings, Known, factorize
from jaxrender.inverse.factorization.band_limits import followed_farther, task_of
from jaxrender.inverse.factorization.rounds import relit
from jaxrender.inverse.factorization.state import State, Task, begin, round_of
from jaxrender.inverse.stated import Unknown
from jaxrender.lighting import SmoothLobes

PAINT = Microfacet(np.array([0.24, 0.28, 0.2]), np.full(3, 0.12), 0.2, 1.45)
SHARE = tuple(PAINT.ks / (PAINT.kd + PAINT.ks))
NOISE = NoiseModel(0.003, 0.0001)
SETTINGS = FactorSettings(most_sources=1, noise=NOISE)
SPOTS = unit(np.array([[0.4, 0.5, 0.8], [-0.9, 0.3, 0.3], [0.2, -0.8, 0.6]]))
SLOW = SmoothLobes(
    np.array([[0.9, 0.5, 0.4], [0.0, 0.0, 1.0]]),
    np.radians([85.0, 89.0]),
    np.array([[1.0, 0.97, 0.92], [0.5, 0.5, 0.6]]),
)


def spotted(directions):
    """Three spots of 12 degrees' width in dim light."""
    cosines = directions @ jnp.asarray(SPOTS).T
    return 0.1 + 4 * jnp.sum(jnp.exp(40 * (cosines - 1)), axis=-1)[..., None].repeat(3, -1)


def photographed(light, count: int = 2000) -> Observations:
    samples, frame = ball_samples(count, 0.4, seed=1)
    exact = photograph(PAINT, samples, frame, light, None)
    return exact._replace(
        radiance=NOISE.add(np.asarray(exact.radiance), np.random.default_rng(0)),
    )


def task_under(
    seen: Observations, variant: Parametric = PAINT, settings: FactorSettings = SETTINGS
) -> tuple[Task, State]:
    """The light of a known material, before anything is known of it."""
    known = Known(SHARE, Unknown(fixed=(0.2,)), Unknown(fixed=(1.45,)))
    task = task_of(seen, variant, settings, known, None)
    return task, begin(task)


def known_material(seen: Observations) -> tuple[Task, State]:
    """The light of a known material, as the rounds end without sources."""
    task, state = task_under(seen)
    weights = 1 / np.asarray(NOISE.standard_deviation(task.radiance))
    return task, relit(task, state._replace(weights=weights))


@pytest.mark.slow
def test_light_of_many_degrees_is_followed_as_far_as_the_lobe_shows_it():
    task, state = known_material(photographed(spotted))
    farther = followed_farther(task, state, None)
    assert farther is not None
    finer, there = farther
    # 4 / sigma.
    assert (task.band_limit, finer.band_limit) == (FIRST_DEGREE, 20)
    before, after = round_of(task, state), round_of(finer, there)
    assert before.relative_rms > 1.7 * NOISE.relative
    assert after.relative_rms < 1.1 * NOISE.relative
    assert after.band_limit == 20


SHARP = dataclasses.replace(PAINT, sigma=0.15)


def neighbours() -> Observations:
    """Rows of three pixels that see the same, each with noise of its own."""
    samples, frame = ball_samples(600, 0.4, seed=1)
    exact = photograph(SHARP, samples, frame, spotted, None).take(np.repeat(np.arange(600), 3))
    noise = NoiseModel(0.01, 0.0005)
    noisy = noise.add(np.asarray(exact.radiance), np.random.default_rng(0))
    pixel = np.stack([np.repeat(np.arange(600), 3), np.tile(np.arange(3), 600)], axis=1)
    return exact._replace(radiance=noisy, pixel=pixel)


@pytest.mark.slow
def test_a_misfit_makes_the_recovery_follow_it():
    pool = neighbours()
    known = Known(SHARE, Unknown(fixed=(0.15,)), Unknown(fixed=(1.45,)))
    settings = FactorSettings(most_sources=1)
    found = factorize(pool, SHARP, settings, known, pool=pool)
    assert [one.band_limit for one in found.rounds[-2:]] == [FIRST_DEGREE, 20]
    assert found.outcome is Outcome.CONVERGED
    kept = factorize(pool, SHARP, settings._replace(band_limit=FIRST_DEGREE), known, pool=pool)
    assert kept.outcome is Outcome.MISFIT
    assert found.misfit.share < 0.1 < kept.misfit.share


@pytest.mark.slow
def test_light_of_few_degrees_is_not_followed_farther():
    assert followed_farther(*known_material(photographed(SLOW.radiance)), None) is None


@pytest.mark.parametrize(
    ("count", "settings", "sigma"),
    [
        (2000, SETTINGS._replace(band_limit=8), 0.2),
        (484, SETTINGS, 0.2),
        (1000, SETTINGS, 0.45),
    ],
)
def test_nor_is_what_was_stated_or_would_not_show(count, settings, sigma):
    task, state = task_under(photographed(spotted, count), settings=settings)
    guess = state.guess._replace(sigma=jnp.log(sigma))
    assert followed_farther(task, state._replace(guess=guess), None) is None


def test_nor_that_of_a_material_without_a_frequency_view():
    brushed = brdf_named("anisotropic-ward", kd=PAINT.kd, ks=PAINT.ks, roughness=0.2)
    task, state = task_under(photographed(spotted, 500), variant=brushed)
    assert followed_farther(task, state, None) is None
