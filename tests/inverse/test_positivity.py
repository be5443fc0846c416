"""Pinned down: light that is not negative.

- The hard constraint finds the minimum that Lawson and Hanson's least-distance programming finds.
- The soft penalty is the minimum of T 6.24, as a general minimiser finds it.
- Light that is positive anyway stays as it is.
- In ``recover_coefficients`` a dark room under a source stays dark.
"""

import numpy as np
import pytest
from lighting_problems import phong_operator, samples_all_round
from scipy.optimize import minimize, nnls

from jaxrender.harmonics import LatLongGrid, degrees, real_basis
from jaxrender.inverse.lighting.coefficients import LightSettings, recover_coefficients
from jaxrender.inverse.lighting.positivity import (
    CoefficientMisfit,
    hard_positive,
    negative_energy,
    soft_positive,
)
from jaxrender.lighting import DirectionalSources
from jaxrender.spectra import light_coefficients

# What the iterations leave of the constraint.
NEGLIGIBLE = 1e-6


def problem(degree=3, brightness=0.0, seed=0):
    """Random normal equations whose light is negative at about half of the nodes."""
    rng = np.random.default_rng(seed)
    grid = LatLongGrid(8, 16)
    basis = np.asarray(real_basis(grid.directions().reshape(-1, 3), degree))
    matrix = rng.normal(size=(60, basis.shape[1]))
    right = matrix @ rng.normal(size=basis.shape[1]) + 0.5 * rng.normal(size=60)
    right += brightness * matrix[:, 0]
    return CoefficientMisfit(
        gram=matrix.T @ matrix,
        moment=matrix.T @ right,
        energy=float(right @ right),
        measured=60.0,
        basis=basis,
        weights=grid.weights().ravel(),
    )


def least_distance(misfit):
    """Minimise |R x - c| with Y x >= 0 by nnls (Lawson and Hanson, chapter 23)."""
    factor = np.linalg.cholesky(misfit.gram).T
    centre = np.linalg.solve(factor.T, misfit.moment)
    rows = misfit.basis @ np.linalg.inv(factor)
    bound = -rows @ centre
    stacked = np.concatenate([rows.T, bound[None]])
    target = np.append(np.zeros(len(centre)), 1.0)
    dual, _ = nnls(stacked, target)
    left = stacked @ dual - target
    return np.linalg.solve(factor, centre - left[:-1] / left[-1])


@pytest.mark.parametrize("seed", range(4))
def test_the_hard_constraint(seed):
    misfit = problem(seed=seed)
    assert negative_energy(misfit, misfit.unregularised()) > 0.1
    found = hard_positive(misfit)
    expected = least_distance(misfit)
    assert found.converged
    assert (misfit.basis @ found.light).min() > -NEGLIGIBLE * np.abs(misfit.basis @ expected).max()
    np.testing.assert_allclose(found.light, expected, atol=1e-4 * np.abs(expected).max())
    assert misfit.squares(found.light) == pytest.approx(misfit.squares(expected), rel=1e-5)


@pytest.mark.parametrize("strength", [0.3, 1.0])
def test_the_soft_penalty(strength):
    misfit = problem()
    start = misfit.unregularised()
    factor = strength * misfit.rms(start) / negative_energy(misfit, start)

    def penalised(light):
        return misfit.rms(light) + factor * negative_energy(misfit, light)

    found = soft_positive(misfit, strength)
    expected = minimize(penalised, start, method="BFGS", options={"gtol": 1e-9})
    assert found.converged
    assert penalised(found.light) <= expected.fun * (1 + 1e-9)
    np.testing.assert_allclose(found.light, expected.x, atol=1e-4 * np.abs(expected.x).max())
    assert penalised(found.light) < penalised(start)


def test_positive_light_stays_as_it_is():
    misfit = problem(brightness=100.0)
    light = misfit.unregularised()
    assert np.array_equal(soft_positive(misfit).light, light)
    np.testing.assert_allclose(hard_positive(misfit).light, light, rtol=1e-12)


def test_a_dark_room_under_a_source():
    """Light cut at degree 6 rings about a source; the constraint takes the ringing away."""
    samples = samples_all_round(800)
    source = DirectionalSources(np.array([[0.6, 0.0, 0.8]]), np.ones((1, 1)))
    truth = np.asarray(light_coefficients(source, 12))
    # The lobe of the source's own width, so that the light filtered by it is nowhere negative.
    degree = degrees(12)[:, None]
    truth = truth * np.exp(-(0.35**2) * degree * (degree + 1))
    exact = np.asarray(phong_operator(samples, 12, [0.1], [0.4]).apply(truth))
    noise = 0.05 * exact.max()
    measured = exact + noise * np.random.default_rng(0).normal(size=exact.shape)
    weights = np.full(exact.shape, 1 / noise)
    operator = phong_operator(samples, 6, [0.1], [0.4])
    images, errors = {}, {}
    weight = LatLongGrid(14, 28).weights()[..., None]
    for positivity in ("none", "soft", "hard"):
        found = recover_coefficients(
            operator, measured, weights, LightSettings(6, positivity=positivity)
        )
        images[positivity] = found.image(14)
        errors[positivity] = np.linalg.norm(found.coefficients - truth[:49])
    below = {name: np.sum(weight * np.minimum(image, 0) ** 2) for name, image in images.items()}
    assert below["hard"] < 1e-9 * below["none"]
    assert below["soft"] < 0.5 * below["none"]
    assert errors["hard"] < errors["none"]
    assert errors["soft"] < errors["none"]
