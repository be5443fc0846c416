"""Zernike series on the pair of hemispheres, and their fit.

Pinned down: the radial polynomials are SciPy's Jacobi polynomials; all functions are orthonormal by
quadrature over both hemispheres; 5 functions of order 2 and 55 of order 8, as CUReT's files have;
they are reciprocal, isotropic and symmetric; a series is recovered exactly from 205 random
measurements, and errors left out are those of fits that really leave out; noise is stated within
its statistics; float32, derivatives, masks and misuse.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.special import eval_jacobi

from jaxrender.brdf import BRDF, Lambertian, OrenNayar, reciprocity_error
from jaxrender.brdf.tables.zernike import (
    ZernikeBRDF,
    radial_polynomial,
    zernike_functions,
    zernike_indices,
)
from jaxrender.brdf.tables.zernike_fit import fit_zernike
from jaxrender.geometry import Components

evaluate = eqx.filter_jit(BRDF.evaluate)
# Pairs of directions: one number for all, so that the programs are the same.
COUNT = 205


def random_pairs(count, seed=0, least=0.1):
    rng = np.random.default_rng(seed)
    cosine, turn = rng.uniform(least, 1, (2, count)), rng.uniform(0, 7, (2, count))
    sine = np.sqrt(1 - cosine**2)
    return tuple(np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=-1))


def random_series(order=8, channels=1, seed=0):
    rng = np.random.default_rng(seed)
    return ZernikeBRDF(rng.normal(size=(len(zernike_indices(order)), channels)), order)


@pytest.mark.parametrize(("n", "m"), [(0, 0), (2, 0), (8, 0), (5, 3), (8, 2), (7, 7)])
def test_radial_polynomials(n, m):
    square = np.linspace(0, 1, 9)
    found = np.polynomial.polynomial.polyval(square, radial_polynomial(n, m))
    half = (n - m) // 2
    np.testing.assert_allclose(found, eval_jacobi(half, 0, m, 2 * square - 1), atol=1e-12)
    assert found[-1] == pytest.approx(1)


@pytest.mark.parametrize(("order", "count"), [(0, 1), (1, 2), (2, 5), (8, 55)])
def test_counts(order, count):
    indices = zernike_indices(order)
    assert len(set(indices)) == len(indices) == count
    for n, k, m in indices:
        assert m <= k <= n <= order
        assert (n - m) % 2 == (k - m) % 2 == 0


def test_orthonormal_over_both_hemispheres():
    """Gauss-Legendre in the cosines, equal steps in the azimuth between the directions."""
    x, w = np.polynomial.legendre.leggauss(10)
    cosine, weight = (x + 1) / 2, w / 2
    turn = np.arange(18) * 2 * np.pi / 18
    a, b, p = (g.ravel() for g in np.meshgrid(cosine, cosine, turn, indexing="ij"))
    sine = [np.sqrt(1 - c**2) for c in (a, b)]
    incoming = Components(sine[0], np.zeros_like(a), a)
    outgoing = Components(sine[1] * np.cos(p), sine[1] * np.sin(p), b)
    functions = np.stack(eqx.filter_jit(zernike_functions)(incoming, outgoing, 8))
    # The other azimuth is free: 2 pi.
    weights = 2 * np.pi * np.einsum("a,b,p->abp", weight, weight, np.full(18, 2 * np.pi / 18))
    gram = np.einsum("fj,gj,j->fg", functions, functions, weights.ravel())
    np.testing.assert_allclose(gram, np.eye(55), atol=1e-12)


def test_reciprocal_isotropic_symmetric():
    series = random_series()
    assert reciprocity_error(series) < 1e-9
    incoming, outgoing = random_pairs(COUNT)
    values = evaluate(series, incoming, outgoing)
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    np.testing.assert_allclose(evaluate(series, incoming @ turn.T, outgoing @ turn.T), values)
    mirrored = evaluate(series, incoming * [1, -1, 1], outgoing * [1, -1, 1])
    np.testing.assert_allclose(mirrored, values)


def test_the_constant_is_lambert():
    series = ZernikeBRDF(np.array([[2 * np.pi * 0.1]]), 0)
    incoming, outgoing = random_pairs(5)
    np.testing.assert_allclose(evaluate(series, incoming, outgoing), 0.1, rtol=1e-14)
    assert series.conserves_energy
    assert not ZernikeBRDF(np.array([[2.1]]), 0).conserves_energy
    below = incoming * np.array([1, 1, -1])
    assert np.all(np.asarray(evaluate(series, below, outgoing)) == 0)


def test_float32_and_derivatives():
    series = random_series()
    incoming, outgoing = random_pairs(COUNT)
    single = evaluate(series, *(jnp.asarray(d, jnp.float32) for d in (incoming, outgoing)))
    assert single.dtype == jnp.float32
    expected = np.asarray(evaluate(series, incoming, outgoing))
    np.testing.assert_allclose(single, expected, atol=2e-4 * abs(expected).max())
    # Derivatives exist at the normal too.
    pole, series = jnp.array([0, 0, 1.0]), random_series(4)
    check_grads(
        lambda *d: evaluate(series, *d),
        (pole, jnp.array([0.6, 0, 0.8])),
        1,
        modes=["rev"],
        rtol=1e-4,
    )


def test_a_series_is_recovered_from_205_measurements():
    truth = random_series(channels=2)
    incoming, outgoing = random_pairs(COUNT)
    values = np.asarray(evaluate(truth, incoming, outgoing)) + 40.0
    shifted = truth.coefficients + np.where(np.arange(55) == 0, 40 * 2 * np.pi, 0)[:, None]
    fit = fit_zernike(incoming, outgoing, values)
    np.testing.assert_allclose(fit.brdf.coefficients, shifted, atol=1e-7)
    assert fit.relative_rms.max() < 1e-9
    np.testing.assert_array_equal(fit.smoothing, 0)
    np.testing.assert_array_equal(fit.used, 205)


@pytest.mark.parametrize("smoothing", [0.0, 1e-6])
def test_the_error_left_out_is_that_of_fits_that_leave_out(smoothing):
    incoming, outgoing = random_pairs(60)
    model = OrenNayar(np.array([0.3]), 0.6)
    values = np.asarray(evaluate(model, incoming, outgoing))
    found = fit_zernike(incoming, outgoing, values, 4, [smoothing])
    errors = []
    for j in range(60):
        kept = np.arange(60) != j
        # The smoothing counts measurements: 60 of them, not 59.
        least = [smoothing * 60 / 59]
        part = fit_zernike(incoming[kept], outgoing[kept], values[kept], 4, least).brdf
        errors.append(np.asarray(evaluate(part, incoming[j], outgoing[j])) - values[j])
    expected = np.linalg.norm(errors) / np.linalg.norm(values)
    assert found.relative_rms[0] == pytest.approx(expected, rel=1e-6)


def test_noise_is_stated():
    incoming, outgoing = random_pairs(COUNT)
    rng = np.random.default_rng(5)
    values = 1 + 0.05 * rng.normal(size=(COUNT, 2))
    fit = fit_zernike(incoming, outgoing, values)
    # A standard deviation of .05, known to 1 / sqrt(2 * 205) of itself, plus the fit's own share.
    assert np.all(np.abs(fit.relative_rms / 0.05 - 1) < 0.2)
    held = random_pairs(COUNT, seed=9, least=0.2)
    assert np.abs(np.asarray(evaluate(fit.brdf, *held)) - 1).max() < 0.1
    assert np.all(fit.smoothing > 0)


def test_few_measurements_are_fitted_with_smoothing():
    incoming, outgoing = random_pairs(30)
    values = np.asarray(Lambertian(np.array([0.2])).evaluate(incoming, outgoing))
    fit = fit_zernike(incoming, outgoing, values)
    held = random_pairs(COUNT, seed=1)
    np.testing.assert_allclose(evaluate(fit.brdf, *held), 0.2, rtol=1e-6)
    with pytest.raises(ValueError, match="30 measurements do not determine 55 functions: measure"):
        fit_zernike(incoming, outgoing, values, 8, [0.0])


def test_masks():
    incoming, outgoing = random_pairs(100)
    values = np.full((100, 2), 0.3)
    values[:7, 0], values[3, 1] = -1, np.nan
    fit = fit_zernike(incoming, outgoing, values, 3)
    np.testing.assert_array_equal(fit.masked, [7, 1])
    np.testing.assert_array_equal(fit.used, [93, 99])
    np.testing.assert_allclose(evaluate(fit.brdf, incoming, outgoing), 0.3, rtol=1e-6)


def test_misuse():
    incoming, outgoing = random_pairs(80)
    values = np.ones((80, 1))
    with pytest.raises(ValueError, match=r"outgoing\[0\] is .*: give unit vectors above"):
        fit_zernike(incoming, -outgoing, values)
    with pytest.raises(ValueError, match="order=17: choose 0 to 16"):
        fit_zernike(incoming, outgoing, values, 17)
    with pytest.raises(ValueError, match=r"smoothings=\(-1\.0,\): give numbers from 0 on"):
        fit_zernike(incoming, outgoing, values, 2, [-1.0])
    with pytest.raises(ValueError, match="channel 0 has no value that is finite"):
        fit_zernike(incoming, outgoing, -values)
    with pytest.raises(ValueError, match="54 coefficients; order 8 has 55"):
        ZernikeBRDF(np.ones((54, 1)), 8)


def test_a_fit_is_differentiable_in_its_coefficients():
    incoming, outgoing = random_pairs(3)
    grad = jax.grad(lambda c: ZernikeBRDF(c, 2).evaluate(incoming, outgoing).sum())(
        jnp.ones((5, 1))
    )
    assert np.isfinite(grad).all()
    assert np.abs(grad).min() > 0
