"""Sources closer together than the lobe is wide.

- They are grouped neighbour by neighbour; a source far from all others stands alone.
- Centre and width of two equal lamps are half-way and half their distance.
- Their errors are those of many draws of energies and directions.
- Two lamps of a photographed ball make one cluster: its sum and centre are within their errors,
  which are smaller than those of the lamps.  In units of the material it is scaled as they are.
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
from jaxrender.inverse.factorization.response import MirrorResponse
from jaxrender.inverse.factorization.source_clusters import centred, grouped
from jaxrender.inverse.factorization.state import Task, begin, descend
from jaxrender.inverse.unknowns import Unknown
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


def test_two_lamps_of_a_ball_make_a_cluster():
    middle = unit(np.array([-0.35, 0.8, 0.5]))
    lamps = beside(middle, [-0.05, 0.05])
    samples, _ = ball_samples(1500, 0.15, seed=1)
    energies = np.array([[1.2, 1.1, 1.0], [0.8, 0.9, 1.0]])
    both = DirectionalSources(lamps, energies)
    exact = np.asarray(radiance(PAINT, integral_columns(PAINT, samples, both.nodes())))
    noisy = NOISE.add(exact, np.random.default_rng(0))
    seen = Observations(samples, noisy, np.zeros(len(noisy), int))
    total = PAINT.kd + PAINT.ks
    known = Known(tuple(PAINT.ks / total), Unknown(fixed=(0.2,)), Unknown(fixed=(1.45,)))
    response = MirrorResponse.of_convex(PAINT, samples, 4, 3)
    task = Task(seen, response, known=known, settings=FactorSettings(4, 3, noise=NOISE))
    state = begin(task)
    slots = np.array(state.guess.directions)
    slots[:2] = beside(middle, [-0.06, 0.03])
    weights = 1 / np.asarray(NOISE.standard_deviation(task.radiance))
    guess = state.guess._replace(directions=jnp.asarray(slots))
    active = np.array([True, True, False])
    state = descend(task, state._replace(guess=guess, active=active, weights=weights), 8)

    scene = account_of(task, state, "per-channel").scene
    (cluster,) = scene.clusters
    assert cluster.members.tolist() == [0, 1]
    irradiance = np.asarray(scene.sources.irradiance)
    np.testing.assert_allclose(cluster.irradiance, irradiance.sum(axis=0), rtol=1e-6)
    off = cluster.irradiance - energies.sum(axis=0) * total
    assert np.all(np.abs(off) < 4 * cluster.irradiance_error)
    assert np.all(cluster.irradiance_error < 0.5 * scene.energy_error.min(axis=0))
    weights = energies.sum(axis=1)
    centre = unit(weights @ lamps)
    assert np.linalg.norm(cluster.direction - centre) < 4 * cluster.direction_error < 0.01
    assert abs(cluster.width - 0.05) < 4 * cluster.width_error < 0.02
    # No lamp is known better than to the width of the cluster.
    assert np.all(scene.direction_error >= cluster.width)
