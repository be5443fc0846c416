"""A model that someone else writes: its own numbers are searched, however many it has.

- A lobe of two numbers, neither of them a width or an index alone, is found from photographs by the
  exact integral within its stated errors, and every number is named by its own name.
- Of its numbers any can be fixed or bounded; bounds are honoured.
- Under unknown light a number that no factorization looks for is refused.
- Numbers that contradict the class are refused with the class and the number.
"""

from typing import ClassVar

import numpy as np
import pytest
from inverse_problems import ball_samples, known_light, photograph, with_noise

from jaxrender.brdf import CosineLobe, Searched
from jaxrender.inverse import FitSettings, Outcome, Stated, factorize, fit_brdf, unknowns_of

STATED_ERRORS = 3.5
KD, KS = np.array([0.19, 0.11, 0.07]), np.full(3, 0.6)


class BentLobe(CosineLobe):
    """Lafortune's lobe whose direction is searched for along with its exponent."""

    @property
    def searched(self):
        """The exponent, and how far the lobe is bent towards the normal."""
        return (*super().searched, Searched("c_z", 0.5, 2.0, 1.0))


class Misnamed(CosineLobe):
    """One that says a number which it has not."""

    searched: ClassVar = (Searched("shine", 0.1, 1.0, 0.5),)


class Contradictory(CosineLobe):
    """One whose search would start outside its own bounds."""

    searched: ClassVar = (Searched("exponent", 1.0, 10.0, 50.0),)


TRUTH = BentLobe(KD, KS, 25.0, 0.85)


@pytest.fixture(scope="module")
def photographs():
    return with_noise(photograph(TRUTH, *ball_samples()), 0.01, 0.002)


def test_every_number_is_found_and_named(photographs):
    kind = TRUTH.with_numbers({"exponent": 10.0, "c_z": 1.0})
    fit = fit_brdf(photographs, known_light(), unknowns_of(kind), kind, FitSettings(starts=1))
    assert fit.outcome is Outcome.CONVERGED
    assert type(fit.brdf) is BentLobe
    assert set(fit.identifiable) == {"kd", "ks", "exponent", "c_z"}
    for name, true in {"kd": KD, "ks": KS, "exponent": 25.0, "c_z": 0.85}.items():
        off = np.abs(fit.parameters.value.of(name) - true)
        assert np.all(off < STATED_ERRORS * fit.parameters.standard_error.of(name))
    assert float(fit.parameters.standard_error.of("c_z")) < 0.02


@pytest.mark.slow
def test_bounds_of_the_further_number_are_honoured(photographs):
    stated = {"c_z": Stated(bounds=(0.95, 1.5)), "exponent": Stated(fixed=25.0)}
    unknowns = unknowns_of(TRUTH, stated)
    fit = fit_brdf(photographs, known_light(), unknowns, TRUTH, FitSettings(starts=2))
    assert fit.outcome is Outcome.AT_BOUND
    assert float(fit.brdf.c_z) == pytest.approx(0.95, rel=0.01)
    assert float(fit.brdf.exponent) == pytest.approx(25.0)
    assert "c_z is at a bound of its range" in fit.reasons


def test_a_further_number_is_refused_where_the_light_is_unknown(photographs):
    with pytest.raises(ValueError, match="BentLobe has c_z beside a width and an index"):
        factorize(photographs, TRUTH)


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (Misnamed, r"Misnamed.searched: there is no field 'shine'"),
        (Contradictory, r"Contradictory.exponent: .* start 50 must lie between 1 and 10"),
    ],
)
def test_numbers_that_contradict_the_class_are_refused(kind, said):
    with pytest.raises(ValueError, match=said):
        unknowns_of(kind(KD, KS, 25.0, 0.85))
