"""A K_s of every channel at each site, alone and beside sigma and normal.

- A K_s of every channel is found within its errors, alone or with all these; where the photographs
  do not tell its colour, marks say so.  Colourless paint has none.
- What is wrong with a capture is named beside it.

Quick sisters: ``test_coloured_sites.py``, ``test_texture_estimate.py`` and, of a whole run,
``tests/pipelines/test_texture_task.py``.
"""

import numpy as np
import pytest
from site_worlds import LAMPS, NOISY, SIGMAS, World, fitted, under_lamps
from texture_problems import (
    MU,
    NOISE,
)

from jaxrender.inverse import Outcome
from jaxrender.inverse.texture import (
    COLOR,
    MAPS,
)


def in_colour(world, maps, **changed):
    """Fit a K_s of each channel; say how far it is off in standard errors, where it was seen."""
    fit = fitted(world, maps=(*maps, COLOR), **changed)
    texture = fit.texture
    z = np.abs(texture.ks - world.ks)[texture.seen > 0] / texture.ks_error[texture.seen > 0]
    return fit, z


def check_colours(world, fit, z):
    assert 0.7 < np.quantile(z, 0.683) < 1.3
    assert np.mean(z < 1.645) > 0.8
    texture, seen = fit.texture, fit.texture.seen > 0
    told = seen & ~texture.ks_marked & ~texture.ks_colour_marked
    assert told.sum() > 60
    off = np.abs(texture.ks / world.ks - 1)
    assert np.median(off[told]) < 0.06
    assert np.median(off[seen & texture.ks_colour_marked]) > 2 * np.median(off[told])
    # A small floor takes a part of it.
    assert fit.noise.relative == pytest.approx(NOISE.relative, rel=0.2)
    assert texture.relative_rms < 1.3 * NOISE.relative
    assert abs(fit.mu - MU) < 3.5 * fit.mu_error


@pytest.mark.slow
def test_a_coloured_ks_is_found_within_its_errors():
    world = World(LAMPS, under_lamps, 0.0, 0.5, SIGMAS[1:2])
    fit, z = in_colour(world, ())
    check_colours(world, fit, z)
    assert abs(fit.sigma - SIGMAS[1]) < 3.5 * fit.sigma_error
    assert fitted(world, maps=()).texture.relative_rms > 2 * NOISE.relative
    plain = World(LAMPS, under_lamps, 0.0, 0.0, SIGMAS[1:2])
    fit, z = in_colour(plain, ())
    assert np.mean(z < 1.645) > 0.8
    ks = fit.texture.ks[fit.texture.seen > 0]
    assert np.median(np.ptp(ks, axis=1) / ks.mean(axis=1)) < 0.01


@pytest.mark.slow
def test_a_coloured_ks_is_found_with_sigma_and_normals():
    world = World(LAMPS, under_lamps, 0.05, 0.5)
    fit, z = in_colour(world, tuple(MAPS))
    check_colours(world, fit, z)
    seen = fit.texture.seen > 0
    sigma, error = fit.variation
    off = np.abs(np.log(sigma / world.sigma) / (error / sigma))[seen]
    assert 0.7 < np.quantile(off, 0.683) < 1.4


@pytest.mark.slow
def test_what_is_wrong_is_named_beside_a_coloured_ks():
    world = World(LAMPS, under_lamps, 0.0, 0.5, SIGMAS[1:2])
    clean, _ = in_colour(world, (), noise=NOISY, diagnose=True)
    assert clean.outcome is Outcome.CONVERGED
    gains = 1 + 0.02 * np.cos(1.7 * world.frame)
    seen = world.observations
    wrong = seen._replace(radiance=seen.radiance * gains[:, None])
    fit = fitted(world, wrong, maps=(COLOR,), noise=NOISY, diagnose=True)
    assert fit.diagnosis[0].cause == "exposure"
