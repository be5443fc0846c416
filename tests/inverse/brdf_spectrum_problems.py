"""Problems that the tests of BRDF spectra share: random light, coefficients and samples."""

import numpy as np
from inverse_problems import unit

from jaxrender.geometry import SurfaceSamples, angles_from_direction, rotation
from jaxrender.harmonics import coefficient_count, complex_from_real
from jaxrender.inverse.brdf_spectrum.basis import SpectrumBasis
from jaxrender.reflection import SurfacePoints, convolve_isotropic, evaluate_isotropic

LIMIT, CHANNELS = 3, 2
FORMS = [SpectrumBasis(LIMIT), SpectrumBasis(LIMIT, reciprocal=True)]


def some_light(limit=LIMIT, channels=CHANNELS, seed=0):
    light = np.random.default_rng(seed).normal(size=(coefficient_count(limit), channels))
    light[0] += 6
    return light


def some_values(basis, channels=CHANNELS, seed=1):
    values = np.random.default_rng(seed).normal(size=(basis.count, channels))
    values[0] = 3
    return values


def some_samples(count=2000, seed=2, lowest=0.1):
    """Normals anywhere, views uniform in the exit cosine; and the same as points of T 2.10."""
    rng = np.random.default_rng(seed)
    normals = unit(rng.normal(size=(count, 3)))
    alpha, beta = (np.asarray(angle) for angle in angles_from_direction(normals))
    cosine, azimuth = rng.uniform(lowest, 1, count), rng.uniform(0, 2 * np.pi, count)
    sine = np.sqrt(1 - cosine**2)
    local = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)
    frames = np.asarray(rotation(alpha, beta, np.zeros(count)))
    outgoing = np.einsum("sij,sj->si", frames, local)
    return SurfaceSamples(normals, outgoing), SurfacePoints(alpha, beta, np.zeros(count), local)


def convolved(basis, values, light, points):
    """The radiance by the convolution theorem, in complex harmonics (T 2.54, 2.58)."""
    field = convolve_isotropic(complex_from_real(light), basis.spread(values))
    found = np.real(np.asarray(evaluate_isotropic(field, points)))
    return found / np.asarray(points.outgoing)[:, 2:] if basis.reciprocal else found
