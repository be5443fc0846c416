"""Problems that the tests of the division share: a toy model, its NumPy twin, small photographs."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import INDEX_BOUNDS, WIDTH_BOUNDS, Microfacet, normalised_fresnel
from jaxrender.geometry import SurfaceSamples
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import KnownLight, Observations, Unknown, unknowns_of
from jaxrender.inverse.elimination import Data
from jaxrender.inverse.models import Columns
from jaxrender.lighting import DirectionalSources, SmoothLobes
from jaxrender.reflection import integral_columns, polar_columns, radiance
from jaxrender.shapes import Array, Float

VIEWS = 4
# All small photographs share these numbers, so that few programs are compiled.
SAMPLES, ROWS = 400, 64


class ToyModel(eqx.Module):
    """A diffuse column, and a Gaussian of an angle times the Fresnel ratio."""

    diffuse: Float[Array, "sample channel"]
    angles: Float[Array, "sample channel"]
    cosines: Float[Array, "sample"]

    def columns(self, numbers):
        sigma, mu = numbers["sigma"], numbers.get("mu")
        lobe = jnp.exp(-((self.angles / sigma) ** 2)) / (jnp.pi * sigma**2)
        return Columns(self.diffuse, lobe * normalised_fresnel(mu, self.cosines)[:, None])

    def take(self, index):
        return ToyModel(self.diffuse[index], self.angles[index], self.cosines[index])


def toy_model(count=60, seed=0, dtype=np.float64):
    rng = np.random.default_rng(seed)
    return ToyModel(
        jnp.asarray(rng.uniform(0.5, 3, (count, 3)), dtype),
        jnp.asarray(rng.uniform(0, 0.4, (count, 3)), dtype),
        jnp.asarray(rng.uniform(0.15, 1, count), dtype),
    )


def toy_radiance(model, kd, ks, sigma, mu):
    """The toy model in plain NumPy, with the Fresnel equations as in the textbooks."""
    c = np.asarray(model.cosines, float)
    lobe = np.exp(-((np.asarray(model.angles, float) / sigma) ** 2)) / (np.pi * sigma**2)
    if mu is not None:
        refracted = np.sqrt(1 - (1 - c**2) / mu**2)
        s, p = (
            (c - mu * refracted) / (c + mu * refracted),
            (mu * c - refracted) / (mu * c + refracted),
        )
        lobe = lobe * ((s**2 + p**2) / 2 * ((mu + 1) / (mu - 1)) ** 2)[:, None]
    return np.asarray(kd) * np.asarray(model.diffuse, float) + np.asarray(ks) * lobe


def toy_data(radiance, weights=None, frame=None):
    frame = np.zeros(len(radiance), int) if frame is None else frame
    return Data(radiance, np.ones_like(radiance) if weights is None else weights, frame)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


LIGHTS = SmoothLobes(
    unit(np.array([[1.0, 0.3, 0.8], [-0.6, 0.9, 0.4], [-0.4, -1.0, 0.2]])),
    np.radians([25.0, 40.0, 60.0]),
    np.array([[3.0, 2.8, 2.4], [1.2, 1.4, 1.6], [0.5, 0.6, 0.8]]),
)
SOURCES = DirectionalSources(
    np.array([[0.2, -0.7, 0.6], [-0.9, 0.1, 0.4]]),
    np.array([[0.5, 0.45, 0.4], [0.3, 0.3, 0.35]]),
)


def material(mu=1.62, fresnel="exit", masking="none"):
    kd, ks = np.array([0.19, 0.11, 0.07]), np.full(3, 0.21)
    return Microfacet(kd, ks, 0.16, mu, fresnel, masking)


def ball_samples(count=SAMPLES, lowest_cosine=0.15, seed=0):
    """Samples of a sphere from a ring of views, exit cosines uniform above the lowest."""
    rng = np.random.default_rng(seed)
    azimuth = 2 * np.pi * np.arange(VIEWS) / VIEWS + 0.1
    views = unit(np.stack([np.cos(azimuth), np.sin(azimuth), np.full(VIEWS, 0.3)], axis=-1))
    frame = np.arange(count) % VIEWS
    outgoing = views[frame]
    tangents = unit(np.cross(outgoing, rng.normal(size=(count, 3))))
    cosine = rng.uniform(lowest_cosine, 1, (count, 1))
    normals = cosine * outgoing + np.sqrt(1 - cosine**2) * tangents
    return SurfaceSamples(normals, outgoing), frame


def known_light(rows=ROWS):
    return KnownLight(LIGHTS.to_environment(rows), SOURCES)


def photograph(brdf, samples, frame, radiance_of=LIGHTS.radiance, sources=SOURCES):
    """Photograph under continuous light: the fit's images of it have no part in this."""
    arrays = SurfaceSamples(*(jnp.asarray(a) for a in samples))
    columns = polar_columns(brdf, arrays, radiance_of)
    if sources is not None:
        columns = columns + integral_columns(brdf, arrays, sources.nodes())
    return Observations(samples, np.asarray(radiance(brdf, columns)), frame)


def with_noise(observations, relative=0.01, floor=0.0, seed=0):
    noise = NoiseModel(relative, floor * float(observations.radiance.mean()))
    rng = np.random.default_rng(seed)
    return observations._replace(radiance=noise.add(observations.radiance, rng))


def parameter_vector(parameters):
    """kd of each channel, the shared ks, sigma, mu."""
    numbers = [float(parameters.numbers[name]) for name in ("sigma", "mu")]
    ks = float(np.asarray(parameters.ks)[0])
    return np.array([*np.asarray(parameters.kd, float), ks, *numbers])


def microfacet_unknowns(*, kd=None, ks=None, sigma=None, mu=True, **rest):
    """Unknowns of T 6.2, all free unless stated otherwise; ``mu=None`` is a metal."""
    free = unknowns_of(Microfacet(np.zeros(3), np.zeros(3), 0.1, 1.5 if mu else None), **rest)
    numbers = [sigma or free["sigma"]]
    if mu is not None:
        numbers.append(free["mu"] if mu is True else mu)
    amplitudes = (kd or free["kd"], ks or free["ks"])
    return dataclasses.replace(free, amplitudes=amplitudes, numbers=tuple(numbers))


def sigma_unknown(lower=WIDTH_BOUNDS[0], upper=WIDTH_BOUNDS[1], start=None):
    """A free width."""
    return Unknown(None, lower, upper, start)


def mu_unknown(lower=INDEX_BOUNDS[0], upper=INDEX_BOUNDS[1], start=None):
    """A free index."""
    return Unknown(None, lower, upper, start)
