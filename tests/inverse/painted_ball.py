"""A painted ball under an area light and a source: exact photographs with noise, and their fits."""

import functools

import jax.numpy as jnp
import numpy as np
from inverse_problems import ball_samples

from jaxrender.brdf import Microfacet
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations
from jaxrender.inverse.factorization import FactorSettings, Known
from jaxrender.inverse.factorization.response import MirrorResponse
from jaxrender.inverse.factorization.state import State, Task, begin, descend
from jaxrender.inverse.stated import Unknown
from jaxrender.lighting import DirectionalSources, SmoothLobes
from jaxrender.reflection import integral_columns, polar_columns, radiance

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


@functools.cache
def photographed() -> Observations:
    """An area light and a source on a painted ball, by the exact integral, with noise."""
    samples, _ = ball_samples(1500, 0.15, seed=1)
    source = DirectionalSources(SOURCE[None], ENERGY[None])
    columns = integral_columns(PAINT, samples, source.nodes())
    columns = columns + polar_columns(PAINT, samples, AREA.radiance)
    exact = np.asarray(radiance(PAINT, columns))
    noisy = NOISE.add(exact, np.random.default_rng(0))
    return Observations(samples, noisy, np.zeros(len(noisy), int))


def task_of(photographs: Observations) -> Task:
    response = MirrorResponse.of_convex(PAINT, photographs.samples, BAND_LIMIT, SOURCES)
    settings = FactorSettings(BAND_LIMIT, SOURCES)
    return Task(photographs, response, settings=settings)


def with_sources(task: Task, directions: list[np.ndarray]) -> State:
    """A state at the true material with sources in the given directions, fitted."""
    known = begin(task._replace(known=Known((0.32, 0.29, 0.365), SIGMA, MU)))
    slots, active = np.array(known.guess.directions), known.active.copy()
    for slot, direction in enumerate(directions):
        slots[slot], active[slot] = direction / np.linalg.norm(direction), True
    guess = known.guess._replace(directions=jnp.asarray(slots))
    weights = 1 / np.asarray(NOISE.standard_deviation(task.radiance))
    return descend(task, known._replace(guess=guess, active=active, weights=weights), 8)
