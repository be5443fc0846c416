"""Photographs of a made-up scene at several exposures, as a noisy sensor of 8 bits takes them."""

import numpy as np
from scipy import ndimage

from jaxrender.imaging import SRGB, Bracket

# Forty thousand electrons at full scale and a floor of a two-thousandth: a larger camera.
PHOTON, READ = 2.5e-5, 5e-4


def scene(seed=0, shape=(90, 120)):
    """Smooth radiance over about five orders of magnitude, a little coloured."""
    rng = np.random.default_rng(seed)
    smooth = ndimage.gaussian_filter(rng.normal(size=shape), 4)
    return np.exp(2.2 * smooth / smooth.std())[..., None] * np.array([1.0, 0.8, 0.6])


def stored(radiance, exposure, rng, response=None, bits=8):
    """Expose, add photon and read noise, encode, clip and round."""
    linear = exposure * radiance
    linear = linear + np.sqrt(PHOTON * linear + READ**2) * rng.normal(size=linear.shape)
    values = np.clip((response or SRGB()).encode(np.clip(linear, 0, 1)), 0, 1)
    steps = 2**bits - 1
    return np.round(values * steps) / steps


def bracketed(radiance, exposures, seed=1, response=None):
    """Photograph at each exposure; the exposures stated are the true ones."""
    rng = np.random.default_rng(seed)
    return [Bracket(stored(radiance, t, rng, response), float(t)) for t in exposures]
