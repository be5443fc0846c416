"""A surface, its turns, its material and its light, at random and at the edges, for many rows."""

import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples, rotation
from jaxrender.lighting import DirectionalSources
from jaxrender.reflection import DualLight

from ..page import Above, Unit
from ..places import POLES, normal, unit

UP = POLES["+Z"]


def samples(normals, outgoing) -> SurfaceSamples:
    """Unit normals and outgoing directions that both move."""
    return SurfaceSamples(Unit(np.asarray(normals)), Unit(np.asarray(outgoing)))


def leaning(normals, cosine: float, seed: int = 0):
    """Directions at a stated cosine to the normals."""
    across = np.cross(normals, unit(len(normals), seed=7 + seed))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return cosine * normals + np.sqrt(1 - cosine**2) * across


NORMALS = unit(2, seed=1)
OUTGOING = leaning(NORMALS, 0.6)
# Where the reflected direction is a pole of the world.
TO_POLE = np.stack([leaning(UP[None], 0.8)[0], leaning(-UP[None], 0.7)[0]])
REFLECTED = 2 * np.sum(TO_POLE * [UP, -UP], axis=1, keepdims=True) * TO_POLE - [UP, -UP]
AT = {"samples": samples(NORMALS, OUTGOING)}
PLACES = {
    "normals at the poles": samples([UP, -UP], leaning(np.array([UP, -UP]), 0.6)),
    "head-on": samples(NORMALS, NORMALS),
    "head-on at the poles": samples([UP, -UP], [UP, -UP]),
    "R at the poles": samples(TO_POLE, REFLECTED),
    "grazing": samples(NORMALS, leaning(NORMALS, 0.055)),
}
EDGES = {place: {"samples": value} for place, value in PLACES.items()}
SIGMA = {"sigma": Above(np.array(0.3))}
MU = {"mu": Above(np.array(1.5), 1)}
MATERIAL = {"kd": np.array([0.2, 0.1]), "ks": np.array([0.4, 0.5]), **SIGMA, **MU}
# Sources near the mirrors' directions, so that narrow lobes are seen.
MIRRORS = 2 * np.sum(NORMALS * OUTGOING, axis=1, keepdims=True) * NORMALS - OUTGOING
SOURCES = MIRRORS + 0.01 * normal(2, 3)
SOURCES /= np.linalg.norm(SOURCES, axis=1, keepdims=True)
LIGHT = {"directions": Unit(SOURCES), "irradiance": np.abs(normal(2, 2)) + 0.2}
NARROW = {"sigma": Above(np.array(0.01))}
SLOW = {"slow": normal(9, 2)}
TURNS = np.asarray(rotation(np.array([0.7, 2.0]), np.array([0.4, 4.0]), np.array([1.2, 3.0])))
LOCKED_TURNS = np.asarray(rotation(np.array([0.0, np.pi]), np.array([0.4, 4.0]), np.zeros(2)))


def glossy(sigma, mu=None, **static) -> Microfacet:
    """A lobe without a base, of one channel."""
    white = np.ones(1, sigma.dtype)
    return Microfacet(0 * white, white, sigma, mu, **static)


def unlit(like):
    """No sources, in the precision of other numbers."""
    return np.zeros((0, 3), like.dtype), np.zeros((0, 2), like.dtype)


def dual(slow, directions, irradiance) -> DualLight:
    """Slow light and sources."""
    return DualLight(slow, DirectionalSources(directions, irradiance))
