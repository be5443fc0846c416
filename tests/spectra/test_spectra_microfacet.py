"""The transfer of the microfacet lobe by degree and exit cosine.

Pinned down: each h_l is the integral of T 6.2's lobe times P_l(w . R) over the hemisphere, done
here by SciPy in the surface's own angles, and at grazing by sums over half vectors; its derivatives
in sigma and mu; at normal exitance T 3.44; the sizes of ERRATA 27: how far off the thesis's
Gaussian is and that Lambda_0 rho_0 is not 1; the interpolation over exit cosines; each twin's own
formula; both precisions; the refusal.
"""

import math
from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import dblquad, quad
from scipy.special import eval_legendre

from jaxrender import spectra
from jaxrender.brdf import Microfacet, normalised_fresnel
from jaxrender.geometry import Components
from jaxrender.spectra import TRANSFERS

# What the module promises, relative to the largest of the degrees.
PROMISED = 1e-6
# Cubic interpolation between 64 knots, relative to the largest of a sample's degrees.
INTERPOLATION = 4e-5

# Compiled once for each shape and variant.
exit_cosine_transfer = eqx.filter_jit(spectra.exit_cosine_transfer)
normal_exitance_transfer = eqx.filter_jit(spectra.normal_exitance_transfer)
gaussian_transfer = eqx.filter_jit(spectra.gaussian_transfer)
transfer_of_samples = eqx.filter_jit(spectra.transfer_of_samples)


def microfacet(sigma, mu=None, fresnel="exit", masking="none"):
    return Microfacet(np.zeros(1), np.ones(1), sigma, mu, fresnel, masking)


def hemisphere_integral(sigma, exit_cosine, degree):
    """int exp(-(t_h / s)^2) / (4 pi s^2 cos t_o) P_l(w . R) dw over w above the horizon."""
    sin_o = math.sqrt(1 - exit_cosine**2)
    exit_angle = math.acos(exit_cosine)

    def integrand(azimuth, polar):
        # Azimuth is measured from R, opposite to the camera.
        sine, cosine = math.sin(polar), math.cos(polar)
        along = sine * math.cos(azimuth)
        across = sine * math.sin(azimuth)
        half = math.atan2(math.hypot(sin_o - along, across), cosine + exit_cosine)
        toward_mirror = along * sin_o + cosine * exit_cosine
        lobe = math.exp(-((half / sigma) ** 2)) / (4 * math.pi * sigma**2 * exit_cosine)
        return lobe * eval_legendre(degree, min(toward_mirror, 1)) * sine

    # Beyond these the lobe is below exp(-16): 4 sigma for the half vector, twice that for w.
    reach = 8.5 * sigma
    low, high = max(0, exit_angle - reach), min(math.pi / 2, exit_angle + reach)
    widest = math.pi if low <= reach else min(math.pi, reach / math.sin(low))
    total = sum(
        dblquad(integrand, *edges, 0, widest, epsabs=2e-7, epsrel=2e-7)[0]
        for edges in ((low, exit_angle), (exit_angle, high))
        if edges[1] > edges[0]
    )
    return 2 * total


def over_half_vectors(sigma, exit_cosine, degrees, count=80):
    """The same integral over half vectors, 4 (o.h) dh for dw: there the lobe is round at grazing.

    w.z > 0 wherever cos(psi) > (o_z / 2 h_z - o_z h_z) / (sin t_o sin t_h).
    """
    sin_o = np.sqrt(1 - exit_cosine**2)
    outgoing = np.array([sin_o, 0, exit_cosine])
    nodes, weights = np.polynomial.legendre.leggauss(count)
    nodes, weights = (nodes + 1) / 2, weights / 2
    # The circles about N meet the horizon from half of what the exit is above it.
    edges = [0, min((np.pi / 2 - np.arccos(exit_cosine)) / 2, 7 * sigma), 7 * sigma]
    total = np.zeros(len(degrees))
    for first, last in pairwise(edges):
        polar = first + (last - first) * nodes**2
        cosine, sine = np.cos(polar), np.sin(polar)
        horizon = (exit_cosine / (2 * cosine) - exit_cosine * cosine) / (sin_o * sine)
        end = np.arccos(np.clip(horizon, -1, 1))[:, None]
        around, level = end * nodes, np.broadcast_to(cosine[:, None], (count, count))
        h = np.stack([sine[:, None] * np.cos(around), sine[:, None] * np.sin(around), level], -1)
        facing = h @ outgoing
        incoming = 2 * facing[..., None] * h - outgoing
        toward_mirror = np.minimum(incoming @ (outgoing * [-1, -1, 1]), 1)
        lobe = np.exp(-((polar / sigma) ** 2)) / (np.pi * sigma**2) * sine
        measure = 2 * (last - first) * nodes * weights * lobe
        both = measure[:, None] * 2 * end * weights * facing / exit_cosine
        total += [np.sum(both * eval_legendre(degree, toward_mirror)) for degree in degrees]
    return total


@pytest.mark.parametrize(("exit_cosine", "accuracy"), [(0.02, 1e-5), (0.15, PROMISED)])
def test_a_narrow_lobe_at_grazing_exit(exit_cosine, accuracy):
    """sigma .01: the lobe is fifty times narrower across the plane of incidence than in it."""
    degrees = [0, 1, 32, 128]
    expected = over_half_vectors(0.01, exit_cosine, degrees)
    found = exit_cosine_transfer(microfacet(0.01), np.array([exit_cosine]), 128)[0, degrees]
    np.testing.assert_allclose(found, expected, atol=accuracy)


@pytest.mark.parametrize(
    ("sigma", "exit_cosine", "degree"),
    [
        (0.02, 0.15, 40),
        (0.02, 0.6, 0),
        (0.1, 0.15, 0),
        (0.1, 0.15, 9),
        (0.1, 0.5, 5),
        (0.3, 0.15, 4),
        (0.3, 0.6, 2),
        (0.3, 1.0, 3),
        # A wide lobe, where the polynomial itself makes the waves.
        (0.5, 0.15, 64),
    ],
)
def test_transfer_is_the_hemispherical_integral(sigma, exit_cosine, degree):
    found = np.asarray(exit_cosine_transfer(microfacet(sigma), np.array([exit_cosine]), degree))[0]
    expected = hemisphere_integral(sigma, exit_cosine, degree)
    assert found[degree] == pytest.approx(expected, abs=PROMISED * np.abs(found).max())


@pytest.mark.parametrize("masking", ["none", "smith"])
@pytest.mark.parametrize("fresnel", ["exit", "half"])
def test_degree_zero_is_the_directional_albedo(fresnel, masking):
    """Another quadrature with every factor in it: Gauss-Legendre over the BRDF's own values."""
    brdf = microfacet(0.3, 1.5, fresnel, masking)
    x, w = np.polynomial.legendre.leggauss(200)
    polar, azimuth = (x + 1) * np.pi / 4, (x + 1) * np.pi / 2
    sine, cosine = np.sin(polar)[:, None], np.cos(polar)[:, None] * np.ones(200)
    incoming = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)
    outgoing = np.broadcast_to([0.8, 0, 0.6], incoming.shape)
    values = np.asarray(brdf.evaluate(incoming, outgoing))[..., 0] * cosine
    albedo = 2 * (w * np.sin(polar)) @ values @ w * (np.pi / 4) * (np.pi / 2)
    found = exit_cosine_transfer(brdf, np.array([0.6]), 0)[0, 0]
    assert found == pytest.approx(albedo, rel=PROMISED)


@pytest.mark.parametrize("fresnel", ["exit", "half"])
def test_derivatives_in_sigma_and_mu(fresnel):
    cosines = np.array([0.15, 0.5, 1.0])

    @jax.jit
    def transfer(sigma, mu):
        return spectra.exit_cosine_transfer(microfacet(sigma, mu, fresnel, "smith"), cosines, 12)

    slopes = jax.jit(jax.jacfwd(transfer, (0, 1)))
    for sigma in (0.02, 0.1, 0.3):
        at = np.array([sigma, 1.5])
        for argument, slope in enumerate(slopes(*at)):
            step = 1e-4 * at[argument] * np.eye(2)[argument]
            numeric = (transfer(*(at + step)) - transfer(*(at - step))) / (2 * step.sum())
            # Central differences with a relative step of 1e-4 are good to 1e-7 or so.
            np.testing.assert_allclose(slope, numeric, atol=1e-5 * np.abs(numeric).max())


@pytest.mark.parametrize("sigma", [0.1, 0.5])
def test_head_on_it_is_t344(sigma):
    """2 pi int_0^(pi/2) exp(-(t / 2 s)^2) / (4 pi s^2) P_l(cos t) sin t dt."""

    def integral(degree):
        return quad(
            lambda t: (
                np.exp(-((t / (2 * sigma)) ** 2))
                / (2 * sigma**2)
                * eval_legendre(degree, np.cos(t))
                * np.sin(t)
            ),
            0,
            np.pi / 2,
            epsabs=1e-12,
            limit=200,
        )[0]

    expected = [integral(degree) for degree in range(21)]
    head_on = exit_cosine_transfer(microfacet(sigma), np.ones(1), 20)[0]
    np.testing.assert_allclose(head_on, expected, atol=1e-9)


@pytest.mark.parametrize(
    ("sigma", "off", "energy"),
    [(0.1, 0.044, 0.993), (0.2, 0.091, 0.974), (0.3, 0.139, 0.941), (0.5, 0.231, 0.805)],
)
def test_how_far_the_gaussian_is_off(sigma, off, energy):
    """ERRATA 27: exp(-(sigma l)^2) against T 3.44, and Lambda_0 rho_0, to the printed digits."""
    exact = normal_exitance_transfer(microfacet(sigma), np.ones(1), 64)[0]
    gaussian = gaussian_transfer(microfacet(sigma), np.ones(1), 64)[0]
    assert np.abs(gaussian - exact).max() == pytest.approx(off, abs=6e-4)
    assert exact[0] == pytest.approx(energy, abs=6e-4)


def test_twins_carry_each_samples_fresnel_ratio():
    cosines = np.array([0.2, 0.6, 1.0])
    ratio = np.asarray(normalised_fresnel(1.5, cosines))[:, None]
    degrees = np.arange(9)
    np.testing.assert_allclose(
        gaussian_transfer(microfacet(0.2, 1.5), cosines, 8),
        ratio * np.exp(-((0.2 * degrees) ** 2)),
        rtol=1e-12,
    )
    metal = np.asarray(exit_cosine_transfer(microfacet(0.2), np.ones(1), 8))
    np.testing.assert_allclose(
        normal_exitance_transfer(microfacet(0.2, 1.5), cosines, 8), ratio * metal, rtol=1e-12
    )
    # The real thing agrees with the normal-exitance twin head-on and nowhere else.
    real = np.asarray(exit_cosine_transfer(microfacet(0.2, 1.5), cosines, 8))
    np.testing.assert_allclose(real[2], metal[0], rtol=1e-12)
    assert np.abs(real[0] / (ratio * metal)[0] - 1).max() > 0.05


@pytest.mark.parametrize("variant", [("exit", "none"), ("half", "smith")])
@pytest.mark.parametrize("sigma", [0.05, 0.2, 0.5])
def test_interpolation_over_exit_cosines(sigma, variant):
    brdf = microfacet(sigma, 1.5, *variant)
    cosines = np.concatenate([np.linspace(0.1, 0.2, 21), np.linspace(0.2, 1, 40)])
    band_limit = int(np.ceil(3.2 / sigma))  # all that the lobe passes
    direct = np.asarray(exit_cosine_transfer(brdf, cosines, band_limit))
    found = np.asarray(transfer_of_samples(brdf, cosines, band_limit))
    error = np.abs(found - direct).max(axis=1) / np.abs(direct).max(axis=1)
    assert error.max() < INTERPOLATION


@pytest.mark.parametrize("name", TRANSFERS)
def test_every_transfer_is_found_by_its_name(name):
    brdf = microfacet(0.3, 1.5)
    cosines = np.array([1.0, 0.37])
    direct = eqx.filter_jit(TRANSFERS[name])(brdf, cosines, 6)
    np.testing.assert_allclose(transfer_of_samples(brdf, cosines, 6, name), direct, rtol=1e-4)


def test_cosines_a_rounding_above_one_are_head_on():
    above = np.array([1 + 4e-16])
    for function in (exit_cosine_transfer, transfer_of_samples):
        np.testing.assert_allclose(
            function(microfacet(0.2), above, 4), function(microfacet(0.2), np.ones(1), 4)
        )


def test_single_precision():
    cosines = np.linspace(0.15, 1, 9)

    def value_and_slope(dtype):
        def total(sigma):
            mu = jnp.asarray(1.5, dtype)
            one = np.ones(1, dtype)
            brdf = Microfacet(one, one, sigma, mu, "half", "smith")
            return spectra.transfer_of_samples(brdf, cosines.astype(dtype), 16)

        at = jnp.asarray(0.1, dtype)
        return jax.jit(lambda sigma: jax.jvp(total, (sigma,), (jnp.ones_like(sigma),)))(at)

    (single, slope), (double, slope_double) = (value_and_slope(d) for d in (np.float32, np.float64))
    assert single.dtype == slope.dtype == jnp.float32
    # 6e-8 in the half vector's cosine is 1e-5 of the exponent at sigma = .1.
    np.testing.assert_allclose(single, double, atol=3e-4 * np.abs(double).max())
    np.testing.assert_allclose(slope, slope_double, atol=1e-3 * np.abs(slope_double).max())


def test_an_unknown_transfer_is_refused():
    with pytest.raises(
        ValueError, match="transfer='phong': choose one of exit-cosine, normal-exitance, gaussian"
    ):
        transfer_of_samples(microfacet(0.2), np.ones(1), 4, "phong")


@pytest.mark.parametrize("exit_cosine", [0.9, 0.1, 0.001])
def test_the_lobe_is_that_of_t342(exit_cosine):
    """ERRATA 24: T 3.42 and 6.2 divide by cos t_o, T 5.34 under the same name does not.

    So the lobe's peak over all exits is not square integrable, and only 5.34's has a table.
    """
    exit_sine = math.sqrt(1 - exit_cosine**2)
    outgoing, mirrored = (
        Components(*(jnp.asarray(part) for part in (x, 0.0, exit_cosine)))
        for x in (exit_sine, -exit_sine)
    )
    # Towards the mirrored direction the half vector is the normal, whatever the exit angle.
    lobe = microfacet(0.2).transfer(mirrored, outgoing)[1]
    np.testing.assert_allclose(lobe * exit_cosine, 1 / (4 * np.pi * 0.2**2), rtol=1e-9)
