"""Photographs of the ball of T 6.1.1, plain and textured: one, a ring, or from all around."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scenes import photograph_function, unit

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples, fibonacci_sphere
from jaxrender.geometry.texels import texel_coordinates
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations
from jaxrender.lighting import DirectionalSources, SmoothLobes
from jaxrender.reflection import polar_columns

NOISE = NoiseModel(0.01, 0.0)
SIGMA, MU = 0.16, 1.62
MATERIAL = Microfacet(np.array([0.19, 0.11, 0.07]), np.full(3, 0.21), SIGMA, MU)
AREA = SmoothLobes(
    unit(np.array([[1.0, 0.3, 0.8], [-0.6, 0.9, 0.4], [-0.4, -1.0, 0.2]])),
    np.radians([35.0, 45.0, 60.0]),
    np.array([[2.0, 1.9, 1.7], [1.2, 1.4, 1.6], [0.5, 0.6, 0.8]]),
)
SOURCE = DirectionalSources(np.array([[0.2, -0.7, 0.6]]), np.array([[0.7, 0.65, 0.6]]))
NO_SOURCE = DirectionalSources.none()
LOWEST_COSINE = 0.2
IMAGE = (12, 24)
SITES = IMAGE[0] * IMAGE[1]
# Photographs -> pixels of each where nothing is textured.
PIXELS = {1: 1200, 12: 300, 60: 100}
COUNTS = tuple(PIXELS)


class Textured(NamedTuple):
    """Photographs of a textured ball, and the texture."""

    observations: Observations
    site: np.ndarray
    kd: np.ndarray
    ks: np.ndarray

    @property
    def seen(self) -> np.ndarray:
        """The photographs that each site is in."""
        return np.bincount(self.site, minlength=SITES)


def views(count: int) -> np.ndarray:
    """Directions towards the cameras: one or a ring at one height, or from all around."""
    if count > 12:
        return fibonacci_sphere(count)
    azimuth = 2 * np.pi * np.arange(count) / count + 0.1
    return unit(np.stack([np.cos(azimuth), np.sin(azimuth), 0.25 + 0 * azimuth], axis=-1))


def plain_samples(count: int) -> tuple[SurfaceSamples, np.ndarray]:
    """Draw pixels evenly over the disc that each photograph shows of the ball."""
    rng = np.random.default_rng(count)
    frame = np.repeat(np.arange(count), PIXELS[count])
    outgoing = views(count)[frame]
    radius = np.sqrt(rng.uniform(0, 1 - LOWEST_COSINE**2, len(frame)))[:, None]
    turn = rng.uniform(0, 2 * np.pi, len(frame))[:, None]
    right = unit(np.cross([0.1, 0.2, 1.0], outgoing))
    across = right * np.cos(turn) + np.cross(outgoing, right) * np.sin(turn)
    normals = unit(radius * across + np.sqrt(1 - radius**2) * outgoing)
    return SurfaceSamples(normals, outgoing), frame


def plain(count: int) -> Observations:
    """Photograph the untextured ball under the area light and the source."""
    samples, frame = plain_samples(count)
    exact = photograph_function(AREA.radiance, MATERIAL, samples, frame, SOURCE)
    rng = np.random.default_rng(100 + count)
    return exact._replace(radiance=NOISE.add(np.asarray(exact.radiance), rng))


def textured(count: int, glossy: bool) -> Textured:
    """Photograph the textured ball under the area light: each texel that a view sees, once."""
    coordinates = texel_coordinates(IMAGE)
    azimuth, polar = 2 * np.pi * coordinates[:, 0], np.pi * (1 - coordinates[:, 1])
    around = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1) * np.sin(polar)[:, None]
    normals = np.concatenate([around, np.cos(polar)[:, None]], axis=-1)
    frame, site = np.nonzero(views(count) @ normals.T > LOWEST_COSINE)
    samples = SurfaceSamples(normals[site], views(count)[frame])
    kd, ks = paint(coordinates, glossy)
    columns = np.asarray(_under_area(SurfaceSamples(*map(jnp.asarray, samples))))
    exact = kd[site] * columns[:, 0] + ks[site][:, None] * columns[:, 1]
    radiance = NOISE.add(exact, np.random.default_rng(200 + count))
    return Textured(Observations(samples, radiance, frame), site, kd, ks)


def paint(coordinates: np.ndarray, glossy: bool) -> tuple[np.ndarray, np.ndarray]:
    """Paint of three colours in large patches, and K_s that varies by a third about .2."""
    label = np.floor(4 * coordinates[:, 0]) + np.floor(3 * coordinates[:, 1])
    colours = np.array([[0.05, 0.1, 0.2], [0.25, 0.2, 0.1], [0.12, 0.05, 0.06]])
    spread = np.random.default_rng(0).normal(0, 0.3, len(coordinates))
    return colours[label.astype(int) % 3], (0.2 * np.exp(spread) if glossy else 0 * spread)


@eqx.filter_jit
def _under_area(samples: SurfaceSamples) -> jax.Array:
    lobe = Microfacet(np.ones(3), np.ones(3), SIGMA, MU)
    return polar_columns(lobe, samples, AREA.radiance, polar_nodes=32)
