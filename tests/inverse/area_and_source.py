"""A ball under two smooth area lights and one source: exact photographs, with noise."""

import numpy as np
from inverse_problems import ball_samples

from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations
from jaxrender.lighting import DirectionalSources, SmoothLobes
from jaxrender.reflection import integral_columns, polar_columns, radiance

KD = np.array([0.245, 0.281, 0.2])
SOURCE = np.array([-0.35, 0.8, 0.5]) / np.linalg.norm([-0.35, 0.8, 0.5])
ENERGY = np.array([1.2, 1.15, 1.05])
AREA = SmoothLobes(
    np.array([[0.9, 0.5, 0.4], [0.0, 0.0, 1.0]]),
    np.radians([75.0, 85.0]),
    np.array([[1.0, 0.97, 0.92], [0.06, 0.07, 0.09]]),
)
NOISE = NoiseModel(0.01, 0.0005)


def photographs(truth) -> Observations:
    samples, _ = ball_samples(900, 0.15, seed=1)
    source = DirectionalSources(SOURCE[None], ENERGY[None])
    columns = integral_columns(truth, samples, source.nodes())
    columns = columns + polar_columns(truth, samples, AREA.radiance)
    exact = np.asarray(radiance(truth, columns))
    return Observations(
        samples, NOISE.add(exact, np.random.default_rng(0)), np.zeros(len(exact), int)
    )
