"""Where a factorization begins.

- Widths: the known one alone, or those within the bounds, the stated one among them.
- Under smooth light from a start that is too sharp, and under a source from the usual one, the
  material is found within its errors, and no source that is not there.
- Clipped photographs are a misfit, and the reason says so.
"""

import numpy as np
import pytest
from inverse_problems import ball_samples, photograph, unit

from jaxrender.brdf import WIDTH_BOUNDS, Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations, Outcome
from jaxrender.inverse.factorization import FactorSettings, Known, factorize
from jaxrender.inverse.factorization.response import MirrorResponse
from jaxrender.inverse.factorization.starts import widths
from jaxrender.inverse.factorization.state import Task
from jaxrender.inverse.stated import Unknown
from jaxrender.lighting import DirectionalSources, SmoothLobes

PAINT = Microfacet(np.array([0.24, 0.28, 0.2]), np.full(3, 0.12), 0.2, 1.45)
SMOOTH = SmoothLobes(
    np.array([[0.9, 0.5, 0.4], [0.0, 0.0, 1.0]]),
    np.radians([85.0, 89.0]),
    np.array([[1.0, 0.97, 0.92], [0.5, 0.5, 0.6]]),
)
LAMP = DirectionalSources(np.array([[-0.36, 0.8, 0.48]]), np.array([[1.2, 1.15, 1.05]]))
SETTINGS = FactorSettings(6, 8)


def on_the_disk(count: int, views: int = 12) -> tuple[SurfaceSamples, np.ndarray]:
    """Draw samples of a ball from a ring of views as pixels lie, evenly over its disk."""
    rng = np.random.default_rng(3)
    frame = rng.integers(views, size=count)
    azimuth = 2 * np.pi * frame / views + 0.1
    outgoing = unit(np.stack([np.cos(azimuth), np.sin(azimuth), np.full(count, 0.25)], axis=-1))
    radius = np.sqrt(rng.uniform(0, 1 - 0.15**2, count))[:, None]
    across = unit(np.cross(outgoing, rng.normal(size=(count, 3))))
    return SurfaceSamples(radius * across + np.sqrt(1 - radius**2) * outgoing, outgoing), frame


def photographed(source: bool) -> Observations:
    """Photograph few pixels under slow light and a source; or more, and grazing, without it."""
    samples, frame = on_the_disk(320) if source else ball_samples(1500, seed=1)
    lamp = LAMP if source else None
    exact = photograph(PAINT, samples, frame, SMOOTH.radiance, lamp)
    noisy = NoiseModel(0.01, 0.0).add(np.asarray(exact.radiance), np.random.default_rng(0))
    return exact._replace(radiance=noisy)


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


@pytest.mark.slow
def test_clipped_photographs_are_a_misfit():
    photographs = photographed(False)
    whole = np.asarray(photographs.radiance)
    clipped = photographs._replace(radiance=np.minimum(whole, np.quantile(whole, 0.7)))
    found = factorize(clipped, PAINT, SETTINGS._replace(refine=False), pool=clipped)
    assert found.outcome is Outcome.MISFIT
    assert any("they are clipped, and capture.saturation" in reason for reason in found.reasons)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "start"), [(False, 0.06), (True, None)], ids=["smooth", "source"]
)
def test_the_material_is_found_whatever_the_start(source, start):
    """From .06 alone, smooth light ends as two sources under a lobe that is too sharp.

    Slow light that lacks its source makes the lobe too sharp as well: sources that are added only
    then are six for one.
    """
    found = factorize(photographed(source), PAINT, SETTINGS, starting(start))
    assert len(found.scene.sources.directions) == source
    off = abs(float(found.brdf.sigma) - PAINT.sigma)
    assert off < 3.5 * float(found.parameters.standard_error.of("sigma")) < 0.1 * PAINT.sigma
    assert found.outcome is Outcome.CONVERGED
