"""A material of several lobes, each with an amplitude and numbers of its own.

- Two glossy lobes over a base, by a class that stands in this file alone, are found from
  photographs by the exact integral within their stated errors, every number by its name.
- Amplitudes can be fixed, bounded, and found by channel, each by itself.
- What has one such lobe alone is refused, by its reason: unknown light.
- A forecast says the same errors beforehand.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import ball_samples, known_light, photograph, with_noise

from jaxrender.brdf import ByOwnNumber, Phong, Searched, ShapeParameter
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import FitSettings, Outcome, Stated, factorize, fit_brdf, unknowns_of
from jaxrender.inverse.forecast import Supposed, forecast_material, foresee
from jaxrender.inverse.forecast.situation import Situation
from jaxrender.shapes import AnyArray, Float

STATED_ERRORS = 3.5
NOISE, FLOOR = 0.01, 0.002


class Coated(ByOwnNumber):
    """Phong's lobe twice over a Lambertian base: a broad one and, from the coat, a narrow one."""

    shape: ClassVar[ShapeParameter] = ShapeParameter("coat_exponent", 0.5, -2.0)
    amplitude_names: ClassVar[tuple[str, ...]] = ("kd", "ks", "coat")

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    coat: Float[AnyArray, "channel"]
    exponent: Float[AnyArray, ""] = eqx.field(converter=jnp.asarray)
    coat_exponent: Float[AnyArray, ""] = eqx.field(converter=jnp.asarray)

    reciprocal = conserves_energy = isotropic = True
    energy = 1.0

    @property
    def searched(self):
        """Both exponents, which may not change places."""
        return (
            Searched("exponent", 2.0, 20.0, 6.0),
            Searched("coat_exponent", 25.0, 400.0, 80.0),
        )

    def transfer(self, incoming, outgoing):
        """Evaluate the base, the broad lobe and the narrow one."""
        one = jnp.ones(1)
        base, broad = Phong(one, one, self.exponent).transfer(incoming, outgoing)
        return base, broad, Phong(one, one, self.coat_exponent).transfer(incoming, outgoing)[1]


KD, KS, COAT = np.array([0.19, 0.11, 0.07]), np.full(3, 0.2), np.full(3, 0.15)
TRUTH = Coated(KD, KS, COAT, 8.0, 90.0)
NUMBERS = {"kd": KD, "ks": KS, "coat": COAT, "exponent": 8.0, "coat_exponent": 90.0}


@pytest.fixture(scope="module")
def photographs():
    return with_noise(photograph(TRUTH, *ball_samples()), NOISE, FLOOR)


@pytest.fixture(scope="module")
def fit(photographs):
    return fit_brdf(photographs, known_light(), unknowns_of(TRUTH), TRUTH, FitSettings(starts=1))


@pytest.mark.slow
def test_every_amplitude_and_number_is_found(fit):
    assert fit.outcome is Outcome.CONVERGED
    assert type(fit.brdf) is Coated
    assert set(fit.identifiable) == set(NUMBERS)
    for name, true in NUMBERS.items():
        off = np.abs(np.asarray(fit.parameters.value.of(name)) - true)
        error = np.asarray(fit.parameters.standard_error.of(name))
        assert np.all(off < STATED_ERRORS * error)
        assert np.all(error < 0.1 * np.asarray(true))


@pytest.mark.slow
def test_a_forecast_says_the_errors_beforehand(fit, photographs):
    final, floor = fit.final, FLOOR * float(photographs.radiance.mean())
    situation = Situation(final.observations.samples, final.observations.frame, known_light())
    foreseen = foresee(situation, Supposed(TRUTH, NoiseModel(NOISE, floor)))
    forecast = forecast_material(foreseen, explain=False)
    assert all(forecast.identifiable.values())
    for name in NUMBERS:
        foreseen = np.asarray(forecast.parameters.standard_error.of(name))
        achieved = np.asarray(fit.parameters.if_exact.standard_error.of(name))
        np.testing.assert_allclose(foreseen, achieved, rtol=0.35)


def test_each_amplitude_can_be_stated_by_itself(photographs):
    stated = {"coat": Stated(fixed=(0.15, 0.15, 0.15)), "ks": Stated(bounds=(0.25, 0.4))}
    unknowns = unknowns_of(TRUTH, stated)
    settings = FitSettings(starts=1, refine=False)
    fit = fit_brdf(photographs, known_light(), unknowns, TRUTH, settings)
    assert fit.outcome is Outcome.AT_BOUND
    assert "ks is at a bound of its range" in fit.reasons
    np.testing.assert_allclose(fit.brdf.ks, 0.25)
    np.testing.assert_array_equal(fit.brdf.coat, COAT)
    assert "coat" not in fit.identifiable


def test_several_lobes_are_refused_where_the_light_is_unknown(photographs):
    with pytest.raises(ValueError, match="Coated has several lobes that its numbers shape"):
        factorize(photographs, TRUTH)
