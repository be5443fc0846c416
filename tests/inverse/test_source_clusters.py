"""Sources closer together than the lobe is wide.

- They are grouped neighbour by neighbour; a source far from all others stands alone.
- Centre and width of two equal lamps are half-way and half their distance.
- Their errors are those of many draws of energies and directions.
- Two lamps of a photographed ball make one cluster, whose sum is known better than each of them.
  Sum, centre and width are as far off as their errors say, over many draws of the noise.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import ball_samples, unit

from jaxrender.brdf import Microfacet
from jaxrender.geometry import world_from_local
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations
from jaxrender.inverse.factorization import FactorSettings, Known
from jaxrender.inverse.factorization.account import account_of
from jaxrender.inverse.factorization.recovered_scene import RecoveredScene
from jaxrender.inverse.factorization.response import MirrorResponse
from jaxrender.inverse.factorization.source_clusters import centred, grouped
from jaxrender.inverse.factorization.state import Task, begin, descend
from jaxrender.inverse.stated import Unknown
from jaxrender.lighting import DirectionalSources
from jaxrender.reflection import integral_columns, radiance

PAINT = Microfacet(np.array([0.24, 0.28, 0.2]), np.full(3, 0.12), 0.2, 1.45)
NOISE = NoiseModel(0.01, 0.0005)


def frames_at(directions: np.ndarray) -> np.ndarray:
    return np.asarray(world_from_local(jnp.asarray(directions)))[:, :, :2]


def beside(direction: np.ndarray, angles: list[float]) -> np.ndarray:
    """Directions on a great circle through one."""
    aside = frames_at(direction[None])[0, :, 0]
    return np.array([np.cos(a) * direction + np.sin(a) * aside for a in angles])


def test_neighbours_are_grouped():
    chain = beside(unit(np.array([0.2, 0.3, 0.9])), [0.0, 0.9, 0.15, 0.3])
    (found,) = grouped(chain, 0.2)
    assert found.tolist() == [0, 2, 3]
    assert grouped(chain, 0.1) == ()
    assert grouped(np.zeros((0, 3)), 0.1) == ()


def test_centre_and_width_of_two_lamps():
    middle = unit(np.array([0.2, 0.3, 0.9]))
    lamps = beside(middle, [-0.05, 0.05])
    found = centred(lamps, np.ones(2), frames_at(lamps), np.zeros((6, 6)))
    np.testing.assert_allclose(found.direction, middle, atol=1e-12)
    # A chord for an arc.
    assert found.width == pytest.approx(0.05, rel=1e-3)
    assert found.direction_error == found.width_error == 0


def test_errors_are_those_of_many_draws():
    rng = np.random.default_rng(0)
    lamps = beside(unit(np.array([0.2, 0.3, 0.9])), [0.0, 0.12, -0.1])
    energies, frames = np.array([1.0, 2.0, 1.5]), frames_at(lamps)
    mixed = rng.normal(size=(9, 9))
    covariance = 1e-6 * mixed @ mixed.T
    found = centred(lamps, energies, frames, covariance)
    drawn = rng.multivariate_normal(np.zeros(9), covariance, 20_000)
    steps = drawn[:, 3:6, None] * frames[:, :, 0] + drawn[:, 6:, None] * frames[:, :, 1]
    weights = energies + drawn[:, :3]
    moved = unit(lamps + steps)
    centres = unit(np.einsum("di,dij->dj", weights, moved))
    across = np.sqrt(np.mean(np.sum((centres - found.direction) ** 2, axis=1)))
    assert found.direction_error == pytest.approx(across, rel=0.03)
    apart = np.sum((moved - centres[:, None]) ** 2, axis=-1)
    widths = np.sqrt(np.sum(weights * apart, axis=1) / weights.sum(axis=1))
    assert found.width_error == pytest.approx(widths.std(), rel=0.03)


MIDDLE = unit(np.array([-0.35, 0.8, 0.5]))
LAMPS = beside(MIDDLE, [-0.05, 0.05])
ENERGIES = np.array([[1.2, 1.1, 1.0], [0.8, 0.9, 1.0]])
TOTAL = PAINT.kd + PAINT.ks


@pytest.fixture(scope="module")
def exact() -> Observations:
    samples, _ = ball_samples(1500, 0.15, seed=1)
    lamps = DirectionalSources(LAMPS, ENERGIES)
    seen = np.asarray(radiance(PAINT, integral_columns(PAINT, samples, lamps.nodes())))
    return Observations(samples, seen, np.zeros(len(seen), int))


def recovered(exact: Observations, seed: int) -> RecoveredScene:
    """The light of a known material, from noisy photographs and two sources near the lamps."""
    noisy = NOISE.add(np.asarray(exact.radiance), np.random.default_rng(seed))
    known = Known(tuple(PAINT.ks / TOTAL), Unknown(fixed=(0.2,)), Unknown(fixed=(1.45,)))
    response = MirrorResponse.of_convex(PAINT, exact.samples, 4, 3)
    settings = FactorSettings(4, 3, noise=NOISE)
    task = Task(exact._replace(radiance=noisy), response, known=known, settings=settings)
    state = begin(task)
    slots = np.array(state.guess.directions)
    slots[:2] = beside(MIDDLE, [-0.06, 0.03])
    weights = 1 / np.asarray(NOISE.standard_deviation(task.radiance))
    guess = state.guess._replace(directions=jnp.asarray(slots))
    active = np.array([True, True, False])
    state = descend(task, state._replace(guess=guess, active=active, weights=weights), 8)
    return account_of(task, state, "per-channel").scene


def test_two_lamps_of_a_ball_make_a_cluster(exact):
    scene = recovered(exact, 0)
    (cluster,) = scene.clusters
    assert cluster.members.tolist() == [0, 1]
    irradiance = np.asarray(scene.sources.irradiance)
    np.testing.assert_allclose(cluster.irradiance, irradiance.sum(axis=0), rtol=1e-6)
    assert np.all(cluster.irradiance_error < 0.5 * scene.energy_error.min(axis=0))
    # No lamp is known better than to the width of the cluster.
    assert np.all(scene.direction_error >= cluster.width)


@pytest.mark.slow
def test_its_errors_are_those_of_many_photographs(exact):
    """Noise drawn anew: what is off is as large as it is said to be."""
    weights = (ENERGIES * TOTAL).sum(axis=1)
    centre = unit(weights @ LAMPS)
    width = np.sqrt(weights @ np.sum((LAMPS - centre) ** 2, axis=1) / weights.sum())
    off = []
    for seed in range(40):
        (one,) = recovered(exact, seed).clusters
        total = (one.irradiance - ENERGIES.sum(axis=0) * TOTAL) / one.irradiance_error
        aside = np.linalg.norm(one.direction - centre) / one.direction_error
        off.append([*total, aside, (one.width - width) / one.width_error])
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    # Of 40 draws the root mean square is known to a ninth.
    assert np.all((rms > 0.65) & (rms < 1.4)), rms
