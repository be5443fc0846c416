"""Where a factorization begins.

- Widths: the known one alone, or those within the bounds, the stated one among them.
- Under smooth light and under a source, the search ends at one material from any start, and finds
  no source that is not there.
- Clipped photographs are a misfit, and the reason says so.
"""

import numpy as np
import pytest
from inverse_problems import ball_samples

from jaxrender.brdf import WIDTH_BOUNDS, Microfacet
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations, Outcome
from jaxrender.inverse.factorization import FactorSettings, Known, factorize
from jaxrender.inverse.factorization.response import MirrorResponse
from jaxrender.inverse.factorization.starts import widths
from jaxrender.inverse.factorization.state import Task
from jaxrender.inverse.unknowns import Unknown
from jaxrender.lighting import DirectionalSources, SmoothLobes
from jaxrender.reflection import integral_columns, polar_columns, radiance

PAINT = Microfacet(np.array([0.24, 0.28, 0.2]), np.full(3, 0.12), 0.2, 1.45)
SMOOTH = SmoothLobes(
    np.array([[0.9, 0.5, 0.4], [0.0, 0.0, 1.0]]),
    np.radians([85.0, 89.0]),
    np.array([[1.0, 0.97, 0.92], [0.5, 0.5, 0.6]]),
)
LAMP = DirectionalSources(np.array([[-0.36, 0.8, 0.48]]), np.array([[1.2, 1.15, 1.05]]))
SETTINGS = FactorSettings(6, 8)


def photographed(source: bool) -> Observations:
    samples, _ = ball_samples(1500, 0.15, seed=1)
    columns = polar_columns(PAINT, samples, SMOOTH.radiance)
    if source:
        columns = columns + integral_columns(PAINT, samples, LAMP.nodes())
    noisy = NoiseModel(0.01, 0.0).add(
        np.asarray(radiance(PAINT, columns)), np.random.default_rng(0)
    )
    return Observations(samples, noisy, np.zeros(len(noisy), int))


def starting(start: float | None) -> Known:
    return Known(sigma=Unknown(None, *WIDTH_BOUNDS, start=start))


@pytest.mark.parametrize(
    ("sigma", "expected"),
    [
        (Unknown(fixed=(0.17,)), [0.17]),
        (Unknown(None, *WIDTH_BOUNDS), [0.25, 0.08]),
        (Unknown(None, *WIDTH_BOUNDS, start=0.4), [0.4, 0.08, 0.25]),
        (Unknown(None, 0.1, 0.2), [0.2]),
    ],
)
def test_widths_to_begin_with(sigma, expected):
    samples, _ = ball_samples(20, 0.15, seed=1)
    response = MirrorResponse.of_convex(PAINT, samples, 2, 1)
    nothing = Observations(samples, np.ones((20, 3)), np.zeros(20, int))
    task = Task(nothing, response, known=Known(sigma=sigma))
    assert widths(task) == pytest.approx(expected)


def test_clipped_photographs_are_a_misfit():
    photographs = photographed(False)
    whole = np.asarray(photographs.radiance)
    clipped = photographs._replace(radiance=np.minimum(whole, np.quantile(whole, 0.7)))
    found = factorize(clipped, PAINT, SETTINGS._replace(refine=False), pool=clipped)
    assert found.outcome is Outcome.MISFIT
    assert any("they are clipped, and capture.saturation" in reason for reason in found.reasons)


@pytest.mark.parametrize(
    "source", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["smooth", "source"]
)
def test_the_same_is_found_from_any_start(source):
    photographs = photographed(source)
    found = [factorize(photographs, PAINT, SETTINGS, starting(at)) for at in (None, 0.4)]
    for one in found:
        assert len(one.scene.sources.directions) == source
        off = abs(float(one.brdf.sigma) - 0.2) / float(one.parameters.standard_error.of("sigma"))
        assert off < 3.5
    sigma = [float(one.brdf.sigma) for one in found]
    assert sigma[0] == pytest.approx(sigma[1], rel=2e-3)
