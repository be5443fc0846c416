"""Coefficients of any BRDF by quadrature.

Pinned down: rho_lpq against SciPy's own harmonics; the isotropic ones are the anisotropic ones of
equal orders, and the others vanish (T 2.47); T 2.53 and 2.56 sum back to the BRDF where it is
band-limited; reciprocity with the conjugate of ERRATA 9; degree 0 at a fixed exit is the albedo
with the factor of ERRATA 14; exits in any direction; a
derivative; refusals.
"""

import equinox as eqx
import jax
import numpy as np
import pytest
from scipy.special import sph_harm_y
from spectra_problems import Brushed, Sheen

from jaxrender import spectra
from jaxrender.brdf import Lambertian, Microfacet, Phong, TorranceSparrow
from jaxrender.geometry import Components
from jaxrender.spectra import (
    FacetLobe,
    HemisphereRule,
    anisotropic_coefficients,
    anisotropic_outgoing_coefficients,
    facet_transfer,
    isotropic_coefficients,
    lambertian_transfer,
    outgoing_coefficients,
    phong_transfer,
)

ROUNDING = 1e-12
# Compiled once for each model.
spectrum_of = eqx.filter_jit(spectra.spectrum_of)
ROUGH = Microfacet(np.ones(1), np.ones(1), 0.5, 1.5, "half", "smith")


def directions_of(rule):
    directions = rule.directions()
    return directions, rule.weights(), np.arccos(directions[:, 2]), np.arctan2(*directions.T[1::-1])


def test_each_coefficient_is_its_integral():
    rule = HemisphereRule(16, 32)
    found = isotropic_coefficients(ROUGH, (5, 4), rule)
    assert found.shape == (2, 6, 5, 5)
    directions, weights, polar, azimuth = directions_of(rule)
    count = len(weights)
    # The exits stand still at azimuth 0: isotropy makes the other azimuths the same.
    exits, exit_weights = rule.rows()
    for degree, outgoing, order in ((0, 0, 0), (3, 2, 1), (5, 4, 3), (4, 4, 4)):
        total = np.zeros(2, complex)
        for cosine, weight in zip(exits, exit_weights):
            away = np.broadcast_to([np.sqrt(1 - cosine**2), 0, cosine], (count, 3))
            values = np.stack(_lobes(ROUGH, directions, away))
            inner = values @ (weights * sph_harm_y(degree, order, polar, azimuth))
            outer = sph_harm_y(outgoing, order, np.arccos(cosine), 0.0)
            total += 2 * np.pi * weight * inner * np.conj(outer)
        np.testing.assert_allclose(found[:, degree, outgoing, order], np.real(total), atol=1e-10)
        np.testing.assert_allclose(np.imag(total), 0, atol=1e-10)


def _lobes(brdf, incoming, outgoing):
    return brdf.transfer(Components.of(incoming), Components.of(outgoing))


def test_isotropic_ones_are_the_equal_orders():
    rule = HemisphereRule(8, 16)
    general = np.asarray(anisotropic_coefficients(Sheen(), (3, 3), rule))
    isotropic = np.asarray(isotropic_coefficients(Sheen(), (3, 3), rule))
    for first in range(16):
        for second in range(16):
            degree, p = int(np.sqrt(first)), int(np.sqrt(second))
            n, q = first - degree * (degree + 1), second - p * (p + 1)
            expected = isotropic[:, degree, p, abs(q)] if n == q else 0
            np.testing.assert_allclose(general[:, first, second], expected, atol=1e-10)


def test_reciprocity_has_a_conjugate():
    """ERRATA 9: rho~_{ln,pq} = conj(rho~_{pq,ln}); printed without it."""
    found = np.asarray(anisotropic_coefficients(Brushed(), (3, 3), reciprocal=True))[0]
    np.testing.assert_allclose(found, found.conj().T, atol=ROUNDING)
    assert np.abs(found - found.T).max() > 0.01
    plain = np.asarray(anisotropic_coefficients(Brushed(), (3, 3)))[0]
    assert np.abs(plain - plain.conj().T).max() > 0.01


def test_isotropic_reciprocity():
    found = np.asarray(isotropic_coefficients(ROUGH, (4, 4), reciprocal=True))
    np.testing.assert_allclose(found, np.swapaxes(found, 1, 2), atol=ROUNDING)


def test_degree_zero_at_an_exit_is_the_albedo():
    """rho_00(t_o) = sqrt(2 pi) Lambda_0^-1 iint rho^; T 3.21 has lost Lambda_0^-1 (ERRATA 14)."""
    cosines = np.array([0.3, 1.0])
    found = outgoing_coefficients(Lambertian(np.ones(1)), cosines, 2)
    expected = np.sqrt(2 * np.pi) / np.sqrt(4 * np.pi) * np.pi
    np.testing.assert_allclose(found[0, :, 0, 0], expected, rtol=ROUNDING)


def test_fixed_exit_against_scipy():
    rule, exit_cosine = HemisphereRule(16, 32), 0.6
    found = outgoing_coefficients(ROUGH, np.array([exit_cosine]), 4, rule)
    directions, weights, polar, azimuth = directions_of(rule)
    away = np.broadcast_to([0.8, 0, 0.6], directions.shape)
    for degree, order in ((1, 1), (4, 3), (3, 0)):
        harmonics = sph_harm_y(degree, order, polar, azimuth)
        for lobe, values in enumerate(_lobes(ROUGH, directions, away)):
            expected = np.sqrt(2 * np.pi) * (np.asarray(values) * weights) @ harmonics
            assert complex(found[lobe, 0, degree, order]) == pytest.approx(expected, abs=1e-12)


def test_exit_directions_turn_with_an_isotropic_brdf():
    """rho_ln(o) is rho_ln(t_o) e^(i n phi_o) / sqrt(2 pi), of either sign of n."""
    rule, azimuth = HemisphereRule(64, 128), 0.7
    outgoing = np.array([[0.8 * np.cos(azimuth), 0.8 * np.sin(azimuth), 0.6]])
    found = np.asarray(anisotropic_outgoing_coefficients(ROUGH, outgoing, 4, rule))
    still = np.asarray(outgoing_coefficients(ROUGH, np.array([0.6]), 4, rule))
    for degree, order in ((0, 0), (1, 1), (4, 3), (4, -3)):
        sign = (-1.0) ** order if order < 0 else 1
        expected = sign * still[:, 0, degree, abs(order)] / np.sqrt(2 * np.pi)
        value = found[:, 0, degree * (degree + 1) + order]
        np.testing.assert_allclose(value, expected * np.exp(1j * order * azimuth), atol=1e-6)


def test_lambertian_against_its_closed_form():
    """rho_l00 about the normal is A_l / Lambda_l times int_(z_o > 0) Y_00."""
    found = isotropic_coefficients(Lambertian(np.ones(1)), (6, 0))[0, :, 0, 0]
    degree = np.arange(7)
    expected = lambertian_transfer(6) * np.sqrt((2 * degree + 1) / (4 * np.pi))
    expected *= 2 * np.pi / np.sqrt(4 * np.pi)
    np.testing.assert_allclose(found, expected, atol=ROUNDING)


def test_derivative_in_sigma():
    def coefficients(sigma):
        brdf = Microfacet(np.ones(1), np.ones(1), sigma, None)
        return isotropic_coefficients(brdf, (3, 3), HemisphereRule(12, 24), reciprocal=True)[1]

    compiled = jax.jit(coefficients)
    slope = jax.jit(jax.jacfwd(coefficients))(0.5)
    numeric = (compiled(0.5 + 1e-5) - compiled(0.5 - 1e-5)) / 2e-5
    np.testing.assert_allclose(slope, numeric, atol=1e-8)


GLOSSY = Phong(np.ones(1), np.ones(1), 17.5)
MODELS = {"lambertian": Lambertian(np.ones(2)), "microfacet": ROUGH, "phong": GLOSSY}


@pytest.mark.parametrize("brdf", MODELS.values(), ids=MODELS)
def test_spectrum_by_formula_and_by_quadrature(brdf):
    formula = spectrum_of(brdf, 20)
    numeric = spectrum_of(brdf, 20, numeric=True)
    np.testing.assert_allclose(formula, numeric, atol=2e-6)


def test_spectrum_at_an_oblique_exit():
    """The microfacet lobe's own; Phong's is the same as ever, but for what the horizon clips."""
    head_on, oblique = (np.asarray(spectrum_of(ROUGH, 20, c)[1]) for c in (1.0, 0.5))
    assert np.abs(oblique - head_on).max() > 0.05
    free = Phong(np.ones(1), np.ones(1), 17.5, clipped=False)
    np.testing.assert_array_equal(spectrum_of(free, 20, 0.3)[1], phong_transfer(17.5, 20))
    clipped = spectrum_of(GLOSSY, 20, 0.3)[1, 0]
    assert 0.8 < float(clipped) < 0.98


def test_spectrum_of_a_model_without_a_formula():
    """Head-on, GGX with masking is the facets' own transfer times the Fresnel reflectance."""
    model = TorranceSparrow(np.ones(1), np.ones(1), 0.2, None, None, "ggx", "smith")
    facets = facet_transfer(FacetLobe(0.2, None, "ggx", "smith"), np.ones(1), 20)
    np.testing.assert_allclose(spectrum_of(model, 20)[1], facets[0], atol=2e-6)


def test_refusals():
    with pytest.raises(
        ValueError, match="degree 8 cannot be determined with 8 rows and 64 columns"
    ):
        isotropic_coefficients(ROUGH, (8, 2), HemisphereRule(8, 64))
    with pytest.raises(ValueError, match="Brushed is anisotropic"):
        isotropic_coefficients(Brushed(), (2, 2))
    with pytest.raises(ValueError, match="a rule of 0 rows"):
        HemisphereRule(0, 4)
    with pytest.raises(ValueError, match="Brushed is anisotropic"):
        spectrum_of(Brushed(), 4)
    with pytest.raises(ValueError, match="exit_cosine=0"):
        spectrum_of(ROUGH, 4, 0.0)
