"""Problems that the tests of the forward model share: samples, lights and T 6.2 in plain NumPy."""

import math

import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import LatLongGrid
from jaxrender.lighting import Environment


def unit_vectors(count, seed):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def random_samples(count, lowest_cosine=0.15, seed=0):
    """Samples with random normals, and exit cosines uniform above the lowest."""
    normals, others = unit_vectors(count, seed), unit_vectors(count, seed + 1)
    tangents = np.cross(normals, others)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    cosine = np.random.default_rng(seed + 2).uniform(lowest_cosine, 1, (count, 1))
    return SurfaceSamples(normals, normals * cosine + tangents * np.sqrt(1 - cosine**2))


def microfacet(sigma, mu=1.5, fresnel="exit", masking="none", channels=3):
    return Microfacet(np.ones(channels), np.ones(channels), sigma, mu, fresnel, masking)


def fresnel_ratio(mu, cosine):
    refracted = math.sqrt(1 - (1 - min(cosine, 1.0) ** 2) / mu**2)
    s = (cosine - mu * refracted) / (cosine + mu * refracted)
    p = (mu * cosine - refracted) / (mu * cosine + refracted)
    return (s**2 + p**2) / 2 * ((mu + 1) / (mu - 1)) ** 2


def lobes(brdf, normal, outgoing, incoming):
    """The clamped cosine and F S / (4 cos t_o) of T 6.2, from dot and cross products."""
    cos_i, cos_o = float(normal @ incoming), float(normal @ outgoing)
    if cos_i <= 0:
        return 0.0, 0.0
    sigma, mu = float(brdf.sigma), None if brdf.mu is None else float(brdf.mu)
    half = incoming + outgoing
    angle = math.atan2(np.linalg.norm(np.cross(normal, half)), normal @ half)
    between = float(outgoing @ half) / np.linalg.norm(half)
    ratio = 1.0
    if mu is not None:
        ratio = fresnel_ratio(mu, cos_o if brdf.fresnel == "exit" else between)
    lobe = math.exp(-((angle / sigma) ** 2)) / (math.pi * sigma**2)
    return cos_i, ratio * lobe / (4 * cos_o)


def smooth_coefficients(seed=0, channels=3):
    """Positive light of degree 3."""
    coefficients = 0.3 * np.random.default_rng(seed).normal(size=(16, channels))
    coefficients[0] = 4
    return coefficients


# Discs as (direction, radius in radians, irradiance): two wider than a texel of 64 rows, one broad.
DISCS = (((0.3, 0.2, 0.9), 0.07, 2.0), ((-0.8, 0.1, 0.4), 0.09, 3.0), ((0.1, -0.9, -0.3), 0.3, 2.0))


def lit_room(rows, finest=512, discs=DISCS, ambient=1.0):
    """The same light at any resolution: discs over a slow ambient, averaged over each texel."""
    grid = LatLongGrid(finest, 2 * finest)
    directions = grid.directions()
    light = ambient * (1 + 0.5 * directions[..., 2])
    for direction, radius, irradiance in discs:
        towards = np.array(direction) / np.linalg.norm(direction)
        lobe = np.exp((directions @ towards - 1) / radius**2) / (2 * np.pi * radius**2)
        light = light + irradiance * lobe
    over = finest // rows
    sines = np.broadcast_to(np.sin(grid.polar_angles())[:, None], light.shape)

    def texels(values):
        return values.reshape(rows, over, 2 * rows, over).sum((1, 3))

    return Environment((texels(sines * light) / texels(sines))[..., None] * [1.0, 0.8, 0.6])
