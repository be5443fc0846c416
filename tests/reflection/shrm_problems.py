"""Light, spectra and samples of random numbers, for the tests of reflection maps."""

import numpy as np

from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import degrees
from jaxrender.spectra import CentralSpectrum


def any_spectrum(rng, band_limits) -> CentralSpectrum:
    first, second = band_limits
    most = min(band_limits)
    degree, outgoing, order = np.ogrid[: first + 1, : second + 1, : most + 1]
    rho = rng.standard_normal((first + 1, second + 1, most + 1, 3))
    rho = np.where(((order <= degree) & (order <= outgoing))[..., None], rho, 0)
    return CentralSpectrum(rho, np.ones(3))


def random_light(rng, band_limit):
    fall = 1 + degrees(band_limit)[:, None] ** 1.5
    light = rng.standard_normal(((band_limit + 1) ** 2, 3)) / fall
    light[0] = 4
    return light


def random_samples(rng, count=200, least=0.15) -> SurfaceSamples:
    normals, outgoing = rng.standard_normal((2, 8 * count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    outgoing /= np.linalg.norm(outgoing, axis=1, keepdims=True)
    facing = np.einsum("xi,xi->x", normals, outgoing) > least
    return SurfaceSamples(normals[facing][:count], outgoing[facing][:count])
