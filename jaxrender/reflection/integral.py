"""The reference: the reflection integral itself (T 2.12), with no limit on degree.

B(n, w_o) = int L(w_i) rho(w_i, w_o) max(cos t_i, 0) dw_i

``integral_columns`` sums over the light's nodes: every texel of an environment with its Fejer
weight, every directional source exactly.  That sum *is* the integral for a light made of point
masses; against the continuous hemisphere it errs by up to 1.5e-2 for 64 rows, 2e-3 for 128, 3e-4
for 512, because the horizon cuts between texels.  ``polar_columns`` serves smooth light without
that error: nodes centred on each sample's normal end exactly at the horizon.

The tangent of an anisotropic BRDF runs along the meridian about the world's +Z
(``geometry.meridian_frames``).

Both integrals know no shadows unless told: ``visible`` is V(x, w_i), which darkens each node for
the samples that do not see it (``jaxrender.geometry.visible`` finds it by ray tracing).

Samples are worked off in chunks, so memory does not grow with their number, and everything is
differentiable in the BRDF and in the light.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.batches import even, in_batches
from jaxrender.brdf import BRDF, Parametric
from jaxrender.geometry import (
    Components,
    Shape,
    SurfacePlaces,
    SurfaceSamples,
    meridian_frames,
    pair_in_frame,
    visible,
    visible_along,
    world_from_local,
)
from jaxrender.harmonics import real_basis, rotate
from jaxrender.lighting import LightNodes
from jaxrender.reflection.polar_nodes import polar_nodes_for, refuse_narrow
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int, checked

# Directions times samples worked on at once: small enough for a processor's cache.
_PAIRS_PER_CHUNK = 2**15
# More nodes than this are worked off in blocks, so that several samples share each.
_MOST_NODES_AT_ONCE, _NODES_PER_BLOCK = 2**13, 2**11
# How much denser than average the azimuths of the polar quadrature are about R (inverse).
_CROWDING = 0.25
# Closer to the normal than this (radians) an outgoing direction has no plane of incidence.
_HEAD_ON = 1e-6


class FrameNodes(NamedTuple):
    """A light of its own for each photograph: the nodes by frame, and each sample's frame."""

    directions: Float[AnyArray, "frame node 3"]
    irradiance: Float[AnyArray, "frame node channel"]
    frame_of_sample: Int[AnyArray, "sample"]


@checked
def integral_columns(
    brdf: BRDF,
    samples: SurfaceSamples,
    nodes: LightNodes,
    visible: Bool[AnyArray, "sample node"] | None = None,
    *,
    widths: Float[AnyArray, "sample"] | None = None,
) -> Float[Array, "sample lobe channel"]:
    """Sum each lobe's transfer function over all nodes of one light, or over those it sees.

    ``widths`` give a parametric BRDF a sigma of its own at each sample.
    """
    light = LightNodes(*(jnp.asarray(a) for a in nodes))

    def one(indexed: tuple) -> Float[Array, "lobe channel"]:
        sample, width, seen = indexed
        return _sum_over_nodes(with_width(brdf, width), sample, light, seen)

    indexed = _as_arrays(samples), as_widths(widths), _mask(visible)
    return by_chunks(one, indexed, _at_once(light.directions.shape[0]))


@checked
def integral_columns_by_frame(
    brdf: BRDF,
    samples: SurfaceSamples,
    nodes: FrameNodes,
    visible: Bool[AnyArray, "sample node"] | None = None,
    *,
    widths: Float[AnyArray, "sample"] | None = None,
) -> Float[Array, "sample lobe channel"]:
    """Sum each lobe's transfer function over the nodes of the light of each sample's frame.

    ``visible`` speaks of the nodes of that frame; ``widths`` as for ``integral_columns``.
    """
    directions, weights = jnp.asarray(nodes.directions), jnp.asarray(nodes.irradiance)

    def one(indexed: tuple) -> Float[Array, "lobe channel"]:
        sample, width, frame, seen = indexed
        light = LightNodes(directions[frame], weights[frame])
        return _sum_over_nodes(with_width(brdf, width), sample, light, seen)

    frame_of_sample = jnp.asarray(nodes.frame_of_sample)
    indexed = _as_arrays(samples), as_widths(widths), frame_of_sample, _mask(visible)
    return by_chunks(one, indexed, _at_once(directions.shape[1]))


@checked
def visible_nodes(
    shape: Shape, places: SurfacePlaces, nodes: LightNodes | FrameNodes
) -> Bool[np.ndarray, "sample node"]:
    """Trace which nodes each sample sees, or which of its own frame's (host side)."""
    directions = np.asarray(nodes.directions)
    if not isinstance(nodes, FrameNodes):
        return visible(shape, places, directions)
    frame = np.asarray(nodes.frame_of_sample)
    seen = np.zeros((len(frame), directions.shape[1]), bool)
    if len(directions) > directions.shape[1]:
        for node in range(directions.shape[1]):
            seen[:, node] = visible_along(shape, places, directions[frame, node])
        return seen
    for index, own in enumerate(directions):
        rows = frame == index
        seen[rows] = visible(shape, SurfacePlaces(*(np.asarray(a)[rows] for a in places)), own)
    return seen


@checked
def polar_columns(
    brdf: BRDF,
    samples: SurfaceSamples,
    radiance_of: Callable[[Float[Array, "node 3"]], Float[Array, "node channel"]],
    polar_nodes: int | None = None,
) -> Float[Array, "sample lobe channel"]:
    """Integrate each lobe against smooth light on nodes centred on each sample's normal.

    ``radiance_of`` maps world directions to radiance.  Gauss-Legendre in the cosine, which ends
    exactly at the horizon, by azimuths about the plane of incidence that crowd where the lobe is
    narrow: phi = 2 arctan(tan(u / 2) / 4) about R for equal steps in u, a smooth periodic map, so
    that equal weights stay spectrally accurate.

    ``polar_nodes=None`` takes as many as ``polar_nodes_for`` says, for an error of 1e-6 at exit
    cosines from .15.  Where sigma is traced they are 48, and a lobe too narrow for these fails at
    run time.
    """
    if polar_nodes is None:
        polar_nodes = polar_nodes_for(brdf)
        columns = polar_columns(brdf, samples, radiance_of, polar_nodes)
        return refuse_narrow(brdf, polar_nodes, columns)
    arrays = _as_arrays(samples)
    local, solid_angle = _polar_rule(polar_nodes, arrays.normals.dtype)

    def one(sample: SurfaceSamples) -> Float[Array, "lobe channel"]:
        frame = incidence_frame(sample)
        world = jnp.matmul(local, frame.T, precision="highest")
        light = radiance_of(world) * solid_angle[:, None]
        return _sum(brdf.transfer(*_seen_by(brdf, sample, local, frame)), light)

    return by_chunks(one, arrays, local.shape[0])


@checked
def polar_coefficients(
    brdf: BRDF, samples: SurfaceSamples, band_limit: int, polar_nodes: int | None = None
) -> Float[Array, "sample lobe coefficient"]:
    """Integrate each lobe against every harmonic on the same nodes: its radiance under light Y_lm.

    The harmonics at the nodes are the same for all samples in their own frames, so that this is one
    matrix product and a rotation; ``polar_columns`` with the harmonics as light is the slow twin,
    and says what ``polar_nodes=None`` is.
    """
    if polar_nodes is None:
        polar_nodes = polar_nodes_for(brdf)
        found = polar_coefficients(brdf, samples, band_limit, polar_nodes)
        return refuse_narrow(brdf, polar_nodes, found)
    arrays = _as_arrays(samples)
    local, solid_angle = _polar_rule(polar_nodes, arrays.normals.dtype)
    harmonics = real_basis(local, band_limit) * solid_angle[:, None]

    def one(sample: SurfaceSamples) -> Float[Array, "lobe coefficient"]:
        frame = incidence_frame(sample)
        own = _sum(brdf.transfer(*_seen_by(brdf, sample, local, frame)), harmonics)
        return rotate(own.T, frame).T

    return by_chunks(one, arrays, local.shape[0])


def _seen_by(
    brdf: BRDF,
    sample: SurfaceSamples,
    local: Float[Array, "node 3"],
    incidence: Float[Array, "3 3"],
) -> tuple[Components, Components]:
    """Turn nodes about the normal from the plane of incidence to where the surface's tangent is.

    An isotropic BRDF has none: its nodes stay the same for all samples, and so does all that it
    makes of them alone.
    """
    if not _may_have_tangent(brdf):
        return Components.of(local), Components.of(sample.outgoing).in_frame(incidence)
    own = meridian_frames(sample.normals)
    outgoing = Components.of(sample.outgoing).in_frame(own)
    cosine, sine = incidence[:, 0] @ own[:, 0], incidence[:, 0] @ own[:, 1]
    x, y, z = local.T
    return Components(cosine * x - sine * y, sine * x + cosine * y, z), outgoing


def _may_have_tangent(brdf: BRDF) -> bool:
    """Whether turning both directions may change something: where numbers are traced it may."""
    try:
        return not brdf.isotropic
    except (jax.errors.ConcretizationTypeError, jax.errors.TracerArrayConversionError):
        return True


def _polar_rule(polar_nodes: int, dtype) -> tuple[Float[Array, "node 3"], Float[Array, "node"]]:
    """Directions about the normal, R at azimuth 0, with their solid angles."""
    cosines, weights = np.polynomial.legendre.leggauss(polar_nodes)
    cosines, weights = (cosines + 1) / 2, weights / 2
    step = np.pi / polar_nodes
    u = (np.arange(2 * polar_nodes) + 0.5) * step - np.pi
    azimuth = 2 * np.arctan(_CROWDING * np.tan(u / 2))
    density = _CROWDING / (np.cos(u / 2) ** 2 + (_CROWDING * np.sin(u / 2)) ** 2)
    sines = np.sqrt(1 - cosines**2)[:, None]
    # R lies at azimuth 0: towards -x of a frame whose +x holds the outgoing direction.
    local = np.stack(
        [
            -sines * np.cos(azimuth),
            sines * np.sin(azimuth),
            np.broadcast_to(cosines[:, None], (polar_nodes, 2 * polar_nodes)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    solid_angle = np.outer(weights, density * step).ravel()
    return jnp.asarray(local, dtype), jnp.asarray(solid_angle, dtype)


@checked
def radiance(
    brdf: BRDF, columns: Float[Array, "sample lobe channel"]
) -> Float[Array, "sample channel"]:
    """Combine the columns of any model with the BRDF's amplitudes into radiance."""
    amplitudes = jnp.asarray(brdf.amplitudes, columns.dtype)
    return jnp.einsum("skc,kc->sc", columns, amplitudes, precision="highest")


def _sum_over_nodes(
    brdf: BRDF, sample: SurfaceSamples, nodes: LightNodes, seen: Bool[Array, "node"] | None
) -> Float[Array, "lobe channel"]:
    frame = meridian_frames(sample.normals)
    outgoing = Components.of(sample.outgoing)

    def part(some: tuple) -> Float[Array, "lobe channel"]:
        directions, irradiance, seen = some
        lobes = brdf.transfer(*pair_in_frame(directions, outgoing, frame))
        if seen is not None:
            lobes = tuple(jnp.where(seen, lobe, 0) for lobe in lobes)
        return _sum(lobes, irradiance.T)

    # Components in rows of their own: slices of rows of three would be gathered number by number.
    every = (Components.of(nodes.directions), jnp.asarray(nodes.irradiance).T, seen)
    count = nodes.directions.shape[0]
    if count <= _MOST_NODES_AT_ONCE:
        return part(every)
    # The last block is filled up with dark nodes: so ``part`` is compiled once.
    blocks, size = even(count, _NODES_PER_BLOCK)
    directions, *rest = every
    filled = (_filled(directions, blocks * size, "edge"), *_filled(rest, blocks * size, "constant"))
    split = jax.tree.map(
        lambda a: jnp.moveaxis(a.reshape(*a.shape[:-1], blocks, size), -2, 0), filled
    )
    return jnp.sum(jax.lax.map(part, split), axis=0)


def _filled(rows: Any, count: int, mode: str) -> Any:
    """Make the last axis of all arrays ``count`` long."""

    def longer(row: Array) -> Array:
        return jnp.pad(row, [(0, 0)] * (row.ndim - 1) + [(0, count - row.shape[-1])], mode)

    return jax.tree.map(longer, rows)


def _sum(
    lobes: tuple[Float[Array, "node"], ...], weights: Float[Array, "node channel"]
) -> Float[Array, "lobe channel"]:
    return jnp.stack([jnp.matmul(lobe, weights, precision="highest") for lobe in lobes])


def incidence_frame(sample: SurfaceSamples) -> Float[Array, "3 3"]:
    """Build a frame about the normal whose x axis holds the outgoing direction."""
    frame = world_from_local(sample.normals)
    local = jnp.matmul(sample.outgoing, frame, precision="highest")
    squared_length = local[0] ** 2 + local[1] ** 2
    head_on = squared_length < _HEAD_ON**2
    # The root of zero has no derivative, so there it is not taken.
    scale = jnp.sqrt(jnp.where(head_on, 1, squared_length))
    cosine = jnp.where(head_on, 1, local[0] / scale)
    sine = jnp.where(head_on, 0, local[1] / scale)
    x = cosine * frame[:, 0] + sine * frame[:, 1]
    y = cosine * frame[:, 1] - sine * frame[:, 0]
    return jnp.stack([x, y, frame[:, 2]], axis=1)


def as_widths(widths: Float[AnyArray, "sample"] | None) -> Float[Array, "sample"] | None:
    """Take the widths for an array, if there are any."""
    return None if widths is None else jnp.asarray(widths)


def with_width(brdf: BRDF, width: Float[Array, ""] | None) -> BRDF:
    """Make the BRDF of one sample; None: it is that of all."""
    if width is None:
        return brdf
    if not isinstance(brdf, Parametric):
        raise ValueError("only a parametric BRDF has a width: leave widths out")
    return brdf.with_roughness(width, brdf.mu)


def by_chunks(one: Callable, samples, nodes: int) -> Float[Array, "sample *rest"]:
    """Work samples off, so many at once that their nodes stay in a processor's cache."""
    return in_batches(one, samples, _PAIRS_PER_CHUNK // max(nodes, 1))


def _at_once(nodes: int) -> int:
    """How many nodes of a sum a sample works on at once."""
    return nodes if nodes <= _MOST_NODES_AT_ONCE else _NODES_PER_BLOCK


def _mask(visible: Bool[AnyArray, "sample node"] | None) -> Bool[Array, "sample node"] | None:
    return None if visible is None else jnp.asarray(visible)


def _as_arrays(samples: SurfaceSamples) -> SurfaceSamples:
    return SurfaceSamples(jnp.asarray(samples.normals), jnp.asarray(samples.outgoing))
