"""Standard and non-standard decompositions over one to four axes, fast and dense.

Pinned down: PyWavelets' fswavedecn and wavedecn (periodization), all levels and some, on long and
short axes, of equal and unequal sizes, with channels; the dense twins; reconstruction; Parseval for
orthonormal wavelets and no others; a constant is one coefficient, the root (ERRATA 59); details
of polynomials vanish away from the seam; places in Mallat's order (ERRATA 56, 58); gradients and
jit; float32; the remedies of what is refused.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import pywt

from jaxrender.wavelets import (
    WAVELETS,
    analyse_nonstandard,
    analyse_nonstandard_dense,
    analyse_standard,
    analyse_standard_dense,
    analyse_step,
    daubechies,
    synthesise_nonstandard,
    synthesise_nonstandard_dense,
    synthesise_standard,
    synthesise_standard_dense,
    synthesise_step,
    wavelet_named,
)
from jaxrender.wavelets.layout import check_signal

PYWAVELETS = {
    "haar": "haar",
    "cdf-2-2": "bior2.2",
    "daubechies-2": "db2",
    "daubechies-4": "db4",
}
PEER = 1e-12
ROUND_TRIP = 1e-13
ROUND_TRIP_FLOAT32 = 2e-6

# One to four axes; by products alone, by passes alone, and some of each; axes of one sample.
SHAPES = [(256, 2), (32, 128, 1), (2, 32, 16, 3), (16, 16, 16, 16, 3), (8, 1, 1)]
FAST = {
    "standard": (analyse_standard, synthesise_standard),
    "nonstandard": (analyse_nonstandard, synthesise_nonstandard),
}
DENSE = {
    "standard": (analyse_standard_dense, synthesise_standard_dense),
    "nonstandard": (analyse_nonstandard_dense, synthesise_nonstandard_dense),
}


def samples(shape) -> np.ndarray:
    return np.random.default_rng(sum(shape)).normal(size=shape)


def by_pywavelets(kind: str, name: str, values: np.ndarray, levels: int) -> np.ndarray:
    axes = range(values.ndim - 1)
    common = {"wavelet": PYWAVELETS[name], "mode": "periodization", "axes": axes}
    if kind == "standard":
        return pywt.fswavedecn(values, levels=levels, **common).coeffs
    return pywt.coeffs_to_array(pywt.wavedecn(values, level=levels, **common), axes=axes)[0]


def fewest_levels(shape) -> int:
    return min(shape[:-1]).bit_length() - 1


# PyWavelets warns that filters are longer than the coarsest levels.
@pytest.mark.filterwarnings("ignore:Level value:UserWarning")
@pytest.mark.parametrize("name", PYWAVELETS)
@pytest.mark.parametrize("shape", SHAPES[:-1], ids=str)
@pytest.mark.parametrize("kind", FAST)
def test_like_pywavelets_and_back(kind, shape, name):
    wavelet, values = wavelet_named(name), samples(shape)
    analyse, synthesise = FAST[kind]
    levels = fewest_levels(shape)
    coefficients = analyse(wavelet, values, levels)
    expected = by_pywavelets(kind, name, values, levels)
    np.testing.assert_allclose(coefficients, expected, atol=PEER, rtol=0)
    back = synthesise(wavelet, coefficients, levels)
    np.testing.assert_allclose(back, values, atol=ROUND_TRIP * np.abs(values).max(), rtol=0)


@pytest.mark.parametrize("name", ["haar", "daubechies-4"])
@pytest.mark.parametrize("kind", FAST)
def test_some_levels(kind, name):
    wavelet, values = wavelet_named(name), samples((32, 128, 1))
    coefficients = FAST[kind][0](wavelet, values, 2)
    expected = by_pywavelets(kind, name, values, 2)
    np.testing.assert_allclose(coefficients, expected, atol=PEER, rtol=0)
    np.testing.assert_allclose(FAST[kind][1](wavelet, coefficients, 2), values, atol=PEER, rtol=0)
    np.testing.assert_array_equal(FAST[kind][0](wavelet, values, 0), values)


@pytest.mark.parametrize("name", ["haar", "cdf-2-2", "daubechies-4"])
@pytest.mark.parametrize("shape", [(32, 128, 1), (2, 32, 16, 3), (8, 1, 1)], ids=str)
@pytest.mark.parametrize("kind", FAST)
def test_fast_equals_dense(kind, shape, name):
    wavelet, values = wavelet_named(name), samples(shape)
    for fast, dense in zip(FAST[kind], DENSE[kind], strict=True):
        np.testing.assert_allclose(fast(wavelet, values), dense(wavelet, values), atol=PEER, rtol=0)


@pytest.mark.parametrize("name", PYWAVELETS)
@pytest.mark.parametrize("kind", FAST)
def test_parseval_for_orthonormal_wavelets_alone(kind, name):
    wavelet, values = wavelet_named(name), samples((2, 32, 16, 3))
    ratio = np.sum(np.square(FAST[kind][0](wavelet, values))) / np.sum(values**2)
    assert (abs(ratio - 1.0) < ROUND_TRIP) == wavelet.orthonormal


@pytest.mark.parametrize("name", PYWAVELETS)
@pytest.mark.parametrize("kind", FAST)
def test_a_constant_is_the_root_coefficient(kind, name):
    values = np.full((8, 8, 8, 8, 2), 3.0)
    coefficients = np.array(FAST[kind][0](wavelet_named(name), values))
    # Every axis of n samples gives the root sqrt(n) times the mean.
    np.testing.assert_allclose(coefficients[0, 0, 0, 0], 3.0 * 64.0, rtol=PEER)
    coefficients[0, 0, 0, 0] = 0.0
    np.testing.assert_allclose(coefficients, 0.0, atol=PEER)


@pytest.mark.parametrize("name", PYWAVELETS)
def test_details_of_polynomials_vanish_away_from_the_seam(name):
    wavelet, places = wavelet_named(name), np.linspace(-1.0, 1.0, 128)[:, None]
    inside = slice(64 + 8, 128 - 8)
    for degree in range(wavelet.vanishing_moments + 1):
        details = np.abs(analyse_step(wavelet, places**degree, 0)[inside]).max()
        assert (details < PEER) == (degree < wavelet.vanishing_moments)


def test_wavelets_stand_at_two_to_the_level_plus_place():
    wavelet, size = wavelet_named("haar"), 16
    for level in range(4):
        for place in range(2**level):
            one = np.zeros((size, 1))
            one[2**level + place] = 1.0
            width = size >> level
            expected = np.zeros((size, 1))
            expected[place * width : place * width + width // 2] = width**-0.5
            expected[place * width + width // 2 : (place + 1) * width] = -(width**-0.5)
            np.testing.assert_allclose(
                synthesise_standard(wavelet, one), expected, atol=ROUND_TRIP, rtol=0
            )


@pytest.mark.parametrize("name", ["haar", "cdf-2-2"])
@pytest.mark.parametrize("axis", [0, 1])
def test_steps(name, axis):
    wavelet, values = wavelet_named(name), samples((4, 128, 2))
    low, high = pywt.dwt(values, PYWAVELETS[name], "periodization", axis=axis)
    step = analyse_step(wavelet, values, axis)
    np.testing.assert_allclose(step, np.concatenate([low, high], axis), atol=PEER, rtol=0)
    np.testing.assert_allclose(synthesise_step(wavelet, step, axis), values, atol=PEER, rtol=0)


@pytest.mark.parametrize("name", ["haar", "cdf-2-2", "daubechies-4"])
@pytest.mark.parametrize("kind", FAST)
def test_gradients_and_jit(kind, name):
    wavelet, values = wavelet_named(name), jnp.asarray(samples((2, 128, 2)))
    weights = jnp.asarray(samples((2, 128, 2)) + 1.0)
    analyse, synthesise = FAST[kind]

    def loss(signal):
        coefficients = analyse(wavelet, signal)
        return jnp.sum(jnp.sin(synthesise(wavelet, weights * coefficients)))

    direction = jnp.asarray(np.random.default_rng(7).normal(size=values.shape))
    step = 1e-6
    difference = (loss(values + step * direction) - loss(values - step * direction)) / (2 * step)
    slope = jnp.sum(jax.grad(loss)(values) * direction)
    np.testing.assert_allclose(slope, difference, rtol=1e-6)
    np.testing.assert_allclose(jax.jit(loss)(values), loss(values), rtol=PEER)


@pytest.mark.parametrize("name", PYWAVELETS)
@pytest.mark.parametrize("kind", FAST)
def test_float32(kind, name):
    wavelet, values = wavelet_named(name), samples((2, 32, 16, 3)).astype(np.float32)
    analyse, synthesise = FAST[kind]
    coefficients = analyse(wavelet, values)
    back = synthesise(wavelet, coefficients)
    assert coefficients.dtype == back.dtype == jnp.float32
    assert np.abs(np.asarray(back) - values).max() < ROUND_TRIP_FLOAT32 * np.abs(values).max()


def test_the_input_is_left_alone():
    wavelet, values = WAVELETS["haar"], jnp.asarray(samples((32, 128, 1)))
    before = np.array(values)
    synthesise_nonstandard(wavelet, values)
    analyse_nonstandard(wavelet, values)
    np.testing.assert_array_equal(values, before)


def test_filters_longer_than_any_axis_go_around_it_more_than_once():
    wavelet, values = daubechies(10), samples((4, 8, 1))
    back = synthesise_nonstandard(wavelet, analyse_nonstandard(wavelet, values))
    np.testing.assert_allclose(back, values, atol=1e-9, rtol=0)


REFUSED = [
    (lambda w: analyse_standard(w, np.zeros((4, 33, 1))), r"axis 1 has 33 .* resample to 32"),
    (lambda w: analyse_nonstandard(w, np.zeros((0, 4, 1))), r"axis 0 has 0 samples"),
    (lambda w: check_signal(np.zeros((8, 1), int)), r"type int64; convert them to float32"),
    (lambda w: synthesise_standard(w, np.zeros(8)), r"give the channels an axis of their own"),
    (lambda w: synthesise_nonstandard(w, np.zeros((8, 4, 1)), 3), r"3 levels .* ask for 0 to 2"),
    (lambda w: analyse_standard(w, np.zeros((8, 4, 1)), -1), r"-1 levels .* ask for 0 to 2"),
    (lambda w: analyse_nonstandard_dense(w, np.zeros((8, 24, 1))), r"no power of two"),
    (lambda w: analyse_step(w, np.zeros((8, 3)), 1), r"axis 1; choose one of 0 to 0"),
    (lambda w: synthesise_step(w, np.zeros((8, 3)), -1), r"axis -1; choose one of 0 to 0"),
    (lambda w: analyse_step(w, np.zeros((8, 1, 3)), 1), r"one sample, which cannot be halved"),
]


@pytest.mark.parametrize(("call", "message"), REFUSED, ids=[words for _, words in REFUSED])
def test_misuse_is_refused_with_the_remedy(call, message):
    with pytest.raises(ValueError, match=message):
        call(wavelet_named("haar"))
