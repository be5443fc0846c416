"""Ringing of spectra about the reflected ray, and the windows that take it off.

Pinned down: the lowest value is that of the sum over harmonics at any pair of directions; a lobe of
one angle rings as its transfer does; the window by weights multiplies each (l, p); the one that
bends least keeps its bound, is no stronger than it must be nor than halves the last degrees, and
leaves alone what does not ring.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.harmonics import (
    TOLERABLE_RINGING,
    halving_strength,
    hann,
    lanczos,
    minimal,
    real_basis,
    ringing,
)
from jaxrender.spectra import (
    CentralSpectrum,
    FacetLobe,
    central_spectrum,
    lobe_ringing,
    windowed_spectrum,
)

# The lowest value is looked for on a grid.
FOUND = 2e-2


@pytest.fixture(scope="module")
def facets():
    lobe = FacetLobe(jnp.asarray(0.3))
    return central_spectrum(lobe, (9, 3), *lobe.extent, weighted=True)


def radial(transfer):
    """A lobe about R that is the same for every viewer."""
    rho = transfer * np.sqrt(2 * np.arange(len(transfer)) + 1)
    return CentralSpectrum(rho[:, None, None, None], np.ones(1))


def random_directions(count, seed):
    found = np.random.default_rng(seed).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def test_it_is_the_lowest_of_the_sum_over_harmonics(facets):
    first, second = facets.band_limits
    light, viewer = random_directions(2000, 0), random_directions(1000, 1)
    by_light, by_viewer = (
        np.asarray(real_basis(d, n)) for d, n in ((light, first), (viewer, second))
    )
    matrix = np.zeros((by_light.shape[1], by_viewer.shape[1]))
    rho = np.asarray(facets.coefficients)[..., 0]
    for degree in range(first + 1):
        for p in range(second + 1):
            for q in range(-min(degree, p), min(degree, p) + 1):
                matrix[degree * (degree + 1) + q, p * (p + 1) + q] = rho[degree, p, abs(q)]
    values = by_light @ matrix @ by_viewer.T
    found = lobe_ringing(facets)
    assert found < -0.05
    assert values.min() / values.max() == pytest.approx(found, rel=5 * FOUND)
    assert values.min() >= (1 + FOUND) * found * values.max()


def test_a_lobe_of_one_angle_rings_as_its_transfer():
    transfer = np.exp(-((0.1 * np.arange(10)) ** 2))
    assert lobe_ringing(radial(transfer)) == pytest.approx(ringing(transfer), rel=FOUND)


def test_the_channel_that_rings_most_counts():
    both = np.concatenate([radial(hann(8)).coefficients, radial(np.ones(9)).coefficients], axis=-1)
    assert lobe_ringing(CentralSpectrum(both, np.ones(2))) == lobe_ringing(radial(np.ones(9)))


@pytest.mark.parametrize(("name", "window"), [("hann", hann), ("lanczos", lanczos)])
def test_both_degrees_are_weighed(facets, name, window):
    found = windowed_spectrum(facets, name)
    weights = window(9)[:, None, None, None] * window(3)[None, :, None, None]
    np.testing.assert_allclose(found.coefficients, weights * facets.coefficients, rtol=1e-14)
    np.testing.assert_array_equal(found.energy, facets.energy)
    assert found.weighted
    assert lobe_ringing(found) > 0.5 * lobe_ringing(facets)


def test_minimal_is_no_stronger_than_it_must_be(facets):
    found = windowed_spectrum(facets, "minimal", -0.05)
    assert lobe_ringing(facets) < -0.06
    assert -0.05 <= lobe_ringing(found) < -0.0495
    # Degree 0 is kept; a share of the halving strength weighs the last of either degree.
    share = np.asarray(facets.coefficients / np.asarray(found.coefficients))[9, 0, 0, 0] - 1
    expected = minimal(9, share * halving_strength(9))[:, None, None, None]
    expected = expected * minimal(3, share * halving_strength(3))[None, :, None, None]
    np.testing.assert_allclose(found.coefficients, expected * facets.coefficients, atol=1e-12)


def test_minimal_is_no_stronger_than_halving():
    point = radial(np.ones(9))
    found = windowed_spectrum(point, "minimal")
    assert lobe_ringing(found) < TOLERABLE_RINGING
    assert found.coefficients[-1, 0, 0, 0] == pytest.approx(0.5 * point.coefficients[-1, 0, 0, 0])


def test_minimal_leaves_alone_what_does_not_ring():
    wide = radial(np.exp(-((0.3 * np.arange(12)) ** 2)))
    assert windowed_spectrum(wide, "minimal") is wide


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: windowed_spectrum(radial(np.ones(3)), "box"), "no window is named 'box'"),
        (lambda: windowed_spectrum(radial(np.ones(3)), "minimal", 0.5), "lowest=0.5"),
        (lambda: radial(np.ones(3)).windowed(np.ones(2), np.ones(1)), r"\(1, 0\) of a spectrum"),
        (lambda: lobe_ringing(radial(np.zeros(3))), "highest value is 0"),
    ],
)
def test_refusals(call, said):
    with pytest.raises(ValueError, match=said):
        call()
