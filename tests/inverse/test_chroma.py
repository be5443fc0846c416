"""The colours of a recovered light tied together.

- What is found is the minimum of the quadratic that it stands for, by a dense system of all
  channels and parts; so is its covariance.
- Of a grey light whose channels were found with errors of their own, the tied one is nearer to the
  truth by about the root of three, and as near as it says.
- A colourful light stays as it is; so do one of one channel, and one whose fine light alone has
  colours.
"""

import numpy as np
import pytest

from jaxrender.harmonics import degrees
from jaxrender.inverse.factorization import tied
from jaxrender.inverse.factorization.chroma import _expected
from jaxrender.inverse.factorization.recovered_scene import RecoveredScene
from jaxrender.lighting import DirectionalSources

LIMIT = 6
DEGREE = degrees(LIMIT)
COUNT = len(DEGREE)
COLOUR = np.array([1.0, 0.8, 0.5])
SOURCE = np.array([[0.0, 0.6, 0.8]])


def recovered(chroma: float, seed: int = 0) -> tuple[RecoveredScene, np.ndarray]:
    """A light whose channels differ by a part of its pattern, found with errors; and the truth."""
    rng = np.random.default_rng(seed)
    fading = 1 / (1 + DEGREE) ** 2
    pattern = rng.normal(size=COUNT) * fading
    pattern[0] = 4
    own = chroma * rng.normal(size=(COUNT, 3)) * fading[:, None]
    own[0] = 0
    truth = (pattern[:, None] + own) * COLOUR
    errors = np.append(np.where(DEGREE < 4, 0.002, 0.03), 0.05)
    mixed = np.eye(COUNT + 1) + 0.1 * rng.normal(size=(COUNT + 1, COUNT + 1))
    covariance = np.stack([np.outer(errors, errors) * (mixed @ mixed.T) * c**2 for c in COLOUR])
    noise = np.stack([rng.multivariate_normal(np.zeros(COUNT + 1), one) for one in covariance])
    sources = DirectionalSources(SOURCE, (COLOUR + noise[:, COUNT])[None])
    found = truth + noise[:, :COUNT].T
    return RecoveredScene(found, sources, covariance, np.zeros(1), np.ones(LIMIT + 1)), truth


def test_it_is_the_minimum_by_a_dense_system():
    scene, _ = recovered(0.1)
    level, parts = scene.slow[0], COUNT + 1
    found = np.concatenate([scene.slow, np.asarray(scene.sources.irradiance, float)]).T
    precision = np.zeros((3 * parts, 3 * parts))
    for channel in range(3):
        own = slice(channel * parts, (channel + 1) * parts)
        precision[own, own] = np.linalg.inv(scene.covariance[channel])
    # Squared deviations of the channels' patterns from their mean, over the variance expected.
    from scipy.linalg import helmert

    contrasts = helmert(3) / level
    expected = _expected(scene.slow / level, contrasts @ scene.slow[1:].T)
    coupled = np.zeros_like(precision)
    centred = (np.eye(3) - 1 / 3) / level[:, None] / level
    for k in range(1, COUNT):
        at = np.arange(3) * parts + k
        coupled[np.ix_(at, at)] = centred / expected[k - 1]
    covariance = np.linalg.inv(precision + coupled)
    wanted = (covariance @ precision @ found.ravel()).reshape(3, parts)
    light = tied(scene)
    np.testing.assert_allclose(light.slow, wanted[:, :COUNT].T, atol=1e-7)
    np.testing.assert_allclose(light.sources.irradiance[0], wanted[:, COUNT], atol=1e-6)
    for channel, own in enumerate(light.covariance):
        at = slice(channel * parts, (channel + 1) * parts)
        np.testing.assert_allclose(own, covariance[at, at], atol=1e-9)


def test_a_grey_light_is_nearer_to_the_truth():
    before, after, stated = [], [], []
    for seed in range(20):
        scene, truth = recovered(0.0, seed)
        light = tied(scene)
        fine = DEGREE >= 4
        before.append(((scene.slow - truth) / COLOUR)[fine])
        after.append(((light.slow - truth) / COLOUR)[fine])
        stated.append((light.slow_error / COLOUR)[fine])
    was, now, said = (np.sqrt(np.mean(np.square(one))) for one in (before, after, stated))
    assert now < 0.65 * was
    assert now == pytest.approx(said, rel=0.1)


def test_a_colourful_light_stays():
    scene, truth = recovered(1.0)
    light = tied(scene)
    changed = (light.slow - scene.slow) / scene.slow_error
    assert np.sqrt(np.mean(changed[DEGREE < 4] ** 2)) < 0.4
    off = (light.slow - truth) / light.slow_error
    assert np.sqrt(np.mean(off**2)) < 1.3


def test_a_light_of_one_channel_stays():
    scene, _ = recovered(0.1)
    one = scene._replace(
        slow=scene.slow[:, :1],
        sources=DirectionalSources(SOURCE, np.asarray(scene.sources.irradiance)[:, :1]),
        covariance=scene.covariance[:1],
    )
    assert tied(one) is one


def test_a_light_that_would_leave_what_is_known_stays():
    """Fine light alone has colours, ten errors above its own."""
    scene, _ = recovered(0.0)
    slow = scene.slow.copy()
    slow[DEGREE >= 4] += 0.3 * np.random.default_rng(1).normal(size=(np.sum(DEGREE >= 4), 3))
    colourful = scene._replace(slow=slow)
    assert tied(colourful) is colourful
    assert tied(scene) is not scene
