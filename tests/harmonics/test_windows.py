"""Windows for lobes that are cut at a degree.

Pinned down: every window is 1 at degree 0, falls and stays positive; Hann's and Lanczos's are
SciPy's; Sloan's minimises the squared error plus the squared Laplacian; ringing is that of the
values at the derivative's roots, and a point's tends to that of 2 J1(x) / x; the strength found is
the smallest that keeps the bound, on a fine grid, and 0 where nothing rings; the window itself
rings as Kelvin's function kei does.
"""

import numpy as np
import pytest
from numpy.polynomial.legendre import legder, legroots, legval
from scipy.optimize import minimize_scalar
from scipy.signal.windows import hann as scipy_hann
from scipy.signal.windows import lanczos as scipy_lanczos
from scipy.special import j1, kei

from jaxrender.harmonics import (
    TOLERABLE_RINGING,
    WINDOWS,
    halving_strength,
    hann,
    lanczos,
    minimal,
    minimal_strength,
    ringing,
    window_named,
)

ROUNDING = 1e-14
# Between the angles of a closer look a parabola stands for the lobe.
FOUND = 1e-7
DEGREE = np.arange(31)
POINT = np.ones(31)
# A lobe of width .05, of which degree 30 still holds a tenth.
NARROW = np.exp(-((0.05 * DEGREE) ** 2))


def lobe_on_a_fine_grid(transfer):
    angles = np.linspace(0, np.pi, 20_001)
    return legval(np.cos(angles), transfer * (2 * np.arange(len(transfer)) + 1))


@pytest.mark.parametrize("name", WINDOWS)
@pytest.mark.parametrize("band_limit", [0, 1, 30])
def test_degree_nought_is_kept_and_the_rest_falls(name, band_limit):
    weights = window_named(name, np.ones(band_limit + 1))
    assert weights.shape == (band_limit + 1,)
    assert weights[0] == 1
    assert np.all(np.diff(weights) < 0)
    assert np.all(weights > 0)


@pytest.mark.parametrize(("window", "scipys"), [(hann, scipy_hann), (lanczos, scipy_lanczos)])
def test_it_is_one_side_of_scipys(window, scipys):
    np.testing.assert_allclose(window(7), scipys(2 * 8 + 1)[8:-1], atol=ROUNDING)


def test_minimal_is_the_least_of_error_and_bending():
    strength = 3e-4
    bend = np.sqrt(strength) * np.diag(np.arange(9) * np.arange(1, 10.0))
    system = np.concatenate([np.eye(9), bend])
    least = np.linalg.lstsq(system, np.concatenate([np.ones(9), np.zeros(9)]))[0]
    np.testing.assert_allclose(minimal(8, strength), least, atol=ROUNDING)


def test_the_halving_strength_halves_the_last_degree():
    assert minimal(9, halving_strength(9))[-1] == pytest.approx(0.5, rel=ROUNDING)
    np.testing.assert_array_equal(minimal(0, halving_strength(0)), 1)


@pytest.mark.parametrize("transfer", [POINT[:2], POINT[:4], POINT, NARROW, NARROW[:12]])
def test_ringing_is_that_at_the_roots_of_the_derivative(transfer):
    series = transfer * (2 * np.arange(len(transfer)) + 1)
    turning = np.real(legroots(legder(series))) if len(series) > 2 else []
    values = legval(np.concatenate([[-1, 1], turning]), series)
    assert ringing(transfer) == pytest.approx(values.min() / values.max(), abs=FOUND)


def test_a_point_rings_as_the_first_bessel_function():
    lowest = minimize_scalar(lambda x: 2 * j1(x) / x, bounds=(3, 7), method="bounded").fun
    assert ringing(np.ones(201)) == pytest.approx(lowest, rel=1e-3)


def test_the_window_of_a_point_rings_as_kei():
    """1 / (1 + k^4) is the transform of -kei, which is pi / 4 at 0: -.014 of it and no less."""
    most = -minimize_scalar(lambda x: -kei(x), bounds=(4, 6), method="bounded").fun
    assert ringing(minimal(200, 1 / 15.0**4)) == pytest.approx(-most / (np.pi / 4), rel=0.02)


@pytest.mark.parametrize("lowest", [TOLERABLE_RINGING, -0.06, 0.0])
@pytest.mark.parametrize("transfer", [POINT, NARROW[:16]], ids=["point", "lobe"])
def test_the_strength_is_the_smallest_that_keeps_the_bound(transfer, lowest):
    strength = minimal_strength(transfer, lowest)
    assert strength > 0
    band_limit = len(transfer) - 1
    values = lobe_on_a_fine_grid(transfer * minimal(band_limit, strength))
    assert values.min() >= (lowest - FOUND) * values.max()
    assert ringing(transfer * minimal(band_limit, strength)) == pytest.approx(lowest, abs=FOUND)
    for part in np.concatenate([[0.0], np.geomspace(1e-4, 0.99, 30)]):
        assert ringing(transfer * minimal(band_limit, part * strength)) < lowest


def test_what_does_not_ring_is_left_alone():
    wide = np.exp(-((0.3 * DEGREE) ** 2))
    assert ringing(wide) > TOLERABLE_RINGING
    assert minimal_strength(wide) == 0
    np.testing.assert_array_equal(window_named("minimal", wide), 1)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: hann(-1), "band_limit is -1"),
        (lambda: lanczos(-1), "band_limit is -1"),
        (lambda: minimal(3, -1.0), "strength=-1.0: give a finite number from 0"),
        (lambda: minimal(3, np.inf), "strength=inf"),
        (lambda: minimal_strength(POINT, 0.1), "lowest=0.1: give a part of the peak from -1 to 0"),
        (lambda: minimal_strength(-POINT), "its mean is not positive"),
        (lambda: minimal_strength(np.array([1.0, np.nan])), "A_1 of a lobe is nan"),
        (lambda: ringing(np.array([-1.0])), "a lobe whose highest value is -0.0796"),
        (lambda: window_named("han", POINT), "no window is named 'han'; choose one of hann, la"),
    ],
)
def test_refusals(call, said):
    with pytest.raises(ValueError, match=said):
        call()
