"""A ball whose texels differ in base colour, roughness and metalness, and how it is fitted.

Its photographs are glTF's own definition, (1 - m) dielectric + m metal, each by the integral.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from site_worlds import LAMPS, NOISY
from texture_problems import LIGHTS, SITES, SOURCES, samples_of, views

from jaxrender.brdf import MetallicRoughness
from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse import Observations
from jaxrender.inverse.texture import TextureSettings, recover_metallic
from jaxrender.inverse.unknowns import unknowns_of
from jaxrender.reflection import integral_columns, polar_columns

WHITE = np.ones(3)
VARIANT = MetallicRoughness(WHITE, WHITE, 0.3, 0.4)
BOTH = TextureSettings(maps=("roughness", "metalness"))
ROUGHNESSES = (0.3, 0.4, 0.55)


def under_lamps(brdf, samples):
    return integral_columns(brdf, samples, SOURCES.nodes())


def under_a_sky(brdf, samples):
    """Add continuous light, by nodes that no fit uses."""
    sky = polar_columns(brdf, samples, LIGHTS.radiance, polar_nodes=48)
    return under_lamps(brdf, samples) + sky


class MetallicWorld:
    """Texels of some roughnesses; most are plastic or metal, and some are between."""

    def __init__(self, light, columns_of, roughnesses=ROUGHNESSES):
        self.light, rng = light, np.random.default_rng(3)
        self.samples, self.frame, self.site = samples_of(views(8))
        metal = (rng.random(SITES) < 0.5).astype(float)
        self.metal = np.where(rng.random(SITES) < 0.15, rng.random(SITES), metal)
        self.rough = rng.choice(roughnesses, SITES)
        self.color = rng.uniform(0.1, 0.8, (SITES, 3))
        # One texel is hidden.
        self.hidden = int(self.site[0])
        self.radiance = np.zeros((len(self.site), 3))
        columns_of = eqx.filter_jit(columns_of)
        for rough in roughnesses:
            rows = np.flatnonzero(self.rough[self.site] == rough)
            seen = SurfaceSamples(*(jnp.asarray(np.asarray(a)[rows]) for a in self.samples))
            own = self.site[rows]
            for metal, share in ((0.0, 1 - self.metal), (1.0, self.metal)):
                lobe = MetallicRoughness(WHITE, WHITE, metal, rough)
                columns = np.asarray(columns_of(lobe, seen))
                sent = self.color[own] * columns[:, 0] + columns[:, 1]
                self.radiance[rows] += share[own, None] * sent

    @property
    def observations(self):
        radiance = NOISY.add(self.radiance, np.random.default_rng(1))
        return Observations(self.samples, radiance, self.frame)

    def fitted(self, settings=BOTH, **stated):
        return recover_metallic(
            self.observations,
            np.where(self.site == self.hidden, -1, self.site),
            SITES,
            self.light,
            VARIANT,
            unknowns_of(VARIANT, stated),
            settings,
        )


def lamps(**changed):
    return MetallicWorld(LAMPS, under_lamps, **changed)
