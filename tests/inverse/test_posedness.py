"""Which degrees can be recovered.

- The relative errors stated are those of least squares on noisy coefficients, many times over.
- Lambert's odd degrees above one are lost whatever the light; light of one degree tells the BRDF of
  that degree alone.
- More samples and less noise help as they should; nonsense is refused.
"""

import numpy as np
import pytest

from jaxrender.inverse.posedness import posedness
from jaxrender.spectra import lambertian_transfer


def flat_light(band_limit=6, channels=3, seed=0):
    return np.random.default_rng(seed).normal(size=((band_limit + 1) ** 2, channels))


def test_errors_are_those_of_repeated_measurement():
    """Samples of the reflected light itself, with white noise, analysed by their plain means."""
    from jaxrender.harmonics import real_basis

    rng = np.random.default_rng(1)
    light, transfer = flat_light(3, 1), np.array([1.0, 0.8, 0.5, 0.1])
    by_degree = np.repeat(transfer, [1, 3, 5, 7])
    normals = rng.normal(size=(20_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    basis = np.asarray(real_basis(normals, 3))
    clean = basis @ (by_degree[:, None] * light)
    noise = 0.05
    stated = posedness(light, transfer, noise, len(normals))
    deviation = noise * np.sqrt(np.mean(clean**2))
    solve = np.linalg.pinv(basis)
    errors = [solve @ rng.normal(size=clean.shape) * deviation for _ in range(60)]
    of_degree_2 = np.stack(errors)[:, 4:9, 0]
    # Light: the error's root mean square length over the light's.
    light_error = np.sqrt(np.mean(np.sum(of_degree_2**2, 1))) / np.linalg.norm(0.5 * light[4:9, 0])
    assert stated.light_error[2] == pytest.approx(light_error, rel=0.12)
    # BRDF: the projection on the known light.
    known = 0.5 * light[4:9, 0]
    brdf_error = np.std(of_degree_2 @ known) / np.sum(known**2)
    assert stated.brdf_error[2] == pytest.approx(brdf_error, rel=0.3)


def test_lambert_hides_odd_degrees():
    found = posedness(flat_light(), lambertian_transfer(6))
    assert found.light_recoverable.tolist() == [True, True, True, False, True, False, True]
    assert np.isinf(found.light_error[3])
    assert np.isinf(found.brdf_error[5])


def test_light_of_one_degree_tells_one_number():
    light = np.zeros((25, 3))
    light[4:9] = 1
    found = posedness(light, np.ones(5))
    assert found.brdf_recoverable.tolist() == [False, False, True, False, False]


def test_errors_fall_with_noise_and_samples():
    light, transfer = flat_light(), np.exp(-np.arange(7.0))
    base = posedness(light, transfer, 0.01, 1000)
    np.testing.assert_allclose(
        posedness(light, transfer, 0.02, 1000).light_error, 2 * base.light_error
    )
    np.testing.assert_allclose(
        posedness(light, transfer, 0.01, 4000).brdf_error, base.brdf_error / 2
    )


def test_nonsense_is_refused():
    with pytest.raises(ValueError, match="known to degree 6, the lobe to 3"):
        posedness(flat_light(), np.ones(4))
    with pytest.raises(ValueError, match="noise=0"):
        posedness(flat_light(), np.ones(7), 0.0)
    with pytest.raises(ValueError, match="the light is zero"):
        posedness(np.zeros((4, 1)), np.ones(2))
