"""The filters of every wavelet.

Pinned down: PyWavelets' filters to rounding; the conditions of orthonormality and of
biorthogonality; vanishing moments of both high filters, and that the next moment does not vanish;
Daubechies' filters of every order; names.
"""

import numpy as np
import pytest
import pywt

from jaxrender.wavelets import WAVELETS, daubechies, wavelet_named

# PyWavelets' own tables are good to this.
TABLES = 1e-12
EXACT = 1e-14
PYWAVELETS = {
    "haar": "haar",
    "cdf-2-2": "bior2.2",
    "daubechies-2": "db2",
    "daubechies-4": "db4",
}


def test_there_is_a_peer_of_each():
    assert set(PYWAVELETS) == set(WAVELETS)


@pytest.mark.parametrize("name", PYWAVELETS)
def test_filters_are_those_of_pywavelets(name):
    ours, theirs = wavelet_named(name), pywt.Wavelet(PYWAVELETS[name])
    pairs = [
        (ours.analysis_low, theirs.dec_lo[::-1]),
        (ours.analysis_high, theirs.dec_hi[::-1]),
        (ours.synthesis_low, theirs.rec_lo),
        (ours.synthesis_high, theirs.rec_hi),
    ]
    for one, other in pairs:
        np.testing.assert_allclose(one, other, atol=EXACT, rtol=0)
    assert ours.orthonormal == theirs.orthogonal
    assert ours.vanishing_moments == theirs.vanishing_moments_psi


@pytest.mark.parametrize("wavelet", [*WAVELETS.values(), daubechies(3), daubechies(7)], ids=str)
def test_the_two_sides_are_dual(wavelet):
    analysis = np.array([wavelet.analysis_low, wavelet.analysis_high])
    synthesis = np.array([wavelet.synthesis_low, wavelet.synthesis_high])
    taps = analysis.shape[1]
    for shift in range(-taps + 2, taps, 2):
        moved = np.zeros_like(synthesis)
        for k in range(taps):
            if 0 <= k - shift < taps:
                moved[:, k] = synthesis[:, k - shift]
        np.testing.assert_allclose(
            analysis @ moved.T, np.eye(2) * (shift == 0), atol=TABLES, rtol=0
        )
    assert wavelet.orthonormal == np.array_equal(analysis, synthesis)


@pytest.mark.parametrize("wavelet", WAVELETS.values(), ids=str)
def test_moments_vanish_and_the_next_does_not(wavelet):
    place = np.arange(len(wavelet.analysis_high)) + float(wavelet.first)
    for high in (wavelet.analysis_high, wavelet.synthesis_high):
        moments = [np.sum(place**power * high) for power in range(wavelet.vanishing_moments + 1)]
        np.testing.assert_allclose(moments[:-1], 0.0, atol=TABLES)
        assert abs(moments[-1]) > 0.1


@pytest.mark.parametrize("moments", range(1, 11))
def test_daubechies_of_every_order(moments):
    ours, theirs = daubechies(moments), pywt.Wavelet(f"db{moments}")
    np.testing.assert_allclose(ours.synthesis_low, theirs.rec_lo, atol=1e-10, rtol=0)
    assert ours.vanishing_moments == moments


def test_daubechies_2_in_closed_form():
    root = np.sqrt(3.0)
    expected = np.array([1 + root, 3 + root, 3 - root, 1 - root]) / (4 * np.sqrt(2.0))
    np.testing.assert_allclose(wavelet_named("daubechies-2").synthesis_low, expected, atol=EXACT)


@pytest.mark.parametrize("moments", [0, 11])
def test_orders_out_of_range_are_refused(moments):
    with pytest.raises(ValueError, match=r"ask for 1 to 10"):
        daubechies(moments)


def test_a_wrong_name_says_which_was_meant():
    with pytest.raises(ValueError, match=r"did you mean 'haar'\?.*daubechies-4"):
        wavelet_named("harr")
    with pytest.raises(ValueError, match=r"no wavelet is named 'xyz'; choose one of haar"):
        wavelet_named("xyz")
