"""The microfacet model with the distributions of today, beside the thesis's Gaussian.

Pinned down: the value is F D G / (4 cos t_i cos t_o) written out in NumPy by tangents, with Smith's
masking of the same distribution; reciprocity with half-angle Fresnel; masked albedo below 1; the
Gaussian is what it was; every method that replaces a part keeps the distribution; derivatives are
finite at the peak and on the horizon, in both precisions; refusals.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brdf_problems import upper_directions
from scipy.special import erfc

from jaxrender.brdf import Microfacet, microfacet_distribution, normalised_fresnel, smith_masking
from jaxrender.brdf.distributions import DISTRIBUTIONS

ROUNDING = 1e-11
KD, KS = np.array([0.05, 0.1, 0.2]), np.array([0.3, 0.2, 0.1])
evaluate = eqx.filter_jit(Microfacet.evaluate)


def model(distribution, sigma=0.3, mu=1.5, masking="smith", fresnel="half"):
    return Microfacet(KD, KS, sigma, mu, fresnel, masking, distribution)


def density(distribution, tangent, a):
    """D by the tangent of the half angle; 1 / cos^2 = 1 + tan^2."""
    lengthened = (1 + tangent**2) ** 2
    if distribution == "beckmann":
        return np.exp(-((tangent / a) ** 2)) * lengthened / (np.pi * a**2)
    return lengthened / (np.pi * a**2 * (1 + (tangent / a) ** 2) ** 2)


def hidden(distribution, tangent, a):
    """Smith's Lambda."""
    if distribution == "beckmann":
        q = 1 / (a * tangent)
        return np.exp(-(q**2)) / (2 * q * np.sqrt(np.pi)) - erfc(q) / 2
    return (np.sqrt(1 + (a * tangent) ** 2) - 1) / 2


def tangent(vectors):
    return np.hypot(vectors[:, 0], vectors[:, 1]) / vectors[:, 2]


@pytest.mark.parametrize("distribution", ["beckmann", "ggx"])
@pytest.mark.parametrize("masking", ["none", "smith"])
@pytest.mark.parametrize("fresnel", ["exit", "half"])
def test_value_by_tangents(distribution, masking, fresnel):
    a, mu = 0.3, 1.5
    incoming, outgoing = upper_directions(300, 0), upper_directions(300, 1)
    half = incoming + outgoing
    expected = density(distribution, tangent(half), a) / (4 * incoming[:, 2] * outgoing[:, 2])
    if masking == "smith":
        both = (hidden(distribution, tangent(v), a) for v in (incoming, outgoing))
        expected = expected / (1 + sum(both))
    between = np.linalg.norm(half, axis=1) / 2
    cosine = outgoing[:, 2] if fresnel == "exit" else between
    expected = expected * np.asarray(normalised_fresnel(mu, cosine))
    found = evaluate(model(distribution, a, mu, masking, fresnel), incoming, outgoing)
    np.testing.assert_allclose(found, KD + KS * expected[:, None], rtol=1e-9)


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_half_angle_fresnel_is_reciprocal(distribution):
    brdf = model(distribution)
    a, b = upper_directions(200, 4), upper_directions(200, 5)
    np.testing.assert_allclose(evaluate(brdf, a, b), evaluate(brdf, b, a), rtol=ROUNDING)
    assert brdf.reciprocal


@pytest.mark.parametrize("distribution", ["beckmann", "ggx"])
def test_masked_albedo_stays_below_one(distribution):
    brdf = Microfacet(np.zeros(1), np.ones(1), 0.4, None, "half", "smith", distribution)
    assert brdf.conserves_energy
    x, w = np.polynomial.legendre.leggauss(200)
    polar, azimuth = (x + 1) * np.pi / 4, (x + 1) * np.pi / 2
    sine, cosine = np.sin(polar)[:, None], np.cos(polar)[:, None] * np.ones(200)
    incoming = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)
    for exit_angle in np.radians([0.0, 60.0, 85.0]):
        outgoing = np.array([-np.sin(exit_angle), 0, np.cos(exit_angle)])
        values = evaluate(brdf, incoming, np.broadcast_to(outgoing, incoming.shape))
        weighed = np.asarray(values)[..., 0] * cosine
        albedo = 2 * (w * np.sin(polar)) @ weighed @ w * np.pi**2 / 8
        assert 0.7 < albedo < 1


def test_the_gaussian_is_the_default_and_what_it_was():
    incoming, outgoing = upper_directions(200, 6), upper_directions(200, 7)
    brdf = Microfacet(KD, KS, 0.2, 1.5, "half", "smith")
    assert brdf == model("gaussian", 0.2)
    half = incoming + outgoing
    angle = np.arctan(tangent(half))
    lobe = np.asarray(microfacet_distribution(angle**2, 0.2))
    lobe = lobe * np.asarray(smith_masking(0.2, incoming[:, 2], outgoing[:, 2]))
    lobe = lobe * np.asarray(normalised_fresnel(1.5, np.linalg.norm(half, axis=1) / 2))
    expected = lobe / (4 * incoming[:, 2] * outgoing[:, 2])
    np.testing.assert_allclose(
        evaluate(brdf, incoming, outgoing), KD + KS * expected[:, None], rtol=ROUNDING
    )


@pytest.mark.parametrize(
    "change",
    [
        lambda brdf: brdf.with_roughness(0.2, None),
        lambda brdf: brdf.with_amplitudes(KS, KD),
        lambda brdf: brdf.with_variant("exit", "none"),
        lambda brdf: brdf.as_metal(),
    ],
)
def test_replaced_parts_keep_the_distribution(change):
    assert change(model("ggx")).distribution == "ggx"


def test_replaced_parts_are_replaced():
    brdf = model("ggx")
    rough, other = brdf.with_roughness(0.2, 1.7), brdf.with_variant("exit", "none")
    assert (rough.sigma, rough.mu, rough.fresnel) == (0.2, 1.7, "half")
    assert (other.fresnel, other.masking, other.sigma) == ("exit", "none", 0.3)
    assert (brdf.as_metal().mu, brdf.as_metal().masking) == (None, "smith")
    np.testing.assert_array_equal(brdf.with_amplitudes(KS, KD).ks, KD)


@pytest.mark.parametrize("distribution", ["beckmann", "ggx"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_derivatives_are_finite(distribution, dtype):
    """Where the half vector is the normal, and where a direction is below the horizon."""
    outgoing = np.array([[0, 0, 1], [0.6, 0, 0.8], [0.6, 0, 0.8]], dtype)
    incoming = np.array([[0, 0, 1], [-0.6, 0, 0.8], [0.6, 0, -0.8]], dtype)

    def total(sigma, mu, incoming):
        amplitudes = KD.astype(dtype), KS.astype(dtype)
        brdf = Microfacet(*amplitudes, sigma, mu, "half", "smith", distribution)
        return brdf.evaluate(incoming, outgoing).sum()

    at = jnp.asarray(0.1, dtype), jnp.asarray(1.5, dtype), jnp.asarray(incoming)
    slopes = jax.jit(jax.grad(total, (0, 1, 2)))(*at)
    assert all(np.all(np.isfinite(slope)) and slope.dtype == dtype for slope in slopes)
    assert np.all(np.asarray(slopes[2])[2] == 0)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"distribution": "phong"},
            "distribution='phong': choose one of gaussian, beckmann, ggx",
        ),
        ({"distribution": "ggx", "sigma": 1.5}, r"sigma=1.5: must lie in \(0, 1\]"),
        ({"distribution": "ggx", "sigma": 0.0}, "sigma=0.0: the roughness must be above 0"),
    ],
)
def test_misuse_is_refused(changed, message):
    arguments = {"kd": KD, "ks": KS, "sigma": 0.2, "mu": 1.5} | changed
    with pytest.raises(ValueError, match=message):
        Microfacet(**arguments)
    # What GGX refuses the Gaussian may have.
    assert Microfacet(KD, KS, 1.5, None).sigma == 1.5
