"""Problems that the tests of inverse lighting share: samples of a sphere from all round."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from inverse_problems import unit

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import degrees
from jaxrender.inverse.lighting.operator import LightOperator, LightRows
from jaxrender.reflection import integral_columns, polar_columns, radiance
from jaxrender.spectra import phong_transfer

EXPONENT = 24.0


def glossy(sigma=0.1, mu=1.5):
    return Microfacet(np.full(3, 0.15), np.array([0.2, 0.25, 0.3]), sigma, mu)


def samples_all_round(count, lowest_cosine=0.5, seed=0):
    """Samples of a sphere seen from the sides and corners of a cube."""
    rng = np.random.default_rng(seed)
    corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    towards = unit(np.concatenate([np.eye(3), -np.eye(3), corners]))
    outgoing = towards[rng.integers(len(towards), size=count)]
    across = unit(np.cross(outgoing, rng.normal(size=(count, 3))))
    radius = np.sqrt(rng.uniform(0, 1 - lowest_cosine**2, count))[:, None]
    return SurfaceSamples(unit(radius * across + np.sqrt(1 - radius**2) * outgoing), outgoing)


def random_light(band_limit, channels=3, seed=0):
    rng = np.random.default_rng(seed)
    degree = degrees(band_limit)[:, None]
    light = rng.normal(size=(len(degree), channels)) / (1 + degree)
    light[0] = 4
    return light


def phong_operator(samples, band_limit, kd, ks, exponent=EXPONENT):
    """Lambertian and an unclipped Phong lobe, whose transfer depends on the degree alone."""
    passed = jnp.broadcast_to(
        phong_transfer(exponent, band_limit)[None, :], (len(samples.normals), band_limit + 1)
    )
    rows = LightRows(jnp.asarray(samples.normals), samples.reflected, passed)
    return LightOperator(rows, np.asarray(kd), np.asarray(ks), band_limit)


def photograph(brdf, samples, lobes, source):
    """Photograph without noise: the exact integral of smooth light, and of a source."""
    arrays = SurfaceSamples(*(jnp.asarray(a) for a in samples))
    return np.asarray(_integrated(brdf, arrays, lobes, source))


@eqx.filter_jit
def _integrated(brdf, samples, lobes, source):
    smooth = polar_columns(brdf, samples, lobes.radiance, polar_nodes=32)
    return radiance(brdf, smooth + integral_columns(brdf, samples, source.nodes()))
