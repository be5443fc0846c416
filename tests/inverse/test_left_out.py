"""Predictions of each photograph by the fit to the others, without a fit to the others.

- Where all unknowns are linear they are those of such fits, to rounding.
- Where widths and indices are free they are near: off by a small part of what leaving out changes.
- A photograph that is too bright stays further off than the fit that has seen it says.
- Three photographs are predicted by the fit to all.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import ball_samples, known_light, material, photograph, with_noise

from jaxrender.imaging import NoiseModel
from jaxrender.inverse import FitSettings, Stated, fit_brdf, unknowns_of
from jaxrender.inverse.left_out import predicted_left_out
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import ExactModel

TRUTH = material()
LOBE = {"sigma": Stated(fixed=0.16), "mu": Stated(fixed=1.62)}
# The same weights for every fit.
SETTINGS = FitSettings(starts=1, noise=NoiseModel(0.0, 0.01), diagnose=False)


@pytest.fixture(scope="module")
def photographs():
    return with_noise(photograph(TRUTH, *ball_samples()), 0.03)


def fitted(observations, stated):
    unknowns = unknowns_of(TRUTH, stated)
    return fit_brdf(observations, known_light(), unknowns, TRUTH, SETTINGS)


def model_of(observations):
    nodes = exact_nodes(known_light(), np.asarray(observations.frame), 0.16)
    return ExactModel(TRUTH, observations.samples, nodes)


def predicted(fit, observations):
    return predicted_left_out(fit.final, model_of(observations), observations)


def by_refits(observations, stated, photographs):
    """Fit to the others again and again; what is not asked for stays 0."""
    found = np.zeros(observations.radiance.shape)
    frame = np.asarray(observations.frame)
    for number in photographs:
        fit = fitted(observations.take(np.flatnonzero(frame != number)), stated)
        own = observations.take(np.flatnonzero(frame == number))
        found[frame == number] = plain(fit, own)
    return found


def plain(fit, observations):
    numbers = {name: jnp.asarray(value) for name, value in fit.brdf.numbers.items()}
    columns = model_of(observations).columns(numbers)
    return np.asarray(columns.times(jnp.asarray(fit.brdf.amplitudes)))


@pytest.mark.slow
def test_of_linear_unknowns_they_are_exact(photographs):
    found = predicted(fitted(photographs, LOBE), photographs)
    asked = np.asarray(photographs.frame) < 2
    refits = by_refits(photographs, LOBE, range(2))
    np.testing.assert_allclose(found[asked], refits[asked], rtol=1e-6)


@pytest.mark.slow
def test_of_free_numbers_they_are_near(photographs):
    fit = fitted(photographs, {})
    found, exact = predicted(fit, photographs), by_refits(photographs, {}, range(4))
    changed = np.linalg.norm(exact - plain(fit, photographs))
    assert 0 < np.linalg.norm(found - exact) < 0.25 * changed


def test_a_photograph_that_is_too_bright_cannot_vouch_for_itself(photographs):
    bright = (np.asarray(photographs.frame) == 2)[:, None]
    wrong = photographs._replace(radiance=np.where(bright, 1.3, 1) * photographs.radiance)
    fit = fitted(wrong, LOBE)
    measured = np.asarray(wrong.radiance)
    seen, unseen = (
        np.linalg.norm((measured - one)[bright[:, 0]])
        for one in (plain(fit, wrong), predicted(fit, wrong))
    )
    assert unseen > 1.2 * seen


@pytest.mark.slow
def test_three_photographs_are_predicted_by_the_fit_to_all(photographs):
    few = photographs.take(np.flatnonzero(np.asarray(photographs.frame) < 3))
    fit = fitted(few, LOBE)
    np.testing.assert_allclose(predicted(fit, few), plain(fit, few), rtol=1e-12)
