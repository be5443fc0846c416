"""Distributions of facets, their maskings, and the two Fresnel reflectances of the new models.

Pinned down: int D cos = 1 for every roughness, also anisotropic; Smith's Lambda is the visible
projected area int D max(w . h, 0) / cos t - 1, done here by brute force; it is 0 head-on and grows
as 1 / cos t at grazing; isotropic is anisotropic with equal widths; V-grooves by their three cases;
a metal's reflectance is that of complex Snell's law in mpmath, a dielectric's for k = 0 with no
p-polarised light at Brewster's angle; Schlick's is exact head-on and at grazing; every refusal.
"""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from brdf_problems import direction

from jaxrender.brdf import (
    DISTRIBUTIONS,
    Beckmann,
    Gaussian,
    TrowbridgeReitz,
    conductor_fresnel,
    fresnel,
    head_on_reflectance,
    schlick_fresnel,
    smith_facet_masking,
    v_groove_masking,
)
from jaxrender.geometry import Components

ROUNDING = 1e-12
QUADRATURE = 1e-9  # of a smooth integrand by some hundred nodes each way
# The Gaussian's own rule has a kink where facets turn away.
GAUSSIAN_LAMBDA = 2e-4


def hemisphere(nodes=200):
    """Nodes and solid angles, even in u of tan t = (u / (1 - u))^2, which suits all tails."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    u, w = (x + 1) / 2, w / 2
    slope = u / (1 - u)
    polar, across = np.arctan(slope**2), w * 2 * slope / (1 - u) ** 2 / (1 + slope**4)
    azimuth = (np.arange(nodes) + 0.5) * 2 * np.pi / nodes
    facets = direction(np.cos(polar)[:, None], azimuth[None, :]).reshape(-1, 3)
    return facets, np.repeat(across * np.sin(polar) * 2 * np.pi / nodes, nodes)


FACETS, SOLID_ANGLES = hemisphere()
ALL = [
    Gaussian(0.05),
    Gaussian(0.4),
    Gaussian(1.0),
    Beckmann(0.05),
    Beckmann(0.4),
    Beckmann(0.3, 0.8),
    TrowbridgeReitz(0.05),
    TrowbridgeReitz(1.0),
    TrowbridgeReitz(0.3, 0.8),
]


@pytest.mark.parametrize("distribution", ALL)
def test_projected_area_is_one(distribution):
    density = np.asarray(distribution.density(Components.of(FACETS)))
    area = np.sum(SOLID_ANGLES * density * FACETS[:, 2])
    # GGX has a tail that only falls as a power of the cosine.
    assert area == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("distribution", [d for d in ALL if not isinstance(d, Gaussian)])
@pytest.mark.parametrize("cosine", [0.1, 0.5, 0.95])
def test_lambda_is_the_hidden_area(distribution, cosine):
    seen = np.array([direction(cosine, 0.6)])
    density = np.asarray(distribution.density(Components.of(FACETS)))
    facing = np.maximum(FACETS @ seen[0], 0)
    expected = np.sum(SOLID_ANGLES * density * facing) / cosine - 1
    found = distribution.smith_lambda(Components.of(seen))[0]
    # The brute-force sum has a kink on the great circle that turns away.
    assert found == pytest.approx(expected, abs=3e-4 / cosine)


@pytest.mark.parametrize("roughness", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("cosine", [0.1, 0.5, 0.95])
def test_lambda_of_the_gaussian_is_the_hidden_area(roughness, cosine):
    polar = np.linspace(0, np.pi / 2, 20001)
    weight = np.exp(-((polar / roughness) ** 2)) * np.sin(polar)
    a, b = cosine * np.cos(polar), np.sqrt(1 - cosine**2) * np.sin(polar)
    edge = np.arccos(np.clip(-a / np.maximum(b, 1e-300), -1, 0))
    facing = np.where(a >= b, 2 * np.pi * a, 2 * (a * edge + b * np.sin(edge)))
    seen = np.trapezoid(weight * facing, polar)
    area = 2 * np.pi * np.trapezoid(weight * np.cos(polar), polar)
    found = Gaussian(roughness).smith_lambda(Components.of(np.array([direction(cosine, 2.0)])))[0]
    assert found == pytest.approx(seen / area / cosine - 1, abs=GAUSSIAN_LAMBDA / cosine)


@pytest.mark.parametrize("distribution", [Gaussian(0.4), Beckmann(0.4), TrowbridgeReitz(0.4)])
def test_smith_masking_from_head_on_to_grazing(distribution):
    head_on = Components.of(np.array([[0, 0, 1.0]]))
    assert smith_facet_masking(distribution, head_on, head_on)[0] == pytest.approx(1, abs=1e-9)
    grazing = [Components.of(np.array([direction(c, 0.3)])) for c in (1e-4, 1e-5)]
    masked = [float(smith_facet_masking(distribution, g, head_on)[0]) for g in grazing]
    assert masked[0] / masked[1] == pytest.approx(10, rel=1e-2)


@pytest.mark.parametrize("kind", [Beckmann, TrowbridgeReitz])
def test_isotropic_is_anisotropic_with_equal_widths(kind):
    facets = Components.of(FACETS[::97])
    for part in ("density", "smith_lambda"):
        one, both = (getattr(d, part)(facets) for d in (kind(0.3), kind(0.3, 0.3)))
        np.testing.assert_array_equal(one, both)


def test_roughness_is_along_the_tangent():
    along, across = (Components.of(np.array([direction(0.9, p)])) for p in (0, np.pi / 2))
    for kind in (Beckmann, TrowbridgeReitz):
        turned = kind(0.1, 0.5), kind(0.5, 0.1)
        assert turned[0].density(across)[0] > 2 * turned[0].density(along)[0]
        np.testing.assert_allclose(
            turned[0].density(along), turned[1].density(across), rtol=ROUNDING
        )


def test_smooth_limit_of_the_gaussian_is_the_thesis_scale():
    peak = float(Gaussian(0.01).density(Components.of(np.array([[0, 0, 1.0]])))[0])
    assert peak == pytest.approx(1 / (np.pi * 0.01**2), rel=1e-4)


def test_v_grooves_hide_nothing_head_on_and_the_farther_side_at_grazing():
    def masked(a, b):
        pair = (Components.of(np.array([d])) for d in (a, b))
        return float(v_groove_masking(Gaussian(0.3), *pair)[0])

    up = direction(1.0, 0.0)
    assert masked(up, up) == 1
    assert masked(direction(0.8, 0.0), direction(0.7, np.pi)) == 1
    low = direction(0.1, 0.0)
    # min(1, 2 h_z cos / (w . h)) = 2 h_z .1 / h_z for the half vector of w and the normal.
    assert masked(up, low) == pytest.approx(0.2, rel=ROUNDING)
    assert masked(low, up) == masked(up, low)


@pytest.mark.parametrize("index", [(0.14, 4.0), (1.5, 0.0), (0.7, 0.0), (3.0, 3.0), (1.2, 0.01)])
def test_metals_reflectance_is_that_of_complex_snell(index):
    eta, k = index
    n = mpmath.mpc(eta, k)
    cosines = np.array([1e-3, 0.1, 0.4, 0.8, 1.0])
    found = conductor_fresnel(eta, k, cosines)
    for c, value in zip(cosines, found, strict=True):
        refracted = mpmath.sqrt(1 - (1 - mpmath.mpf(c) ** 2) / n**2)
        s = abs((c - n * refracted) / (c + n * refracted)) ** 2
        p = abs((n * c - refracted) / (n * c + refracted)) ** 2
        assert float(value) == pytest.approx(float((s + p) / 2), rel=1e-9)


def test_dielectrics_at_brewsters_angle_reflect_one_polarisation():
    """tan t = mu: R_p = 0, and R_s = ((mu^2 - 1) / (mu^2 + 1))^2."""
    mu = 1.5
    cosine = np.full(1, 1 / np.sqrt(1 + mu**2))
    expected = ((mu**2 - 1) / (mu**2 + 1)) ** 2 / 2
    assert fresnel(mu, cosine)[0] == pytest.approx(expected, rel=1e-12)
    assert conductor_fresnel(mu, 0.0, cosine)[0] == pytest.approx(expected, rel=1e-9)


def test_schlicks_is_exact_at_both_ends():
    ends, between = np.array([0.0, 1.0]), np.array([0.5])
    f0 = head_on_reflectance(1.5)
    np.testing.assert_allclose(schlick_fresnel(f0, ends), fresnel(1.5, ends), rtol=ROUNDING)
    assert schlick_fresnel(f0, between)[0] == pytest.approx(0.04 + 0.96 / 32, rel=ROUNDING)


def test_derivatives_of_reflectances_are_finite_at_the_ends():
    cosines = jnp.array([0.0, 0.5, 1.0])
    for k in (0.0, 2.0):
        slopes = jax.grad(lambda *p: conductor_fresnel(*p).sum(), (0, 1, 2))(0.8, k, cosines)
        assert all(np.all(np.isfinite(slope)) for slope in slopes)


@pytest.mark.parametrize("name", list(DISTRIBUTIONS))
@pytest.mark.parametrize("value", [0.0, -0.1, 1.01, float("nan")])
def test_roughness_outside_is_refused(name, value):
    with pytest.raises(ValueError, match=r"roughness=.*must lie in \(0, 1\]; for a mirror"):
        DISTRIBUTIONS[name](value)
