"""The pass itself: samples stream into the sums of :mod:`~jaxrender.inverse.factorization.gram`.

Chunks of fixed size are expanded into columns, sorted by exit cosine, and added bin by bin as
symmetric rank-k updates in place.  Host side, float64; memory does not grow with the samples.
"""

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import get_blas_funcs

from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import coefficient_count, degrees, real_basis
from jaxrender.inverse.factorization.gram import BinnedGram, exit_cosine_nodes
from jaxrender.inverse.lighting.operator import DIFFUSE_BAND_LIMIT
from jaxrender.shapes import AnyArray, Float
from jaxrender.spectra import lambertian_transfer

# Rows worked on at once: 16 MiB of columns at degree 12, a few hundred rows for each bin.
_CHUNK = 8192
(_add_products,) = get_blas_funcs(("syrk",), dtype=np.float64)


class Block(NamedTuple):
    """Some samples: ``weights`` are 1 / standard deviation, of each channel or one for all.

    ``transfer_vectors`` (T 6.10) and ``unshadowed``, V(R), are for concave objects.
    """

    samples: SurfaceSamples
    radiance: Float[AnyArray, "sample channel"]
    weights: Float[AnyArray, "sample weighting"] | None = None
    transfer_vectors: Float[AnyArray, "sample transfer_coefficient"] | None = None
    unshadowed: Float[AnyArray, "sample"] | None = None


def binned_gram(
    blocks: Iterable[Block],
    band_limit: int,
    nodes: Float[np.ndarray, "bin"] | None = None,
    diffuse_band_limit: int = DIFFUSE_BAND_LIMIT,
) -> BinnedGram:
    """Stream samples once, block by block; memory does not grow with their number.

    Samples of weight 0 are left out.  Raises ``ValueError`` for nodes that do not rise to 1, and
    for exit cosines below the first node.  The same holds for numbers that are not finite, negative
    weights, transfer vectors of too few degrees, blocks that differ in kind, and no block at all.
    """
    nodes = exit_cosine_nodes() if nodes is None else np.asarray(nodes, np.float64)
    if len(nodes) < 2 or np.any(np.diff(nodes) <= 0) or nodes[0] <= 0 or nodes[-1] != 1:
        raise ValueError("nodes must rise from above 0 to 1: see exit_cosine_nodes")
    limits = (band_limit, min(diffuse_band_limit, band_limit))
    total: _Sums | None = None
    for block in blocks:
        for chunk in _chunks(block):
            _check(chunk, nodes[0], coefficient_count(limits[1]))
            if total is None:
                total = _Sums.of(chunk, len(nodes), sum(map(coefficient_count, limits)))
            total.add(chunk, nodes, limits)
    if total is None:
        raise ValueError("no samples: give at least one block")
    products, (_, moments, energies, measured) = total.packed(), total
    return BinnedGram(nodes, products, moments, energies, measured, *limits)


class _Sums(NamedTuple):
    """Sums under way, in place; of ``products`` the lower triangle is valid."""

    products: Float[np.ndarray, "bin weighting column column"]
    moments: Float[np.ndarray, "bin column channel"]
    energies: Float[np.ndarray, "bin channel"]
    measured: Float[np.ndarray, "channel"]

    @classmethod
    def of(cls, chunk: Block, bins: int, columns: int) -> "_Sums":
        channels, weightings = chunk.radiance.shape[1], np.asarray(chunk.weights).shape[1]
        shapes = ((weightings, columns, columns), (columns, channels), (channels,))
        products, moments, energies = (np.zeros((bins, *shape)) for shape in shapes)
        return cls(products, moments, energies, np.zeros(channels))

    def add(self, chunk: Block, nodes: Float[np.ndarray, "bin"], limits: tuple[int, int]) -> None:
        """Add a chunk, cell by cell between the nodes."""
        weights, radiance = np.asarray(chunk.weights), np.asarray(chunk.radiance)
        if (self.products.shape[1], self.moments.shape[2]) != (weights.shape[1], radiance.shape[1]):
            raise ValueError("blocks differ in channels or in kind of weights: give all alike")
        self.measured[:] += np.count_nonzero(weights > 0, axis=0)
        cosines = np.minimum(_exit_cosines(chunk), 1)
        cell = np.clip(np.searchsorted(nodes, cosines, side="right") - 1, 0, len(nodes) - 2)
        order = np.argsort(cell, kind="stable")
        upper = ((cosines - nodes[cell]) / np.diff(nodes)[cell])[order, None]
        columns = _columns(chunk, limits)[order]
        weights, radiance = weights[order], radiance[order]
        borders = np.searchsorted(cell[order], np.arange(len(nodes)))
        for lower, (start, stop) in enumerate(pairwise(borders)):
            if start == stop:
                continue
            rows = slice(start, stop)
            for node, hat in ((lower, 1 - upper[rows]), (lower + 1, upper[rows])):
                self._add_at(node, columns[rows], weights[rows] * np.sqrt(hat), radiance[rows])

    def _add_at(self, node: int, columns, weights, radiance) -> None:
        """Add rows to one bin; ``weights`` hold the square root of their share in it."""
        alone = weights.shape[1] > 1
        self.energies[node] += np.sum((weights * radiance) ** 2, axis=0)
        for which, weight in enumerate(weights.T):
            rows = columns * weight[:, None]
            # Symmetric rank-k update, half the work of a product; BLAS sees the transpose.
            _add_products(1.0, rows.T, 1.0, self.products[node, which].T, overwrite_c=True)
            channels = slice(which, which + 1) if alone else slice(None)
            self.moments[node, :, channels] += rows.T @ (weight[:, None] * radiance[:, channels])

    def packed(self) -> Float[np.ndarray, "bin weighting pair"]:
        first, second = np.triu_indices(self.products.shape[-1])
        return np.ascontiguousarray(self.products[:, :, second, first])


def _chunks(block: Block) -> Iterator[Block]:
    """Cut a block into chunks of at most ``_CHUNK`` rows, without those of weight 0."""
    weights = np.ones((len(block.radiance), 1)) if block.weights is None else block.weights
    if weights.shape[1] not in (1, block.radiance.shape[1]):
        raise ValueError(
            f"{weights.shape[1]} weights a sample for {block.radiance.shape[1]} channels: give one "
            "for each channel, or one for all"
        )
    whole = block._replace(weights=weights)
    for start in range(0, len(block.radiance), _CHUNK):
        chunk = _rows_of(whole, slice(start, start + _CHUNK))
        weighed = np.asarray(chunk.weights) != 0
        chunk = chunk._replace(radiance=np.where(weighed, chunk.radiance, 0))
        used = np.any(weighed, axis=1)
        yield chunk if used.all() else _rows_of(chunk, used)


def _rows_of(block: Block, rows: slice | np.ndarray) -> Block:
    return jax.tree.map(lambda array: np.asarray(array[rows], np.float64), block)


def _check(chunk: Block, lowest: float, needed: int) -> None:
    weights, vectors = np.asarray(chunk.weights), chunk.transfer_vectors
    if not np.isfinite(weights).all() or (weights < 0).any():
        raise ValueError("weights must be finite and not negative: give 0 to leave a sample out")
    if not np.isfinite(chunk.radiance).all():
        raise ValueError("the radiance is not finite somewhere: give such samples the weight 0")
    cosines = _exit_cosines(chunk)
    if np.any(cosines < lowest * (1 - 1e-6)):
        raise ValueError(
            f"an exit cosine of {cosines.min():.3g} is below the first node, {lowest:.3g}: leave "
            "such samples out, or give nodes that reach lower"
        )
    if vectors is not None and np.shape(vectors)[1] < needed:
        raise ValueError(
            f"{np.shape(vectors)[1]} transfer coefficients where {needed} are needed: trace more, "
            "or lower diffuse_band_limit"
        )


def _exit_cosines(chunk: Block) -> Float[np.ndarray, "sample"]:
    return np.einsum("sx,sx->s", *map(np.asarray, chunk.samples))


def _columns(chunk: Block, limits: tuple[int, int]) -> Float[np.ndarray, "sample column"]:
    """Expand both parts of every row, the diffuse first."""
    band_limit, diffuse_limit = limits
    count = len(chunk.radiance)
    # One compiled shape serves every chunk, whatever was left out of it.
    full = ((0, _CHUNK - count), (0, 0))
    samples = SurfaceSamples(*(jnp.asarray(np.pad(np.asarray(a), full)) for a in chunk.samples))
    specular = np.asarray(real_basis(samples.reflected, band_limit))[:count]
    if chunk.unshadowed is not None:
        specular = specular * np.asarray(chunk.unshadowed)[:, None]
    if chunk.transfer_vectors is None:
        transfer = lambertian_transfer(diffuse_limit)[degrees(diffuse_limit)]
        diffuse = np.asarray(real_basis(samples.normals, diffuse_limit))[:count] * transfer
    else:
        diffuse = np.asarray(chunk.transfer_vectors)[:, : coefficient_count(diffuse_limit)]
    return np.concatenate([diffuse, specular], axis=1, dtype=np.float64)
