"""Slow light reflected by a glossy lobe, facet by facet: the integral on a few hundred nodes.

int L(w_i) f(w_i, w_o) cos t_i dw_i = int L f cos t_i 4 (w_o . h) dh,    w_i = 2 (w_o . h) h - w_o

A lobe of facets is narrow and smooth in the half vector h, wherever the light comes from.  In polar
coordinates of h about the normal the horizon of w_i lies at t_h = atan2(c, -s cos p) / 2, with c
and s the exit angle's cosine and sine: the nodes end there exactly, and crowd within the lobe.
240 of them reach 1e-3 where the normal-centred ``polar_columns``, the slow twin, takes thousands.

The light is given by its coefficients; ``slow_light.reflect_slow_light`` sums the same in the
frequency domain, at a cost that grows with the cube of the light's degree.  Nothing may shadow the
surface.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.geometry import Components, SurfaceSamples
from jaxrender.harmonics import LatLongGrid, band_limit_of, real_basis, synthesise
from jaxrender.reflection.integral import as_widths, by_chunks, incidence_frame, with_width
from jaxrender.shapes import AnyArray, Array, Float, checked

# Nodes along the polar angle of h and about the normal.
_POLAR, _AZIMUTHS = 12, 20
# Half of the polar nodes lie within this many widths of the lobe.
_WIDTHS = 1.5
# Rows of the image that the light is looked up in, for each degree.
_ROWS_PER_DEGREE = 8
_LEAST_ROWS = 32


class _Facets(NamedTuple):
    """Where light comes from by way of each facet, and what the lobe makes of it."""

    towards: Components
    weight: Float[Array, "polar azimuth"]


@eqx.filter_jit
@checked
def reflect_by_facets(
    brdf: Glossy,
    samples: SurfaceSamples,
    slow: Float[AnyArray, "coefficient channel"],
    widths: Float[AnyArray, "sample"] | None = None,
) -> Float[Array, "sample channel"]:
    """Integrate the specular column (ks = 1) of light given by its coefficients.

    ``widths`` give the lobe a sigma of its own at each sample.  Differentiable in the BRDF and in
    those, not in the light.
    """
    samples = SurfaceSamples(*(jnp.asarray(a) for a in samples))
    rows = max(_ROWS_PER_DEGREE * band_limit_of(slow.shape[0]), _LEAST_ROWS)
    image = synthesise(LatLongGrid(rows, 2 * rows), jnp.asarray(slow))
    image = jax.lax.stop_gradient(_sharpened(image))

    def one(indexed: tuple) -> Float[Array, "channel"]:
        sample, width = indexed
        own = with_width(brdf, width)
        assert isinstance(own, Glossy)
        # They stay where they are when sigma is moved: the image has no slope at its texels.
        facets = _facets(own, sample, jax.lax.stop_gradient(jnp.asarray(own.sigma)))
        light = _looked_up(image, facets.towards)
        return jnp.einsum("pa,pac->c", facets.weight, light, precision="highest")

    return by_chunks(one, (samples, as_widths(widths)), _POLAR * _AZIMUTHS)


@eqx.filter_jit
@checked
def facet_coefficients(
    brdf: Glossy, samples: SurfaceSamples, band_limit: int
) -> Float[Array, "sample coefficient"]:
    """Integrate the lobe against every harmonic: the specular column under light Y_lm."""

    def one(sample: SurfaceSamples) -> Float[Array, "coefficient"]:
        facets = _facets(brdf, sample, jnp.asarray(brdf.sigma))
        basis = real_basis(jnp.stack(facets.towards, axis=-1), band_limit)
        return jnp.einsum("pa,pak->k", facets.weight, basis, precision="highest")

    arrays = SurfaceSamples(*(jnp.asarray(a) for a in samples))
    return by_chunks(one, arrays, _POLAR * _AZIMUTHS * (band_limit + 1))


def _facets(brdf: Glossy, sample: SurfaceSamples, sigma: Float[Array, ""]) -> _Facets:
    """Place the facets of one sample for a lobe of that sigma."""
    frame = incidence_frame(sample)
    outgoing = Components.of(sample.outgoing).in_frame(frame)
    polar, weights, across, aside = (jnp.asarray(a, outgoing.z.dtype) for a in _rule())
    horizon = jnp.arctan2(outgoing.z, -outgoing.x * across) / 2
    width = _WIDTHS * sigma
    # A smooth map of [0, 1] to [0, horizon] with slope ``width`` at 0.
    stretch = 1 - polar + width * polar / horizon
    angle = width * polar / stretch
    sine = jnp.sin(angle)
    half = Components(sine * across, sine * aside, jnp.cos(angle))
    projection = outgoing.x * half.x + outgoing.z * half.z
    incoming = Components(
        2 * projection * half.x - outgoing.x,
        2 * projection * half.y,
        2 * projection * half.z - outgoing.z,
    )
    solid_angle = weights * (width / stretch**2) * sine * 4 * projection
    weight = jnp.asarray(solid_angle) * brdf.specular_transfer(incoming, outgoing)
    return _Facets(incoming.in_frame(frame.T), weight)


def _rule() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Nodes on [0, 1] with their weights as a column, the azimuths' cosines and sines as a row."""
    nodes, weights = np.polynomial.legendre.leggauss(_POLAR)
    azimuth = ((np.arange(_AZIMUTHS) + 0.5) * 2 * np.pi / _AZIMUTHS)[None, :]
    nodes, weights = (nodes[:, None] + 1) / 2, weights[:, None] * np.pi / _AZIMUTHS
    return nodes, weights, np.cos(azimuth), np.sin(azimuth)


def _sharpened(
    image: Float[Array, "row column channel"],
) -> Float[Array, "row column channel"]:
    """Make up for what bilinear interpolation takes off the peaks, on average over a texel.

    Between two nodes at a distance d linear interpolation is off by d^2 f'' / 12 in the mean.
    """
    # The row beyond a pole is the one before it, half way round.
    half = image.shape[1] // 2
    north, south = jnp.roll(image[:1], half, axis=1), jnp.roll(image[-1:], half, axis=1)
    above, below = jnp.concatenate([north, image[:-1]]), jnp.concatenate([image[1:], south])
    sides = jnp.roll(image, 1, axis=1) + jnp.roll(image, -1, axis=1)
    return image - (above + below + sides - 4 * image) / 12


def _looked_up(
    image: Float[Array, "row column channel"], towards: Components
) -> Float[Array, "polar azimuth channel"]:
    """Interpolate a latitude-longitude image bilinearly."""
    height, width, channels = image.shape
    texels = image.reshape(height * width, channels)
    row = jnp.arccos(jnp.clip(towards.z, -1, 1)) * (height / np.pi) - 0.5
    column = jnp.arctan2(towards.y, towards.x) * (width / (2 * np.pi)) - 0.5
    above = jnp.clip(jnp.floor(row), 0, height - 2)
    left = jnp.floor(column)
    down, right = jnp.clip(row - above, 0, 1)[..., None], (column - left)[..., None]
    north = above.astype(int) * width
    west = left.astype(int) % width
    east = (west + 1) % width
    upper = (1 - right) * texels[north + west] + right * texels[north + east]
    lower = (1 - right) * texels[north + width + west] + right * texels[north + width + east]
    return (1 - down) * upper + down * lower
