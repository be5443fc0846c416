"""Trees of coefficients for the tests of what is shaded from them, and how exact it is."""

import numpy as np

from jaxrender.wavelets.threshold import keep_fraction
from jaxrender.wavelets.transform import analyse_nonstandard
from jaxrender.wavelets.tree import CoefficientTree

EXACT = 1e-10


def tree_of(wavelet, samples, fraction=1.0):
    coefficients = keep_fraction(analyse_nonstandard(wavelet, samples), fraction).coefficients
    return CoefficientTree.of_coefficients(wavelet, np.asarray(coefficients))


def random_tree(wavelet, size, channels=2, seed=0, fraction=1.0):
    samples = np.random.default_rng(seed).normal(size=(*(size,) * 4, channels))
    return tree_of(wavelet, samples, fraction)
