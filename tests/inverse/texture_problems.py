"""Problems that the tests of textures share: a textured ball photographed from a ring of views."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from inverse_problems import LIGHTS, SOURCES, unit

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Orthographic, Sphere, SurfaceSamples, look_at, observe
from jaxrender.geometry.texels import surface_sites
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations
from jaxrender.inverse.texture import by_site
from jaxrender.reflection import integral_columns, polar_columns

SIGMA, MU = 0.16, 1.62
IMAGE = (12, 24)
PIXELS = 26
NOISE = NoiseModel(0.01, 0.0)


class Ball(NamedTuple):
    """Observations without noise, the site of each, and the true texture."""

    observations: Observations
    site: np.ndarray
    kd: np.ndarray
    ks: np.ndarray


def texture(image=IMAGE, seed=0):
    """A checkerboard of random colours whose K_s varies by a third about .2."""
    rng = np.random.default_rng(seed)
    count = image[0] * image[1]
    return rng.uniform(0.04, 0.3, (count, 3)), 0.2 * np.exp(rng.normal(0, 0.3, count))


def cameras(count=8, pixels=PIXELS):
    """Look at the unit ball from a ring, by turns from above and below."""
    azimuth = 2 * np.pi * np.arange(count) / count + 0.1
    height = np.where(np.arange(count) % 2 == 0, 0.9, -0.5)
    towards = unit(np.stack([np.cos(azimuth), np.sin(azimuth), height], axis=-1))
    up = np.array([0.0, 0.0, 1.0])
    poses = [look_at(4 * t, np.zeros(3), up) for t in towards]
    scale = 2.02 / pixels
    return [Orthographic(pixels, pixels, pose, scale=scale) for pose in poses]


def views(count=8, pixels=PIXELS):
    """See the unit ball from there."""
    return [observe(camera, BALL) for camera in cameras(count, pixels)]


BALL = Sphere()


def samples_of(seen, lowest_cosine=0.2):
    """Gather samples, their frames and their sites from views."""
    normals, outgoing, frame, site = [], [], [], []
    for index, view in enumerate(seen):
        used = view.exit_cosines > lowest_cosine
        normals.append(view.normals[used])
        outgoing.append(view.outgoing[used])
        frame.append(np.full(int(used.sum()), index))
        site.append(surface_sites(BALL, view, IMAGE).of_pixel[used])
    samples = SurfaceSamples(np.concatenate(normals), np.concatenate(outgoing))
    return samples, np.concatenate(frame), np.concatenate(site)


def exact_columns(samples, sigma=SIGMA, mu=MU):
    """D and S of T 6.13 by the integral of continuous light, which no fit uses."""
    lobe = Microfacet(np.ones(3), np.ones(3), sigma, mu)
    return np.asarray(_integrated(lobe, SurfaceSamples(*(jnp.asarray(a) for a in samples))))


@eqx.filter_jit
def _integrated(lobe, samples):
    columns = polar_columns(lobe, samples, LIGHTS.radiance, polar_nodes=32)
    return columns + integral_columns(lobe, samples, SOURCES.nodes())


def textured_ball(count=8, seed=0):
    samples, frame, site = samples_of(views(count))
    kd, ks = texture(seed=seed)
    columns = exact_columns(samples)
    radiance = kd[site] * columns[:, 0] + ks[site][:, None] * columns[:, 1]
    return Ball(Observations(samples, radiance, frame), site, kd, ks)


def noisy(ball, noise=NOISE, seed=0):
    rng = np.random.default_rng(seed)
    observed = ball.observations
    return observed._replace(radiance=noise.add(observed.radiance, rng))


SITES = IMAGE[0] * IMAGE[1]
LOBE = Microfacet(np.ones(3), np.ones(3), SIGMA, MU)


@eqx.filter_jit
def under_smooth_light(samples):
    return polar_columns(LOBE, samples, LIGHTS.radiance, polar_nodes=32)


class SmoothlyLit:
    """A ball under smooth light: samples, frames, sites, and both columns of the integral."""

    def __init__(self):
        self.samples, self.frame, self.site = samples_of(views(6, 20))
        arrays = SurfaceSamples(*(jnp.asarray(a) for a in self.samples))
        self.columns = np.asarray(under_smooth_light(arrays))

    def measured(self, kd, ks, diffuse=None, seed=0):
        diffuse = self.columns[:, 0] if diffuse is None else diffuse
        exact = kd[self.site] * diffuse + ks[self.site][:, None] * self.columns[:, 1]
        radiance = NOISE.add(exact, np.random.default_rng(seed))
        seen = Observations(self.samples, radiance, self.frame)
        return seen, by_site(seen, self.site, SITES)
