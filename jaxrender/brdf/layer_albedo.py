"""How much of the light from one direction a rough interface reflects: E(w) = int rho cos t_o dw_o.

Layers need it: what an interface reflects does not reach what lies below it, and what its facets
hand on to one another is missing in its lobe.  The integral is made once, on nodes of roughness,
index and cosine, and kept as the coefficients of Chebyshev polynomials: a smooth function, whose
value at a roughness is a polynomial of the cosine alone.

All interfaces here are GGX with Smith's height-correlated masking, of roughness alpha = r^2.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.polynomial import chebyshev

from jaxrender.brdf.parameters import Scalar
from jaxrender.brdf.sheen import sheen
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float, checked

# Nodes, and as many coefficients, along roughness r, index and cosine.
_ROUGHNESSES, _INDICES, _COSINES = 14, 12, 18
# Below this r nothing changes, but at grazing angles; above this index the outermost one is used.
_SMOOTHEST, _HIGHEST_INDEX = 0.05, 6.0
# Gauss-Legendre nodes of the integral over facets, along radius and azimuth, and over cosines.
_RADII, _AZIMUTHS, _MEAN_NODES = 96, 128, 24
# Nodes of the integral over sheen, which is smooth.
_SHEEN_NODES = 128


class _Table(NamedTuple):
    """Chebyshev coefficients over r, (index where there is one) and sqrt(cosine)."""

    coefficients: Float[np.ndarray, "*parameter cosine"]

    def of_cosine(self, *places: Float[Array, ""]) -> Float[Array, "cosine"]:
        """Evaluate the coefficients over the cosine at a place of the other variables."""
        found = jnp.asarray(self.coefficients, places[0].dtype)
        for place in places:
            powers = _polynomials(place, found.shape[0])
            found = jnp.tensordot(powers, found, 1, precision="highest")
        return found


@checked
def interface_albedo(
    roughness: Scalar, mu: Scalar | None, cosines: Float[AnyArray, "*batch"]
) -> Float[Array, "*batch"]:
    """Evaluate E of an interface of roughness r in (0, 1] and index ``mu``; None: all is reflected.

    Off by less than 1e-3, and below r = .05 at grazing angles by more.
    """
    return _clenshaw(_interface(roughness, mu, cosines), cosines)


@checked
def mean_interface_albedo(
    roughness: Scalar, mu: Scalar | None, like: Float[AnyArray, "..."]
) -> Float[Array, ""]:
    """Evaluate the mean of E over all light that arrives evenly, 2 int E(t) cos t dcos t."""
    return _mean(_interface(roughness, mu, like))


@checked
def sheen_albedo(roughness: Scalar, cosines: Float[AnyArray, "*batch"]) -> Float[Array, "*batch"]:
    """Evaluate E of the sheen lobe of ``sheen`` of roughness r in (0, 1]."""
    place = _roughness_place(jnp.asarray(roughness, cosines.dtype))
    return _clenshaw(_sheen_table().of_cosine(place), cosines)


def _interface(
    roughness: Scalar, mu: Scalar | None, like: Float[AnyArray, "..."]
) -> Float[Array, "cosine"]:
    place = _roughness_place(jnp.asarray(roughness, like.dtype))
    if mu is None:
        return _facet_table().of_cosine(place)
    return _dielectric_table().of_cosine(place, _index_place(jnp.asarray(mu, like.dtype)))


def _clenshaw(
    coefficients: Float[Array, "cosine"], cosines: Float[AnyArray, "*batch"]
) -> Float[Array, "*batch"]:
    """Sum Chebyshev polynomials of 2 sqrt(cosine) - 1."""
    x = 2 * jnp.sqrt(jnp.maximum(cosines, 1e-12)) - 1
    last, before = jnp.zeros_like(x), jnp.zeros_like(x)
    for coefficient in coefficients[:0:-1]:
        last, before = coefficient + 2 * x * last - before, last
    return coefficients[0] + x * last - before


def _mean(coefficients: Float[Array, "cosine"]) -> Float[Array, ""]:
    x, weights = np.polynomial.legendre.leggauss(_MEAN_NODES)
    roots = (x + 1) / 2
    # The variable is the root s of the cosine: 2 E cos dcos = 4 E s^3 ds.
    weights = jnp.asarray(2 * weights * roots**3, coefficients.dtype)
    values = _clenshaw(coefficients, jnp.asarray(roots**2, coefficients.dtype))
    return jnp.sum(weights * values)


def _polynomials(place: Float[Array, ""], count: int) -> Float[Array, "count"]:
    """Evaluate the first Chebyshev polynomials."""
    found = [jnp.ones_like(place), place]
    for _ in range(count - 2):
        found.append(2 * place * found[-1] - found[-2])
    return jnp.stack(found)


def _roughness_place(roughness: Float[Array, ""]) -> Float[Array, ""]:
    inside = jnp.clip(roughness, _SMOOTHEST, 1)
    return 2 * (inside - _SMOOTHEST) / (1 - _SMOOTHEST) - 1


def _index_place(mu: Float[Array, ""]) -> Float[Array, ""]:
    """Map 1 to the highest index to -1 ... 1, evenly in the root of the reflectance head-on."""
    highest = (_HIGHEST_INDEX - 1) / (_HIGHEST_INDEX + 1)
    inside = jnp.clip(mu, 1, _HIGHEST_INDEX)
    return 2 * (inside - 1) / (inside + 1) / highest - 1


def _nodes(count: int) -> Float[np.ndarray, "count"]:
    return chebyshev.chebpts1(count)


def _roughnesses() -> Float[np.ndarray, "node"]:
    return _SMOOTHEST + (_nodes(_ROUGHNESSES) + 1) / 2 * (1 - _SMOOTHEST)


def _cosines() -> Float[np.ndarray, "node"]:
    return ((_nodes(_COSINES) + 1) / 2) ** 2


def _coefficients(values: np.ndarray) -> np.ndarray:
    """Turn values at Chebyshev nodes along all axes into coefficients."""
    for axis, count in enumerate(values.shape):
        basis = chebyshev.chebvander(_nodes(count), count - 1)
        values = np.moveaxis(np.tensordot(np.linalg.inv(basis), values, (1, axis)), 0, axis)
    return values


@functools.cache
def _sheen_table() -> _Table:
    x, w = np.polynomial.legendre.leggauss(_SHEEN_NODES)
    cosines, azimuths = (x + 1) / 2, np.pi * (np.arange(_SHEEN_NODES) + 0.5) / _SHEEN_NODES
    z, azimuth = (part.ravel() for part in np.meshgrid(cosines, azimuths, indexing="ij"))
    sine = np.sqrt(1 - z**2)
    incoming = Components(sine * np.cos(azimuth), sine * np.sin(azimuth), z)
    weights = np.repeat(np.pi * w / _SHEEN_NODES, _SHEEN_NODES)

    def reflected(roughness: float, cosine: float) -> float:
        outgoing = Components(*np.array([np.sqrt(1 - cosine**2), 0, cosine])[:, None])
        with jax.ensure_compile_time_eval():
            return float(np.sum(weights * np.asarray(sheen(roughness, incoming, outgoing))))

    found = [[reflected(float(r), float(c)) for c in _cosines()] for r in _roughnesses()]
    return _Table(_coefficients(np.array(found)))


@functools.cache
def _facet_table() -> _Table:
    found = [[_reflected(r, c, None)[0] for c in _cosines()] for r in _roughnesses()]
    return _Table(_coefficients(np.array(found)))


@functools.cache
def _dielectric_table() -> _Table:
    highest = (_HIGHEST_INDEX - 1) / (_HIGHEST_INDEX + 1)
    roots = (_nodes(_INDICES) + 1) / 2 * highest
    indices = (1 + roots) / (1 - roots)
    found = [[_reflected(r, c, indices) for c in _cosines()] for r in _roughnesses()]
    return _Table(_coefficients(np.moveaxis(np.array(found), 2, 1)))


@functools.cache
def _disc_radii() -> tuple[Float[np.ndarray, "node"], Float[np.ndarray, "node"]]:
    """Return nodes and weights along the radius: they take longer than the integral they serve."""
    x, weights = np.polynomial.legendre.leggauss(_RADII)
    return (x + 1) / 2, weights


def _reflected(
    roughness: float, cosine: float, indices: Float[np.ndarray, "index"] | None
) -> Float[np.ndarray, "index"]:
    """Integrate over the facets that a direction sees, as Heitz (2018) draws them."""
    alpha = roughness**2
    sine = np.sqrt(1 - cosine**2)
    stretched = np.array([alpha * sine, 0.0, cosine]) / np.hypot(alpha * sine, cosine)
    # A disc, squeezed to the half of the ellipsoid that is seen.
    radius, w = _disc_radii()
    # One half of the circle mirrors the other.
    azimuth = 2 * np.pi * (np.arange(_AZIMUTHS // 2) + 0.5 - _AZIMUTHS / 4) / _AZIMUTHS
    t1 = radius[:, None] * np.cos(azimuth)
    t2 = radius[:, None] * np.sin(azimuth)
    weight = np.broadcast_to(2 * (w * radius)[:, None] / _AZIMUTHS, t1.shape)
    s = (1 + stretched[2]) / 2
    t2 = (1 - s) * np.sqrt(np.maximum(1 - t1**2, 0)) + s * t2
    across = np.array([0.0, 1.0, 0.0])
    along = np.cross(stretched, across)
    up = np.sqrt(np.maximum(1 - t1**2 - t2**2, 0))
    facet = t1[..., None] * across + t2[..., None] * along + up[..., None] * stretched
    facet *= [alpha, alpha, 1]
    facet[..., 2] = np.maximum(facet[..., 2], 0)
    facet /= np.linalg.norm(facet, axis=-1, keepdims=True)
    towards = facet @ np.array([sine, 0, cosine])
    leaving = 2 * towards * facet[..., 2] - cosine

    seen = leaving > 0
    # Smith's Lambda of either direction.
    cosines = np.where(seen, leaving, 1)
    one, other = (np.sqrt(1 + alpha**2 * (1 / z**2 - 1)) / 2 - 0.5 for z in (cosine, cosines))
    share = np.where(seen, (1 + one) / (1 + one + other), 0) * weight
    if indices is None:
        return np.sum(share, axis=(0, 1), keepdims=True)[0]
    square = (indices**2 - 1)[:, None, None]
    total = np.sqrt(square + towards**2) + towards
    head_on = (((indices - 1) / (indices + 1)) ** 2)[:, None, None]
    ratio = (towards * total - 1) / (towards * square / total + 1)
    reflected = head_on * ((indices[:, None, None] + 1) / total) ** 4 * (1 + ratio**2) / 2
    return np.sum(share * reflected, axis=(1, 2))
