"""Free facets find what other models are made of: their curves hold the truth in their bands."""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import SAMPLES, ball_samples, known_light, photograph, with_noise

from jaxrender.brdf import FreeFacets, Microfacet, lobe_named
from jaxrender.brdf.distributions import Beckmann, TrowbridgeReitz
from jaxrender.brdf.fresnel import normalised_fresnel
from jaxrender.geometry import Components
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import curves as curves_module
from jaxrender.inverse import fit_brdf
from jaxrender.inverse.curves import DEGREES, curves_of
from jaxrender.inverse.forecast import (
    Situation,
    Supposed,
    forecast_material,
    forecast_of_fit,
    foresee,
)
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.stated import Prior, Stated
from jaxrender.inverse.unknowns import unknowns_of

KD, KS, SIGMA, MU = np.array([0.12, 0.17, 0.21]), np.full(3, 0.1), 0.15, 1.5
# Where the band of a curve is within this factor, the photographs tell something of it.
TOLD = 2.0


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "density"), [("ggx", TrowbridgeReitz), ("beckmann", Beckmann)])
def test_the_curves_hold_the_truth(kind, density):
    truth = Microfacet(KD, KS, SIGMA, MU, "half", "smith", kind)
    noisy = with_noise(photograph(truth, *ball_samples()), 0.01, 0.002)
    variant = lobe_named("free")
    fit = fit_brdf(noisy, known_light(), unknowns_of(variant), variant)
    assert fit.outcome is Outcome.CONVERGED
    assert fit.final.relative_rms < 0.0115
    np.testing.assert_allclose(fit.brdf.kd, KD, rtol=0.01)
    np.testing.assert_allclose(fit.brdf.ks, KS, rtol=0.05)
    angles = jnp.asarray(np.deg2rad(DEGREES))
    tilted = Components(jnp.sin(angles), jnp.zeros_like(angles), jnp.cos(angles))
    expected = {
        "distribution": np.asarray(density(SIGMA).density(tilted)),
        "fresnel": np.asarray(normalised_fresnel(MU, jnp.cos(angles))),
    }
    curves = {curve.name: curve for curve in curves_of(fit.brdf, fit.parameters)}
    assert set(curves) == set(expected)
    for name, curve in curves.items():
        told = curve.upper < TOLD**2 * curve.lower
        assert np.mean(told) > 0.5
        # A series of few waves is as good as this, be the photographs ever so many.
        low, high = curve.lower / 1.02, curve.upper * 1.02
        inside = (low <= expected[name]) & (expected[name] <= high)
        assert np.mean(inside[told]) >= 0.9, name
    nearest = curves["distribution"].nearest
    assert nearest.startswith(kind)
    assert float(nearest.split()[-1]) == pytest.approx(SIGMA, rel=0.02)
    assert float(curves["fresnel"].nearest.split()[-1]) == pytest.approx(MU, rel=0.03)
    # What was to be foreseen is judged alike: by the curve.
    foreseen = forecast_of_fit(fit, known_light()).identifiable
    assert all(foreseen.values())
    assert foreseen == fit.identifiable


@pytest.mark.slow
def test_a_forecast_judges_the_curve_and_not_its_numbers():
    """The tail of a distribution that is nearly Beckmann's is told by nothing; the curve is."""
    facets = FreeFacets(KD, KS, SIGMA * np.sqrt(20), 20.0)
    situation = Situation(*ball_samples(), known_light())
    foreseen = foresee(situation, Supposed(facets, NoiseModel(0.01, 0.002)), SAMPLES)
    forecast = forecast_material(foreseen, explain=False)
    assert forecast.relative_error("tail") > 0.25
    assert forecast.identifiable["tail"]


def test_the_nearest_curve_is_found_where_single_precision_has_nothing(monkeypatch):
    """A steep tail is 0 there, whose logarithm must not decide."""
    words, bounds, density = curves_module._NAMED["distribution"][1]
    single = (words, bounds, lambda sigma: np.asarray(density(sigma), np.float32))
    monkeypatch.setitem(curves_module._NAMED, "distribution", (single,))
    assert np.any(single[2](0.12) == 0)
    log = np.log(np.maximum(density(0.12), 1e-30))
    error = np.where(density(0.12) > 1e-6, 0.02, np.inf)
    with np.errstate(all="raise", under="ignore"):
        nearest, _ = curves_module._nearest("distribution", log, error)
    assert nearest == "beckmann, sigma 0.12"


def test_a_material_of_named_numbers_has_no_such_curves():
    ggx = Microfacet(KD, KS, SIGMA, MU, "half", "smith", "ggx")
    assert ggx.curves(jnp.zeros(1)) == {}


def test_parts_of_a_curve_start_where_they_are_expected_and_are_held_there():
    """Several starts differ in width and tail alone; a prior that is stated counts instead."""
    variant = lobe_named("free")
    unknowns = unknowns_of(variant)
    numbers = unknowns.unpack(jnp.asarray(unknowns.starts(4)[3])).numbers
    first = unknowns.unpack(jnp.asarray(unknowns.starts(4)[0])).numbers
    differ = {name for name in numbers if abs(float(numbers[name] - first[name])) > 1e-6}
    assert differ == {"sigma", "tail"}
    expected = {one.name: one.expected for one in variant.searched if one.expected}
    assert set(unknowns.with_prior) == set(expected)
    assert unknowns_of(variant, expected=False).with_prior == ()
    own = Prior(0.1, 0.01)
    assert unknowns_of(variant, {"wave_2": Stated(prior=own)})["wave_2"].prior == own
    assert unknowns_of(variant, {"wave_2": Stated(fixed=0.1)})["wave_2"].prior is None
