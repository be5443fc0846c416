"""Microfacet lobes of three distributions by degree and exit cosine, and their azimuthal terms.

Pinned down: h_l at random sigma, mu and exit cosine
against another quadrature (about N, in the lobe's own angles); derivatives; the Gaussian lobe is
the thesis's; ``Microfacet`` with that distribution has that transfer, and its directional albedo at
degree 0; interpolation over exit cosines; terms q > 0 reproduce the reflection of light exactly
where the mean alone does not; ERRATA 27's numbers for the matched Gaussian; refusals.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Components
from jaxrender.harmonics import coefficient_count, legendre
from jaxrender.lighting import HarmonicLight
from jaxrender.spectra import (
    FacetLobe,
    exit_cosine_transfer,
    facet_azimuthal_transfer,
    facet_transfer,
    matched_gaussian_transfer,
    normal_exitance_transfer,
    transfer_of_samples,
)

# What was asked for; the quadrature reaches 1e-6.
PROMISED, SLOPE = 1e-6, 1e-3
# Cubic interpolation between 64 knots, relative to the largest of a sample's degrees: worst at
# grazing exit, where long tails dip below the horizon.
INTERPOLATION = 1.5e-4
BAND_LIMIT = 12

transfer_of_facets = eqx.filter_jit(facet_transfer)
head_on_transfer = eqx.filter_jit(normal_exitance_transfer)
matched = eqx.filter_jit(matched_gaussian_transfer)


def lobe_of(distribution, masking, sigma, mu=1.5):
    return FacetLobe(jnp.asarray(sigma), jnp.asarray(mu), distribution, masking, "half")


def about_the_normal(lobe, exit_cosine, count=160):
    """int lobe P_l(w . R) dw, nodes graded towards R from either side."""
    x, w = np.polynomial.legendre.leggauss(count)
    u, w = (x + 1) / 2, w / 2
    exit_angle = np.arccos(exit_cosine)
    spans = np.array([-exit_angle, np.pi / 2 - exit_angle])[:, None]
    polar = (exit_angle + spans * u**3).ravel()
    polar_weights = (np.abs(spans) * 3 * u**2 * w).ravel()
    azimuth, azimuth_weights = np.pi * u**3, np.pi * 3 * u**2 * w
    sine, cosine = np.sin(polar)[:, None], np.cos(polar)[:, None] * np.ones(count)
    x, y = sine * np.cos(azimuth), sine * np.sin(azimuth)
    sin_o = np.sqrt(1 - exit_cosine**2)
    # Azimuth from R, opposite to the camera.
    camera = Components(*(jnp.full(x.shape, v) for v in (-sin_o, 0.0, exit_cosine)))
    values = lobe(Components(jnp.asarray(x), jnp.asarray(y), jnp.asarray(cosine)), camera)
    weights = 2 * (polar_weights * np.sin(polar))[:, None] * azimuth_weights
    towards_mirror = np.clip(x * sin_o + cosine * exit_cosine, -1, 1).ravel()
    polynomials = np.asarray(legendre(jnp.asarray(towards_mirror), BAND_LIMIT))
    return (np.asarray(values) * weights).ravel() @ polynomials


# The Gaussian without masking is in the tests of ``microfacet``.
@pytest.mark.parametrize(
    ("distribution", "masking"),
    [("gaussian", "smith"), ("beckmann", "none"), ("ggx", "none"), ("ggx", "smith")],
)
def test_transfer_at_random_parameters(distribution, masking):
    rng = np.random.default_rng([len(distribution), len(masking)])
    for _ in range(4):
        sigma, mu = rng.uniform(0.04, 0.6), rng.uniform(1.2, 2.2)
        exit_cosine = rng.uniform(0.15, 1)
        lobe = lobe_of(distribution, masking, sigma, mu)
        found = np.asarray(transfer_of_facets(lobe, np.array([exit_cosine]), BAND_LIMIT))[0]
        expected = about_the_normal(lobe, exit_cosine)
        np.testing.assert_allclose(found, expected, atol=PROMISED * np.abs(expected).max())


@pytest.mark.parametrize("distribution", ["gaussian", "beckmann", "ggx"])
def test_the_model_with_that_distribution_has_that_transfer(distribution):
    """By exit_cosine_transfer, and degree 0 is the directional albedo by another quadrature."""
    mu, white = jnp.asarray(1.6), np.ones(1)
    model = Microfacet(0 * white, white, jnp.asarray(0.2), mu, "half", "smith", distribution)
    cosines = np.array([0.2, 0.6])
    found = np.asarray(eqx.filter_jit(exit_cosine_transfer)(model, cosines, BAND_LIMIT))
    lobe = lobe_of(distribution, "smith", 0.2, 1.6)
    np.testing.assert_allclose(
        found, transfer_of_facets(lobe, cosines, BAND_LIMIT), atol=1e-12 * found.max()
    )
    for exit_cosine, h in zip(cosines, found):
        albedo = about_the_normal(model.specular_transfer, exit_cosine)[0]
        assert h[0] == pytest.approx(albedo, rel=PROMISED)


@pytest.mark.parametrize("sigma", [0.05, 0.2, 0.5])
def test_interpolation_over_exit_cosines_of_ggx(sigma):
    white = np.ones(1)
    model = Microfacet(0 * white, white, sigma, jnp.asarray(1.5), "half", "smith", "ggx")
    cosines = np.concatenate([np.linspace(0.1, 0.2, 21), np.linspace(0.2, 1, 40)])
    band_limit = int(np.ceil(3.2 / sigma))
    direct = np.asarray(eqx.filter_jit(exit_cosine_transfer)(model, cosines, band_limit))
    found = np.asarray(eqx.filter_jit(transfer_of_samples)(model, cosines, band_limit))
    error = np.abs(found - direct).max(axis=1) / np.abs(direct).max(axis=1)
    assert error.max() < INTERPOLATION


@pytest.mark.parametrize("distribution", ["beckmann", "ggx"])
def test_derivatives_in_sigma_and_mu(distribution):
    cosines = np.array([0.2, 0.7])

    @jax.jit
    def transfer(sigma, mu):
        return facet_transfer(lobe_of(distribution, "smith", sigma, mu), cosines, BAND_LIMIT)

    at = np.array([0.23, 1.5])
    for argument, slope in enumerate(jax.jit(jax.jacfwd(transfer, (0, 1)))(*at)):
        step = 1e-4 * np.eye(2)[argument]
        numeric = (transfer(*(at + step)) - transfer(*(at - step))) / (2 * step.sum())
        np.testing.assert_allclose(slope, numeric, atol=SLOPE * np.abs(numeric).max() / 10)


def test_the_gaussian_lobe_is_the_thesis_model():
    for masking in ("none", "smith"):
        model = Microfacet(np.zeros(1), np.ones(1), 0.2, 1.6, "half", masking)
        cosines = np.array([0.2, 1.0])
        expected = eqx.filter_jit(exit_cosine_transfer)(model, cosines, BAND_LIMIT)
        found = transfer_of_facets(lobe_of("gaussian", masking, 0.2, 1.6), cosines, BAND_LIMIT)
        np.testing.assert_allclose(found, expected, rtol=1e-10)


def reflected(lobe, exit_angle, light):
    """B in the frame with R = +Z and N at azimuth 0, as a sum over the light's nodes."""
    directions, irradiance = light.nodes()
    normal = np.array([np.sin(exit_angle), 0, np.cos(exit_angle)])
    tangent = np.array([np.cos(exit_angle), 0, -np.sin(exit_angle)])
    frame = np.stack([tangent, [0, 1, 0], normal], axis=1)
    incoming = Components.of(directions).in_frame(frame)
    camera = np.array([np.sin(2 * exit_angle), 0, np.cos(2 * exit_angle)]) @ frame
    outgoing = Components(*(jnp.full(incoming.z.shape, v) for v in camera))
    above = incoming.z > 0
    values = jnp.where(above, lobe(incoming, outgoing), 0)
    return float(jnp.sum(values * irradiance[:, 0]))


@pytest.mark.parametrize("distribution", ["gaussian", "ggx"])
def test_azimuthal_terms_make_the_reflection_exact(distribution):
    """sum_lq Lambda_l^-1 h_lq L_lq: with q > 0 to quadrature accuracy, with q = 0 alone not."""
    band_limit, exit_angle = 6, 1.0
    lobe = lobe_of(distribution, "smith", 0.3)
    rng = np.random.default_rng(1)
    light = HarmonicLight(rng.normal(size=(coefficient_count(band_limit), 1)), height=200)
    cosines = np.array([np.cos(exit_angle)])
    terms = eqx.filter_jit(facet_azimuthal_transfer)(lobe, cosines, band_limit, band_limit)
    terms = np.asarray(terms)[0]
    # Two rules in azimuth: the orders' has more nodes.
    np.testing.assert_allclose(
        terms[:, 0], transfer_of_facets(lobe, cosines, band_limit)[0], rtol=1e-7
    )
    degree = np.arange(band_limit + 1)
    wavelength = np.sqrt(4 * np.pi / (2 * degree + 1))
    by_order = np.zeros((band_limit + 1, band_limit + 1))
    for n in degree:
        for q in range(n + 1):
            by_order[n, q] = terms[n, q] * light.coefficients[n * (n + 1) + q, 0] / wavelength[n]
    expected = reflected(lobe, exit_angle, light)
    # The horizon's jump in the node sum at 200 rows.
    assert by_order.sum() == pytest.approx(expected, abs=4e-3)
    assert abs(by_order[:, 0].sum() - expected) > 0.03
    assert np.all(terms[degree[:, None] < degree[None, :]] == 0)


@pytest.mark.parametrize(
    ("sigma", "off"), [(0.1, 0.0012), (0.2, 0.0048), (0.3, 0.011), (0.5, 0.060)]
)
def test_how_far_the_matched_gaussian_is_off(sigma, off):
    """ERRATA 27, beside T 3.51's .044, .091, .139, .231 (in the tests of ``microfacet``)."""
    model = Microfacet(np.zeros(1), np.ones(1), sigma, None)
    exact = head_on_transfer(model, np.ones(1), 64)[0]
    worst = np.abs(np.asarray(matched(jnp.asarray(sigma), 64)) - np.asarray(exact)).max()
    assert worst == pytest.approx(off, rel=0.05)


def test_refusals():
    with pytest.raises(ValueError, match="distribution='phong': choose one of gaussian, beckmann"):
        FacetLobe(0.2, None, "phong")
    with pytest.raises(ValueError, match=r"sigma=0\.0: the roughness must be above 0"):
        FacetLobe(0.0)
    with pytest.raises(ValueError, match="orders to 3 of degrees to 2"):
        facet_azimuthal_transfer(FacetLobe(0.2), np.ones(1), 2, 3)
