"""Random light, materials and photographs for the experiments on the fit.

Light here is a function of direction, so that the truth can be made on an image finer than the one
that the fit is given: photographs are the integral over 256 x 512 texels, the fit sees 128 x 256.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import LatLongGrid
from jaxrender.inverse import BRDFFit, Observations
from jaxrender.lighting import DirectionalSources, Environment, LightNodes
from jaxrender.reflection import integral_columns, polar_columns, radiance

FINE_ROWS = 256
VIEWS = 12


class Scene(NamedTuple):
    """Light on a fine image, and the material to be found."""

    name: str
    fine: Environment
    material: Microfacet


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def discs(rng: np.random.Generator, directions: np.ndarray) -> np.ndarray:
    """A few discs of 1 to 5 degrees in a dim room."""
    count = rng.integers(3, 8)
    light = np.full(directions.shape, 0.05)
    for centre in unit(rng.normal(size=(count, 3))):
        width, colour = np.radians(rng.uniform(1, 5)), rng.uniform(0.6, 1, 3)
        light += _lobe(directions, centre, width) * colour * rng.uniform(0.2, 1) / width**2
    return light


def soft_boxes(rng: np.random.Generator, directions: np.ndarray) -> np.ndarray:
    """Two to five rectangles of 8 to 40 degrees with soft edges."""
    light = np.full(directions.shape, 0.1)
    for centre in unit(rng.normal(size=(rng.integers(2, 6), 3))):
        across = unit(np.cross(centre, rng.normal(size=3)))
        half, edge = np.radians(rng.uniform(4, 20, 2)), np.radians(rng.uniform(0.7, 2))
        sides = (directions @ across, directions @ np.cross(centre, across))
        inside = np.prod(
            [1 / (1 + np.exp((abs(s) - np.sin(h)) / edge)) for s, h in zip(sides, half)], axis=0
        )
        inside = np.where(directions @ centre > 0, inside, 0)
        light += inside[..., None] * rng.uniform(0.7, 1, 3) * rng.uniform(2, 10)
    return light


def sky(rng: np.random.Generator, directions: np.ndarray) -> np.ndarray:
    """A sky that brightens towards the horizon, the ground below, and a hazy sun."""
    up = directions[..., 2]
    glow = np.exp(-((up / rng.uniform(0.1, 0.4)) ** 2))
    blue, white, ground = np.array([0.3, 0.5, 1.0]), np.ones(3), rng.uniform(0.05, 0.3, 3)
    above = blue * rng.uniform(0.5, 1) + glow[..., None] * white * rng.uniform(0.5, 2)
    horizon = (1 / (1 + np.exp(-up / 0.02)))[..., None]
    sun = unit(rng.normal(size=3) + np.array([0, 0, 1.5]))
    width = np.radians(rng.uniform(2, 8))
    disk = _lobe(directions, sun, width) * np.array([1, 0.9, 0.75]) * rng.uniform(0.5, 3)
    return horizon * above + (1 - horizon) * ground + disk / width**2


def broken(rng: np.random.Generator, directions: np.ndarray) -> np.ndarray:
    """Forty patches of all widths from 1 to 57 degrees, the narrow ones bright."""
    light = np.full(directions.shape, 0.1)
    for centre in unit(rng.normal(size=(40, 3))):
        width = 10 ** rng.uniform(-1.8, 0)
        amplitude = rng.lognormal(0, 1) * width**-1.3 * 0.3
        light += amplitude * rng.uniform(0.5, 1, 3) * _lobe(directions, centre, width)
    return light


def interior(rng: np.random.Generator, directions: np.ndarray) -> np.ndarray:
    """Something of everything."""
    return discs(rng, directions) / 4 + soft_boxes(rng, directions) + sky(rng, directions) / 3


PROBES: dict[str, Callable] = {
    "discs": discs,
    "soft boxes": soft_boxes,
    "sky": sky,
    "broken": broken,
    "interior": interior,
}


def probe(kind: str, seed: int, rows: int = FINE_ROWS) -> Environment:
    """Draw a probe of the named kind."""
    directions = LatLongGrid(rows, 2 * rows).directions()
    return Environment(PROBES[kind](np.random.default_rng(seed), directions))


def material(rng: np.random.Generator, sigma: float | None = None) -> Microfacet:
    """Draw a material: kd .02 to .3, ks .05 to .5, sigma .08 to .25 (in the log), mu 1.3 to 2.2."""
    kd, ks = rng.uniform(0.02, 0.3, 3), rng.uniform(0.05, 0.5)
    drawn, mu = np.exp(rng.uniform(np.log(0.08), np.log(0.25))), rng.uniform(1.3, 2.2)
    return Microfacet(kd, np.full(3, ks), float(drawn if sigma is None else sigma), float(mu))


def coarser(fine: Environment, factor: int = 2) -> Environment:
    """Average blocks of texels, every block's energy kept."""
    rows, columns = fine.grid.shape
    weights = fine.grid.weights()[..., None]
    energy = _block_sums(np.asarray(fine.radiance) * weights, factor)
    small = LatLongGrid(rows // factor, columns // factor)
    return Environment(energy / small.weights()[..., None])


def ring_samples(count: int, lowest_cosine: float, seed: int) -> tuple[SurfaceSamples, np.ndarray]:
    """Draw pixels of a sphere seen orthographically from a ring of views, and their views."""
    rng = np.random.default_rng(seed)
    azimuth = 2 * np.pi * np.arange(VIEWS) / VIEWS + 0.1
    towards = unit(np.stack([np.cos(azimuth), np.sin(azimuth), 0.25 * np.ones(VIEWS)], -1))
    view = rng.integers(VIEWS, size=count)
    outgoing = towards[view]
    # Uniform over the disk that the sphere shows, out to where its normals reach the lowest cosine.
    radius = np.sqrt(rng.uniform(0, 1 - lowest_cosine**2, count))[:, None]
    turn = rng.uniform(0, 2 * np.pi, count)[:, None]
    right = unit(np.cross(np.array([0.0, 0.0, 1.0]), outgoing))
    across = right * np.cos(turn) + np.cross(outgoing, right) * np.sin(turn)
    normals = unit(radius * across + np.sqrt(1 - radius**2) * outgoing)
    return SurfaceSamples(normals, outgoing), view


def photograph(
    scene_light: LightNodes, brdf: Microfacet, samples: SurfaceSamples, view: np.ndarray
) -> Observations:
    """Photograph a material exactly: the integral over all of the light's nodes, no noise."""
    lit = np.asarray(scene_light.irradiance).max(axis=1) > 0
    nodes = LightNodes(
        jnp.asarray(np.asarray(scene_light.directions)[lit]),
        jnp.asarray(np.asarray(scene_light.irradiance)[lit]),
    )
    image = _integrate(brdf, SurfaceSamples(*(jnp.asarray(a) for a in samples)), nodes)
    return Observations(samples, np.asarray(image), view)


def photograph_function(
    radiance_of: Callable,
    brdf: Microfacet,
    samples: SurfaceSamples,
    view: np.ndarray,
    sources: DirectionalSources | None = None,
) -> Observations:
    """Photograph a material under smooth light given as a function, and under sources."""
    arrays = SurfaceSamples(*(jnp.asarray(a) for a in samples))
    columns = polar_columns(brdf, arrays, radiance_of)
    if sources is not None:
        columns = columns + integral_columns(brdf, arrays, sources.nodes())
    return Observations(samples, np.asarray(radiance(brdf, columns)), view)


def residual_off_noise(fit: BRDFFit, exact: Observations) -> float:
    """Compare the residual of a fit with the noise that its samples really got, per cent."""
    measured = np.asarray(fit.final.data.radiance)
    noise = measured - same_samples(exact, fit.final.observations)
    got = np.sqrt(np.sum(noise**2) / np.sum(measured**2))
    return 100 * (fit.final.relative_rms / float(got) - 1)


def same_samples(every: Observations, some: Observations) -> np.ndarray:
    """Look up the radiance in ``every`` of the samples of its subset ``some``."""
    place = {normal.tobytes(): index for index, normal in enumerate(every.samples.normals)}
    index = [place[normal.tobytes()] for normal in np.asarray(some.samples.normals)]
    return np.asarray(every.radiance)[index]


@eqx.filter_jit
def _integrate(brdf: Microfacet, samples: SurfaceSamples, nodes: LightNodes):
    return radiance(brdf, integral_columns(brdf, samples, nodes))


def _lobe(directions: np.ndarray, centre: np.ndarray, width: float) -> np.ndarray:
    angle = np.arccos(np.clip(directions @ centre, -1, 1))
    return np.exp(-((angle / width) ** 2))[..., None]


def _block_sums(image: np.ndarray, factor: int) -> np.ndarray:
    rows, columns, channels = image.shape
    blocks = image.reshape(rows // factor, factor, columns // factor, factor, channels)
    return blocks.sum(axis=(1, 3))
