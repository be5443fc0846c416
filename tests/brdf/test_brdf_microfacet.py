"""The thesis's microfacet model and its variants.

Pinned down: the value is T 6.2, written out here in NumPy with half vectors and arc tangents; the
Fresnel ratio is the normalised one (ERRATA 44), at the exit or at the half angle; the half-angle
variant is reciprocal and the thesis's is not; the directional albedo shows the thesis's excess at
grazing exit to the digits of ERRATA 25, and Smith's masking removes it; nothing below the horizon;
derivatives are finite where the half vector is the normal; every refusal.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import Microfacet, microfacet_distribution, smith_masking

ROUNDING = 1e-12
# Compiled once for each shape and variant.
evaluate = eqx.filter_jit(Microfacet.evaluate)

KD, KS = np.array([0.05, 0.1, 0.2]), np.array([0.3, 0.2, 0.1])


def upper_directions(count, seed, lowest=0.05):
    rng = np.random.default_rng(seed)
    cosine, azimuth = rng.uniform(lowest, 1, count), rng.uniform(0, 2 * np.pi, count)
    sine = np.sqrt(1 - cosine**2)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)


def fresnel_ratio(mu, cosine):
    refracted = np.sqrt(1 - (1 - cosine**2) / mu**2)
    s = (cosine - mu * refracted) / (cosine + mu * refracted)
    p = (mu * cosine - refracted) / (mu * cosine + refracted)
    return (s**2 + p**2) / 2 * ((mu + 1) / (mu - 1)) ** 2


def t62(brdf, incoming, outgoing):
    """kd + ks F S / (4 cos t_i cos t_o), S = exp(-(t_h / sigma)^2) / (pi sigma^2)."""
    half = incoming + outgoing
    angle = np.arctan2(np.hypot(half[:, 0], half[:, 1]), half[:, 2])
    sigma = float(brdf.sigma)
    lobe = np.exp(-((angle / sigma) ** 2)) / (np.pi * sigma**2)
    between = np.einsum("di,di->d", incoming, half) / np.linalg.norm(half, axis=1)
    cosine = outgoing[:, 2] if brdf.fresnel == "exit" else between
    ratio = 1 if brdf.mu is None else fresnel_ratio(float(brdf.mu), cosine)
    specular = ratio * lobe / (4 * incoming[:, 2] * outgoing[:, 2])
    return KD + KS * specular[:, None]


@pytest.mark.parametrize("sigma", [0.05, 0.2, 0.6])
@pytest.mark.parametrize("mu", [None, 1.3, 2.0])
@pytest.mark.parametrize("fresnel", ["exit", "half"])
def test_value_is_t62(sigma, mu, fresnel):
    brdf = Microfacet(KD, KS, sigma, mu, fresnel)
    incoming, outgoing = upper_directions(300, 0), upper_directions(300, 1)
    # Near the mirror direction too, where a narrow lobe has its light.
    incoming[:150] = outgoing[:150] * [-1, -1, 1] + 0.3 * sigma * incoming[:150]
    incoming /= np.linalg.norm(incoming, axis=1, keepdims=True)
    # A rounding of 1e-16 in the half vector's cosine is 4e-14 of the exponent at sigma = .05.
    np.testing.assert_allclose(
        evaluate(brdf, incoming, outgoing), t62(brdf, incoming, outgoing), rtol=1e-11
    )


def test_masking_multiplies_the_specular_lobe_alone():
    incoming, outgoing = upper_directions(50, 2), upper_directions(50, 3)
    plain, masked = (Microfacet(KD, KS, 0.4, 1.5, "exit", m) for m in ("none", "smith"))
    specular = np.asarray(plain.evaluate(incoming, outgoing)) - KD
    factor = np.asarray(smith_masking(0.4, incoming[:, 2], outgoing[:, 2]))
    assert np.all((factor > 0) & (factor < 1))
    np.testing.assert_allclose(
        masked.evaluate(incoming, outgoing), KD + factor[:, None] * specular, rtol=ROUNDING
    )


@pytest.mark.parametrize("masking", ["none", "smith"])
def test_half_angle_fresnel_is_reciprocal(masking):
    brdf = Microfacet(KD, KS, 0.3, 1.5, "half", masking)
    a, b = upper_directions(200, 4), upper_directions(200, 5)
    np.testing.assert_allclose(brdf.evaluate(a, b), brdf.evaluate(b, a), rtol=ROUNDING)


def test_exit_angle_fresnel_is_not_reciprocal():
    """The thesis's choice; a metal, without the ratio, is reciprocal again."""
    a, b = np.array([[0, 0, 1.0]]), np.array([[0.8, 0, 0.6]])
    thesis, metal = Microfacet(KD, KS, 0.3, 1.5), Microfacet(KD, KS, 0.3, None)
    assert np.max(np.abs(thesis.evaluate(a, b) / thesis.evaluate(b, a) - 1)) > 0.01
    np.testing.assert_allclose(metal.evaluate(a, b), metal.evaluate(b, a), rtol=ROUNDING)


def directional_albedo(brdf, exit_degrees, nodes=256):
    """int rho cos t_i dw_i by Gauss-Legendre in the angle from the normal and in azimuth."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    polar, weights = (x + 1) * np.pi / 4, w * np.pi / 4
    azimuth, around = (x + 1) * np.pi / 2, w * np.pi / 2
    sine, cosine = np.sin(polar)[:, None], np.cos(polar)[:, None] * np.ones(nodes)
    incoming = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)
    angle = np.radians(exit_degrees)
    outgoing = np.broadcast_to([np.sin(angle), 0, np.cos(angle)], incoming.shape)
    values = np.asarray(evaluate(brdf, incoming, outgoing))[..., 0] * cosine
    return 2 * (weights * np.sin(polar)) @ values @ around


@pytest.mark.parametrize(
    ("sigma", "exit_degrees", "expected"),
    [
        (0.2, 0, 0.974),
        (0.2, 70, 0.938),
        (0.2, 85, 1.207),
        (0.5, 0, 0.805),
        (0.5, 80, 1.19),
        (0.5, 85, 1.88),
    ],
)
def test_directional_albedo_exceeds_one_at_grazing(sigma, exit_degrees, expected):
    """ERRATA 25, K_s = F = 1: the thesis leaves the masking out, and so do we by default."""
    brdf = Microfacet(np.zeros(1), np.ones(1), sigma, None)
    digits = 10.0 ** -len(str(expected).partition(".")[2])
    assert directional_albedo(brdf, exit_degrees) == pytest.approx(expected, abs=0.6 * digits)


@pytest.mark.parametrize("sigma", [0.1, 0.2, 0.5])
@pytest.mark.parametrize("exit_degrees", [0, 45, 70, 85, 88])
def test_masked_albedo_stays_below_one(sigma, exit_degrees):
    brdf = Microfacet(np.zeros(1), np.ones(1), sigma, None, masking="smith")
    assert 0.3 < directional_albedo(brdf, exit_degrees) < 1


def test_distribution_has_unit_projected_area_for_smooth_surfaces():
    """int S cos t dw = 1 - 2 sigma^2 / 3 + ..., the normalisation that T 6.2's 1/4 goes with."""
    sigma = 0.05
    x, w = np.polynomial.legendre.leggauss(200)
    angle, weights = (x + 1) * 5 * sigma, w * 5 * sigma
    lobe = np.asarray(microfacet_distribution(angle**2, sigma))
    area = 2 * np.pi * np.sum(weights * lobe * np.sin(angle) * np.cos(angle))
    assert area == pytest.approx(1 - 2 * sigma**2 / 3, abs=2 * sigma**4)


@pytest.mark.parametrize(
    ("incoming", "outgoing"), [([0.6, 0, -0.8], [-0.6, 0, 0.8]), ([0, 0, 1], [0.6, 0, -0.8])]
)
@pytest.mark.parametrize("masking", ["none", "smith"])
def test_nothing_below_the_horizon(incoming, outgoing, masking):
    brdf = Microfacet(KD, KS, 0.2, 1.5, "half", masking)
    values = brdf.evaluate(np.array(incoming, float), np.array(outgoing, float))
    np.testing.assert_array_equal(values, np.zeros(3))


@pytest.mark.parametrize(
    ("fresnel", "masking", "dtype"),
    [
        ("exit", "none", np.float32),
        ("half", "smith", np.float32),
        ("half", "none", np.float64),
        ("exit", "smith", np.float64),
    ],
)
def test_derivatives_are_finite_where_half_vector_is_normal(fresnel, masking, dtype):
    directions = np.array([[0, 0, 1], [0.6, 0, 0.8]], dtype)
    mirrored = directions * np.array([-1, -1, 1], dtype)

    def total(sigma, mu, incoming):
        brdf = Microfacet(KD.astype(dtype), KS.astype(dtype), sigma, mu, fresnel, masking)
        return brdf.evaluate(incoming, mirrored).sum()

    at = jnp.asarray(0.1, dtype), jnp.asarray(1.5, dtype), jnp.asarray(directions)
    slopes = jax.jit(jax.grad(total, (0, 1, 2)))(*at)
    assert all(np.all(np.isfinite(slope)) and slope.dtype == dtype for slope in slopes)
    # At the peak the lobe is proportional to sigma^-2, whatever else multiplies it head-on.
    if masking == "none":
        specular = float(total(*at)) - 2 * KD.sum()
        assert float(slopes[0]) == pytest.approx(-2 * specular / 0.1, rel=1e-4)


def test_single_precision_agrees_with_double():
    incoming, outgoing = upper_directions(200, 6), upper_directions(200, 7)
    double = Microfacet(KD, KS, 0.2, 1.5).evaluate(incoming, outgoing)
    single = Microfacet(
        KD.astype(np.float32), KS.astype(np.float32), jnp.float32(0.2), jnp.float32(1.5)
    ).evaluate(incoming.astype(np.float32), outgoing.astype(np.float32))
    assert single.dtype == jnp.float32
    # 6e-8 in the cosine is 1e-5 of the exponent's value of up to 25.
    np.testing.assert_allclose(single, double, rtol=1e-4)


def test_as_metal_divides_the_ratio_out():
    brdf = Microfacet(np.zeros(3), KS, 0.2, 1.5, "exit", "smith")
    a, b = upper_directions(20, 8), upper_directions(20, 9)
    ratio = fresnel_ratio(1.5, b[:, 2])[:, None]
    product = ratio * brdf.as_metal().evaluate(a, b)
    np.testing.assert_allclose(product, brdf.evaluate(a, b), rtol=ROUNDING)


def test_with_roughness_keeps_the_variant():
    changed = Microfacet(KD, KS, 0.2, 1.5, "half", "smith").with_roughness(0.3, 1.7)
    assert (changed.sigma, changed.mu, changed.fresnel, changed.masking) == (
        0.3,
        1.7,
        "half",
        "smith",
    )


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"fresnel": "entry"}, "fresnel='entry': choose one of exit, half"),
        ({"masking": "beckmann"}, "masking='beckmann': choose one of none, smith"),
        ({"sigma": 0.0}, "sigma=0.0: the roughness must be above 0"),
        ({"sigma": float("nan")}, "sigma=nan"),
        ({"mu": 1.0}, "mu=1.0: the refractive index must be above 1, or None for a metal"),
    ],
)
def test_misuse_is_refused(changed, message):
    arguments = {"kd": KD, "ks": KS, "sigma": 0.2, "mu": 1.5} | changed
    with pytest.raises(ValueError, match=message):
        Microfacet(**arguments)
