"""What a model reflects to each sample, by the cell of a table that each pair of directions meets.

A corrected radiance is linear in the factor at the table's nodes:

    B_sc = sum over nodes k of A_sck F_ck,
    A_sck = sum over the light's directions w of rho_c(w, w_o) cos t E_c(w) h_k(w, w_o),

with h_k the weight of node k in linear interpolation.  All h_k add up to 1: the sum of A over k is
what the model reflects by itself.
"""

from collections.abc import Iterator
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.brdf.tables.isotropic import corners, half_difference
from jaxrender.geometry import Components, meridian_frames
from jaxrender.inverse.models import ExactModel
from jaxrender.programs import stored
from jaxrender.reflection import FrameNodes
from jaxrender.shapes import AnyArray, Array, Bool, Float

# Pairs of a sample and a direction of light that are worked on at once.
_PAIRS = 2**17


class _Block(NamedTuple):
    """Some samples and all the light of one part, in the world's axes."""

    frames: Float[AnyArray, "sample 3 3"]
    outgoing: Float[AnyArray, "sample 3"]
    directions: Float[AnyArray, "sample node 3"]
    irradiance: Float[AnyArray, "sample node channel"]


def cell_sums(
    exact: ExactModel, shape: tuple[int, int, int]
) -> Float[np.ndarray, "sample channel cell"]:
    """Integrate the material of an exact model, amplitudes and all, cell by cell.

    ``shape`` are the nodes of theta_h, theta_d and phi_d, as ``IsotropicTable`` has them.
    """
    like = np.zeros(shape)
    total = 0.0
    seen = exact.seen or [None] * len(exact.nodes)
    for nodes, some_seen in zip(exact.nodes, seen):
        blocks = [
            np.asarray(_sums(exact.variant, like, block))[:count]
            for block, count in _blocks(exact, nodes, some_seen)
        ]
        total = total + np.concatenate(blocks)
    return np.asarray(total, float)


def _blocks(
    exact: ExactModel, nodes, seen: Bool[AnyArray, "sample node"] | None
) -> Iterator[tuple[_Block, int]]:
    """Cut samples into blocks of one size; the last is filled up by repeating its first sample."""
    normals, outgoing = (np.asarray(part, float) for part in exact.samples)
    frames = np.asarray(meridian_frames(jnp.asarray(normals)), float)
    directions, irradiance = (np.asarray(part, float) for part in nodes[:2])
    size = max(1, _PAIRS // directions.shape[-2])
    size = min(size, len(normals))
    for first in range(0, len(normals), size):
        rows = np.arange(first, min(first + size, len(normals)))
        count = len(rows)
        rows = np.concatenate([rows, np.full(size - count, first)])
        if isinstance(nodes, FrameNodes):
            at = np.asarray(nodes.frame_of_sample)[rows]
            towards, energy = directions[at], irradiance[at]
        else:
            towards = np.broadcast_to(directions, (size, *directions.shape))
            energy = np.broadcast_to(irradiance, (size, *irradiance.shape))
        if seen is not None:
            energy = energy * np.asarray(seen)[rows][..., None]
        yield _Block(frames[rows], outgoing[rows], towards, energy), count


@stored(effort="less")
def _sums(
    brdf: BRDF, like: Float[AnyArray, "theta_h theta_d phi_d"], block: _Block
) -> Float[Array, "sample channel cell"]:
    """Add up one block."""
    directions = jnp.asarray(block.directions)
    local = jnp.einsum("sni,sij->snj", directions, block.frames, precision="highest")
    leaving = jnp.einsum("si,sij->sj", block.outgoing, block.frames, precision="highest")
    incoming = Components.of(local)
    outgoing = Components.of(jnp.broadcast_to(leaving[:, None], local.shape))
    lobes = jnp.stack(brdf.transfer(incoming, outgoing), axis=-1)
    values = jnp.einsum(
        "snk,kc->snc", lobes, jnp.asarray(brdf.amplitudes, lobes.dtype), precision="highest"
    )
    values = values * block.irradiance
    samples, size = local.shape[0], like.size
    rows = jnp.arange(samples)[:, None]
    found = jnp.zeros((samples, size, values.shape[-1]), values.dtype)
    for corner in corners(like.shape, half_difference(incoming, outgoing)):
        found = found.at[rows, corner.index].add(corner.weight[..., None] * values)
    return jnp.moveaxis(found, -1, 1)
