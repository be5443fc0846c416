"""A ball whose texels differ in colour, sigma and normal, and how it is fitted."""

import jax.numpy as jnp
import numpy as np
from inverse_problems import SOURCES, microfacet_unknowns
from texture_problems import (
    LOBE,
    MU,
    NOISE,
    SITES,
    samples_of,
    texture,
    views,
)

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.texture import (
    MAPS,
    TextureSettings,
    recover_texture,
)
from jaxrender.inverse.texture.site_numbers import tangents_of
from jaxrender.reflection import integral_columns

# The dark has noise, too, as that of any camera has.
NOISY = NoiseModel(NOISE.relative, 1e-3)
SIGMAS = np.array([0.1, 0.16, 0.28])
BOTH = TextureSettings(starts=1, diagnose=False, maps=tuple(MAPS))


class World:
    """Texels of three sigmas, with tilts of a few degrees, as eight cameras see them."""

    def __init__(self, light, columns_of, tilt=0.05, colour=0.0, sigmas=SIGMAS):
        self.light = light
        rng = np.random.default_rng(3)
        self.samples, self.frame, self.site = samples_of(views(8))
        self.axes = tangents_of(np.asarray(self.samples.normals), self.site, SITES)
        self.sigma = rng.choice(sigmas, SITES)
        self.tilt = rng.normal(0, tilt, (SITES, 2))
        self.kd, ks = texture()
        # Half of the sites are metals of their own colours.
        metal = rng.random((SITES, 1)) < 0.5
        self.ks = ks[:, None] * np.exp(colour * metal * rng.normal(size=(SITES, 3)))
        own = np.asarray(self.samples.normals)
        offset = np.einsum("sk,ski->si", self.tilt, self.axes)[self.site]
        tilted = own + offset - np.sum(offset * own, axis=1, keepdims=True) * own
        self.normals = tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
        self.radiance = np.zeros((len(self.site), 3))
        for sigma in sigmas:
            rows = np.flatnonzero(self.sigma[self.site] == sigma)
            seen = SurfaceSamples(self.normals[rows], np.asarray(self.samples.outgoing)[rows])
            columns = columns_of(seen, sigma)
            site = self.site[rows]
            self.radiance[rows] = self.kd[site] * columns[:, 0]
            self.radiance[rows] += self.ks[site] * columns[:, 1]

    @property
    def observations(self):
        radiance = NOISY.add(self.radiance, np.random.default_rng(1))
        return Observations(self.samples, radiance, self.frame)


LAMPS = KnownLight(None, SOURCES)


def under_lamps(samples, sigma):
    arrays = SurfaceSamples(*(jnp.asarray(part) for part in samples))
    lobe = Microfacet(np.ones(3), np.ones(3), float(sigma), MU)
    return np.asarray(integral_columns(lobe, arrays, SOURCES.nodes()))


def fitted(world, observations=None, **changed):
    return recover_texture(
        observations or world.observations,
        world.site,
        SITES,
        world.light,
        LOBE,
        unknowns=microfacet_unknowns(),
        settings=BOTH._replace(**changed),
    )
