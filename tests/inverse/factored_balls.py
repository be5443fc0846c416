"""The ball of ``ball_problems``: noise, light and material found together, and their errors."""

import numpy as np
from ball_problems import BRDF, CLEAN

from jaxrender.geometry import Sphere
from jaxrender.inverse.factorization import FactorSettings, factorize

SETTINGS = FactorSettings(band_limit=6, most_sources=4)


def noisy(photographs):
    """Add 1 % noise to what the cameras see."""
    rng = np.random.default_rng(1)
    return CLEAN._replace(radiance=photographs * (1 + 0.01 * rng.normal(size=photographs.shape)))


def factored(photographs, **settings):
    """Find light and material from photographs with noise."""
    pool = noisy(photographs)
    chosen = SETTINGS._replace(**settings)
    return factorize(pool, BRDF, chosen, gauge="dielectric", shape=Sphere(), pool=pool)


def off(found):
    """Errors of the material in standard errors, at the worst."""
    level = np.mean(BRDF.kd + BRDF.ks)
    true = {"kd": BRDF.kd / level, "ks": BRDF.ks / level, "sigma": BRDF.sigma, "mu": BRDF.mu}
    value, error = found.parameters.value, found.parameters.standard_error
    return max(float(np.max(np.abs(value.of(n) - t) / error.of(n))) for n, t in true.items())
