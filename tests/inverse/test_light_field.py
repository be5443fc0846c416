"""The analytic factorization T 2.68, and what T 3.2.3 to 3.2.7 say that it can and cannot tell.

- Random light and random reciprocal coefficients, and a real reciprocal BRDF's: both come back to
  1e-10 in the gauge; the formula of T 2.68 (with ERRATA 10's Lambda_l^-1) is the same answer.
- All m count: light whose coefficients of one m vanish, and noise that is large for one m.
- Where rho~_l00 vanishes, degrees are tied through other p and q.
- Coefficients that are not reciprocal (without cos t_o: ERRATA 11) are told to be so.
- Uniform light: the light, rho_0p0 and rho_p00, nothing else (T 3.2.3).  Mirror: a factor for each
  degree, and every member of the family gives the same field (T 3.26).  Lambertian: no odd degree
  above 1 (T 3.2.5).  Lobes about the reflected direction: a factor for each degree (T 3.41).
- With noise, errors are what they are said to be (chi-squared over 100 seeds).
"""

import numpy as np
import pytest
from scipy.stats import chi2

from jaxrender.brdf import Lambertian, Microfacet
from jaxrender.harmonics import complex_from_real, degrees
from jaxrender.inverse.light_field.factorization import LightField, factor_light_field
from jaxrender.reflection import convolve_isotropic
from jaxrender.spectra import isotropic_coefficients, mirror_coefficients, phong_transfer

# Both sides are sums of products of numbers of order one.
EXACT = 1e-10
LIMIT = 5
DEGREE = degrees(LIMIT)


def random_light(seed=0, limit=LIMIT, channels=1):
    return np.random.default_rng(seed).normal(size=((limit + 1) ** 2, channels))


def random_reciprocal(seed=1, limit=LIMIT):
    rho = np.random.default_rng(seed).normal(size=(limit + 1,) * 3)
    n, p, q = np.ogrid[: limit + 1, : limit + 1, : limit + 1]
    return (rho + rho.swapaxes(0, 1)) / 2 * (q <= np.minimum(n, p))


def reflected(light, rho):
    """B~_lmpq (T 2.59)."""
    return np.asarray(convolve_isotropic(complex_from_real(light), rho[..., None]))


def factored(light, rho):
    return factor_light_field(LightField.of(reflected(light, rho)))


def in_gauge(light, rho):
    """The truth with L_00 = 1 / Lambda_0."""
    scale = light[0, 0] * np.sqrt(4 * np.pi)
    return light / scale, rho * scale


def assert_recovered(found, light, rho):
    light, rho = in_gauge(light, rho)
    assert np.all(found.light_known)
    size = np.abs(light).max()
    np.testing.assert_allclose(found.light, light, atol=EXACT * size)
    np.testing.assert_allclose(found.brdf[..., 0], rho, atol=EXACT * np.abs(rho).max())


def microfacet_coefficients(reciprocal):
    """A dielectric with masking, Fresnel at the half angle: reciprocal as physics wants it."""
    brdf = Microfacet(np.full(1, 0.1), np.full(1, 0.6), 0.4, 1.5, "half", "smith")
    lobes = isotropic_coefficients(brdf, (LIMIT, LIMIT), reciprocal=reciprocal)
    return np.einsum("klpq,k->lpq", lobes, np.asarray(brdf.amplitudes)[:, 0])


def lambertian_coefficients():
    limits = (LIMIT, LIMIT)
    return np.asarray(isotropic_coefficients(Lambertian(np.ones(1)), limits, reciprocal=True))[0]


@pytest.mark.parametrize("seed", range(3))
def test_random_coefficients_come_back(seed):
    light, rho = random_light(seed), random_reciprocal(seed + 10)
    found = factored(light, rho)
    assert_recovered(found, light, rho)
    assert found.residual[0] < EXACT
    assert found.sentences() == (
        "light and BRDF of degrees 0 to 5 are determined, in the gauge L_00 = 1 / Lambda_0",
    )


def test_a_real_reciprocal_brdf_comes_back():
    light, rho = random_light(), microfacet_coefficients(reciprocal=True)
    assert_recovered(factored(light, rho), light, rho)


def test_it_is_the_formula_of_the_thesis():
    """L_lm = Lambda_l^-1 B_lm00 / B_00l0: the lines between have lost Lambda_l^-1 (ERRATA 10)."""
    light, rho = random_light(), random_reciprocal()
    scale = light[0, 0] * np.sqrt(4 * np.pi)
    field = reflected(light, rho)
    found = complex_from_real(factored(light, rho).light)
    most = (field.shape[3] - 1) // 2
    for degree, order in ((1, 0), (3, 2), (5, -4)):
        ratio = field[degree, LIMIT + order, 0, most, 0] / field[0, LIMIT, degree, most, 0]
        wavelength = np.sqrt(4 * np.pi / (2 * degree + 1))
        value = complex(found[degree * (degree + 1) + order, 0])
        # B_00p0 = Lambda_0 L_00 rho_0p0 is rho_0p0 in the gauge: there the ratio is a light's.
        assert abs(value - ratio / wavelength) < EXACT * abs(ratio)
        assert abs(value - ratio) > 0.05 * abs(ratio)
    assert scale != pytest.approx(1.0)


def test_any_m_will_do():
    """Light that is zero for most m of each degree, a different one each time."""
    light = random_light()
    keep = np.zeros_like(light)
    for degree in range(LIMIT + 1):
        keep[degree * (degree + 1) + (-1) ** degree * (degree // 2)] = 1
    assert_recovered(factored(light * keep, random_reciprocal()), light * keep, random_reciprocal())


def test_degrees_are_tied_through_other_coefficients_where_the_first_vanish():
    """rho_l00 = 0 for all l but 3: T 2.68's denominators vanish, chains through 3 do not."""
    rho = random_reciprocal()
    for degree in (1, 2, 4, 5):
        rho[degree, 0] = rho[0, degree] = 0
    rho[3, 0, 0] = rho[0, 3, 0] = 0.7
    light = random_light()
    assert_recovered(factored(light, rho), light, rho)


def test_channels_have_a_gauge_each():
    light, rho = random_light(channels=2), random_reciprocal()
    found = factored(light, rho)
    for channel in range(2):
        truth = in_gauge(light[:, channel : channel + 1], rho)
        np.testing.assert_allclose(found.light[:, channel], truth[0][:, 0], rtol=1e-9)
        np.testing.assert_allclose(found.brdf[..., channel], truth[1], atol=1e-9)


def test_coefficients_that_are_not_reciprocal_are_told_to_be_so():
    """rho cos t_i without cos t_o (ERRATA 11): the light comes out wrong, and that is said."""
    light, rho = random_light(), microfacet_coefficients(reciprocal=False)
    found = factored(light, rho)
    assert np.abs(found.light - in_gauge(light, rho)[0]).max() > 0.1
    assert found.residual[0] > 0.05
    assert "no reciprocal BRDF explains this field" in found.sentences()[-1]


def test_uniform_light():
    """T 3.2.3: the light, rho_0p0, by reciprocity rho_p00, and nothing else."""
    light, rho = np.zeros_like(random_light()), random_reciprocal()
    light[0] = 2.0
    found = factored(light, rho)
    truth = in_gauge(light, rho)
    assert np.all(found.light_known)
    np.testing.assert_allclose(found.light, truth[0], atol=EXACT)
    expected = np.zeros_like(rho, dtype=bool)
    expected[0, :, 0] = expected[:, 0, 0] = True
    np.testing.assert_array_equal(found.brdf_known[..., 0], expected)
    np.testing.assert_allclose(found.brdf[..., 0], np.where(expected, truth[1], 0), atol=EXACT)
    assert found.sentences()[1] == (
        "the light has nothing at degrees 1 to 5: of the BRDF there, only the 5 coefficients that "
        "reciprocity knows from other degrees"
    )


def test_uniform_light_on_a_brdf_that_does_not_mix_degrees():
    """Where rho_0l0 vanishes, not even that the light vanishes is known."""
    light, rho = np.zeros_like(random_light()), random_reciprocal()
    light[0] = 2.0
    rho[0, 2] = rho[2, 0] = 0
    found = factored(light, rho)
    assert np.flatnonzero(~found.light_known[:, 0]).tolist() == [2]
    assert found.sentences()[-1].startswith("nothing is known of degree 2")


def test_a_mirror_is_known_up_to_a_factor_for_each_degree():
    """T 3.2.4: every member of the family f(l) of T 3.26 has the same field."""
    light, rho = random_light(), mirror_coefficients(LIMIT)
    found = factored(light, rho)
    assert np.flatnonzero(found.light_known[:, 0]).tolist() == [0]
    assert found.component[:, 0].tolist() == list(range(LIMIT + 1))
    # The member that is chosen is the mirror.
    truth = in_gauge(light, rho)
    np.testing.assert_allclose(found.light, truth[0], rtol=1e-9)
    np.testing.assert_allclose(found.brdf[..., 0], truth[1], atol=EXACT * np.abs(truth[1]).max())
    factors = np.array([1, 0.5, -2, 3, 0.1, 7])
    other = found.rescaled(factors)
    np.testing.assert_allclose(other.light, factors[DEGREE, None] * found.light, rtol=1e-12)
    filtered = mirror_coefficients(LIMIT, 1 / factors) * truth[1].max()
    np.testing.assert_allclose(other.brdf[..., 0], filtered, atol=EXACT * np.abs(filtered).max())
    field = reflected(light, rho)
    again = reflected(other.light, other.brdf[..., 0])
    np.testing.assert_allclose(again, field, atol=EXACT * np.abs(field).max())
    assert found.sentences()[1].startswith("degrees 1 to 5 each have an unknown factor")


def test_a_family_leaves_what_is_known_alone():
    """With noise a mirror's other coefficients are not zero, but known: no factor touches them."""
    field = reflected(random_light(), mirror_coefficients(LIMIT))
    deviation = np.full(field.shape, 1e-3)
    noise = noise_of_a_real_field(deviation, np.random.default_rng(0))
    found = factor_light_field(LightField.of(field + noise, deviation))
    assert found.component[:, 0].tolist() == list(range(LIMIT + 1))
    other = found.rescaled(np.array([1, 0.5, -2, 3, 0.1, 7]))
    known = found.brdf_known
    assert np.any(found.brdf[known] != 0)
    np.testing.assert_array_equal(other.brdf[known], found.brdf[known])
    assert np.all(other.brdf[~known & (found.brdf != 0)] != found.brdf[~known & (found.brdf != 0)])


def test_a_family_is_no_excuse_where_degrees_are_tied():
    found = factored(random_light(), random_reciprocal())
    with pytest.raises(ValueError, match="their factors must be 1"):
        found.rescaled(np.array([1, 2, 1, 1, 1, 1.0]))
    mirror = factored(random_light(), mirror_coefficients(LIMIT))
    with pytest.raises(ValueError, match="factor of zero"):
        mirror.rescaled(np.array([1, 0, 1, 1, 1, 1.0]))


def test_degrees_tied_to_one_another_but_not_to_the_gauge():
    """Blocks {0, 1, 2} and {3, 4, 5}: one unknown factor for the three."""
    light, rho = random_light(), random_reciprocal()
    rho[:3, 3:] = rho[3:, :3] = 0
    found = factored(light, rho)
    assert found.component[:, 0].tolist() == [0, 0, 0, 1, 1, 1]
    truth = in_gauge(light, rho)
    ratio = found.light[:, 0] / truth[0][:, 0]
    np.testing.assert_allclose(ratio[DEGREE < 3], 1, rtol=1e-9)
    np.testing.assert_allclose(ratio[DEGREE >= 3], ratio[-1], rtol=1e-9)
    assert "degrees 3 to 5 together have an unknown factor" in found.sentences()[1]
    with pytest.raises(ValueError, match="give them one factor"):
        found.rescaled(np.array([1, 1, 1, 2, 2, 3.0]))


def test_lambertian():
    """T 3.2.5: rho~ = c_l c_p without odd degrees above 1, so neither is the light known there."""
    light, rho = random_light(), lambertian_coefficients()
    found = factored(light, rho)
    known = found.light_known[:, 0]
    assert np.flatnonzero(known).tolist() == [0, 1, 2, 4]
    truth = in_gauge(light, rho)
    np.testing.assert_allclose(found.light[known[DEGREE]], truth[0][known[DEGREE]], rtol=1e-9)
    assert "nothing is known of degrees 3, 5" in found.sentences()[1]


def test_a_lobe_about_the_reflected_direction():
    """T 3.2.6, 3.2.7: one coefficient a degree, no reciprocity, so a factor for each (T 3.41)."""
    transfer = phong_transfer(8.0, LIMIT) / np.sqrt(4 * np.pi / (2 * np.arange(LIMIT + 1) + 1))
    found = factored(random_light(), np.asarray(transfer)[:, None, None])
    assert found.component[:, 0].tolist() == list(range(LIMIT + 1))
    sharper = found.rescaled(np.array([1, *np.asarray(phong_transfer(8.0, LIMIT))[1:]]))
    again = reflected(sharper.light, sharper.brdf[..., 0])
    field = reflected(random_light(), np.asarray(transfer)[:, None, None])
    np.testing.assert_allclose(again, field, atol=EXACT * np.abs(field).max())


def noise_of_a_real_field(deviation, rng):
    """Noise with the symmetry of a real light field: B_l-mp-q = (-1)^m conj(B_lmpq)."""
    noise = rng.normal(size=deviation.shape) + 1j * rng.normal(size=deviation.shape)
    most = (deviation.shape[1] - 1) // 2
    sign = ((-1.0) ** np.arange(-most, most + 1))[None, :, None, None, None]
    return (noise + sign * noise[:, ::-1, :, ::-1].conj()) / 2 * deviation


def test_errors_are_as_stated():
    """Noise of .3 to 3 %, very different from coefficient to coefficient; other weights fail."""
    limit, seeds = 3, 100
    light, rho = random_light(limit=limit), random_reciprocal(limit=limit)
    rho[0, :, 0] += 1
    rho[:, 0, 0] = rho[0, :, 0]
    field = reflected(light, rho)
    deviation = 0.01 * np.exp(np.random.default_rng(5).uniform(-1.2, 1.2, field.shape))
    deviation = np.sqrt((deviation**2 + deviation[:, ::-1, :, ::-1] ** 2) / 2)
    truth = in_gauge(light, rho)
    scores, misfits = [], []
    for seed in range(seeds):
        noise = noise_of_a_real_field(deviation, np.random.default_rng(seed))
        found = factor_light_field(LightField.of(field + noise, deviation))
        known = found.brdf_known[..., 0]
        off = [(found.light - truth[0])[1:, 0], (found.brdf[..., 0] - truth[1])[known]]
        error = [found.light_error[1:, 0], found.brdf_error[..., 0][known]]
        scores.append(np.concatenate(off) / np.concatenate(error))
        misfits.append(found.chi_squared[0])
    # Each coefficient's own scores are independent from seed to seed, so that each column is
    # chi-squared; one in 10^5 of them may leave this band.
    each = np.sum(np.square(scores), axis=0)
    low, high = chi2.interval(1 - 1e-5, seeds)
    assert np.all((each > low) & (each < high))
    # Chi-squared of some 130 degrees of freedom, over 100 seeds: 3.5 standard errors.
    assert np.mean(misfits) == pytest.approx(1, abs=0.045)


def test_refusals():
    with pytest.raises(ValueError, match="nothing is lit"):
        factored(np.zeros((36, 1)), random_reciprocal())
    with pytest.raises(ValueError, match="not finite"):
        factored(np.full((36, 1), np.nan), random_reciprocal())
