"""A sharp highlight in a haze: two GGX lobes over a base.

- It is its parts: two ``Microfacet`` materials of one base, the broad one no wider than 1.
- Photographs by an integral of its own give back all its numbers within their stated errors.
- Where both lobes are there it is better than one lobe; a broad lobe that is not wider is refused.
"""

import numpy as np
import pytest
from inverse_problems import ball_samples, known_light, photograph, with_noise

from jaxrender.brdf import Microfacet, TwoGGX, lobe_named
from jaxrender.inverse import FitSettings, Outcome, fit_brdf, unknowns_of
from jaxrender.inverse.comparison import Candidate, compare_models

STATED_ERRORS = 3.5
KD, KS, BROAD = np.array([0.19, 0.11, 0.07]), np.full(3, 0.12), np.full(3, 0.15)
TRUTH = TwoGGX(KD, KS, BROAD, 0.1, 4.0, 1.5)
NUMBERS = {"kd": KD, "ks": KS, "ks_broad": BROAD, "sigma": 0.1, "spread": 4.0, "mu": 1.5}
SETTINGS = FitSettings(starts=2, diagnose=False)


@pytest.fixture(scope="module")
def photographs():
    return with_noise(photograph(TRUTH, *ball_samples()))


@pytest.mark.parametrize(("spread", "width"), [(4.0, 0.4), (20.0, 1.0)])
def test_it_is_its_parts(spread, width):
    drawn = np.random.default_rng(0).normal(size=(2, 200, 3))
    drawn[..., 2] = np.abs(drawn[..., 2])
    pairs = drawn / np.linalg.norm(drawn, axis=-1, keepdims=True)
    narrow = Microfacet(KD, KS, 0.1, 1.5, "half", "smith", "ggx")
    broad = Microfacet(0 * KD, BROAD, width, 1.5, "half", "smith", "ggx")
    both = TwoGGX(KD, KS, BROAD, 0.1, spread, 1.5)
    expected = np.asarray(narrow.evaluate(*pairs)) + np.asarray(broad.evaluate(*pairs))
    np.testing.assert_allclose(both.evaluate(*pairs), expected, rtol=1e-12)


@pytest.mark.slow
def test_every_number_is_found(photographs):
    found = fit_brdf(photographs, known_light(), unknowns_of(TRUTH), TRUTH, SETTINGS)
    assert found.outcome in (Outcome.CONVERGED, Outcome.NOT_IDENTIFIABLE)
    for name, true in NUMBERS.items():
        off = np.abs(np.asarray(found.parameters.value.of(name)) - true)
        error = np.asarray(found.parameters.standard_error.of(name))
        assert np.all(off < STATED_ERRORS * error), name


@pytest.mark.slow
def test_two_lobes_are_better_than_one(photographs):
    candidates = tuple(
        Candidate(name, lobe_named(name), unknowns_of(lobe_named(name)))
        for name in ("ggx", "two-ggx")
    )
    compared = compare_models(photographs, known_light(), candidates, SETTINGS)
    assert compared.best.name == "two-ggx"
    assert compared.scores[1].chi_squared > 2 * compared.best.chi_squared


def test_what_is_no_broad_lobe_is_refused():
    with pytest.raises(ValueError, match="spread"):
        TwoGGX(KD, KS, BROAD, 0.1, 1.0, 1.5)
    with pytest.raises(ValueError, match="sigma"):
        TwoGGX(KD, KS, BROAD, 1.1, 2.0, 1.5)
