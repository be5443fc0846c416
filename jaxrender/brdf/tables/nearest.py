"""The table nearest to a given one that is reciprocal, isotropic, separable or conserves energy.

The properties of DeYoung and Fournier, Properties of Tabulated BRDFs (1997), which L 2.1.2 and
3.1.1 refer to.  Nearest is least squares in the projected solid angles of both directions,

    |f|^2 = int int f(w_i, w_r)^2 cos t_i cos t_r dw_i dw_r,

summed over the cells (``cells``) and channels.  The *change* |new - old| / |old| is how far
the old table was from having the property: 0 when it had it.  Cells beyond the horizon have no
weight; they are treated like their neighbours, so that what is interpolated has the property too.

One property does not keep another: the nearest table that conserves energy need not be reciprocal.
Host side, in double precision; values keep their own.
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from scipy.sparse.linalg import svds

from jaxrender.brdf.tables.cells import Table, cell_weights, exchanged
from jaxrender.brdf.tables.tabulated import TabulatedBRDF
from jaxrender.shapes import Float

# Samples that are sorted in one pass: what it needs stays below 100 MB.
_SORTED_AT_ONCE = 2**20


class Nearest(NamedTuple):
    """The nearest table that has the property, and the relative rms change that it took."""

    table: TabulatedBRDF
    change: float


def nearest_reciprocal(table: TabulatedBRDF) -> Nearest:
    """Average the table with its exchange, rho(w_i, w_r) = rho(w_r, w_i).

    Raises ``ValueError`` unless both directions have the same cells.
    """
    if table.size[:2] != table.size[2:]:
        raise ValueError(
            f"size={table.size}: reciprocity compares a direction's cells with the other's; "
            "`resampled` makes them the same"
        )
    values = np.asarray(table.values)
    return _nearest(table, (values + exchanged(values)) / 2)


def nearest_isotropic(table: TabulatedBRDF) -> Nearest:
    """Average over all turns of both directions about the normal, by whole cells.

    Raises ``ValueError`` for an embedding without azimuth and for different numbers of azimuths.
    """
    if not table.embedding.periodic[1]:
        raise ValueError(
            f"the {table.embedding.name} cells don't turn into each other; "
            "`resampled(size, POLAR)` first"
        )
    if table.size[1] != table.size[3]:
        raise ValueError(
            f"{table.size[1]} incident and {table.size[3]} reflected azimuths: a turn by whole "
            "cells needs as many of both; `resampled` makes them so"
        )
    values = np.asarray(table.values, float)
    total = np.zeros_like(values)
    for turn in range(table.size[1]):
        total += np.roll(values, (turn, turn), axis=(1, 3))
    return _nearest(table, total / table.size[1])


def nearest_separable(table: TabulatedBRDF) -> Nearest:
    """Find the product f(w_i) g(w_r) of each channel: the first term of a singular decomposition.

    ``change`` squared is the share of the table's energy that no product has.
    """
    weights_i, weights_r = _weights(table)
    values = np.asarray(table.values, float).reshape(weights_i.size, weights_r.size, -1)
    channels = [
        _product(values[..., channel], weights_i.ravel(), weights_r.ravel())
        for channel in range(values.shape[-1])
    ]
    return _nearest(table, np.stack(channels, axis=-1).reshape(np.shape(table.values)))


def nearest_energy_conserving(table: TabulatedBRDF) -> Nearest:
    """Project on rho >= 0, albedo <= 1 for each incident cell and channel.

    The minimum is max(rho - m, 0) with m = 0 where that conserves energy, and otherwise the m that
    makes the albedo 1: a constant is taken away, which spares narrow peaks; not a scaling.
    """
    weights = _weights(table)[1].ravel()
    values = np.asarray(table.values)
    columns = np.moveaxis(values.reshape(-1, weights.size, values.shape[-1]), 1, -1)
    # A row an incident cell and channel; a few at a time, because each is sorted.
    rows = columns.reshape(-1, weights.size)
    passes = np.array_split(rows, min(rows.size // _SORTED_AT_ONCE + 1, len(rows)))
    projected = np.concatenate([_bounded(some, weights) for some in passes])
    found = np.moveaxis(projected.reshape(columns.shape), -1, 1).reshape(values.shape)
    return _nearest(table, found)


def relative_change(table: TabulatedBRDF, values: Table) -> float:
    """Measure |values - table| / |table|; 0 for a table that is 0 throughout and stays so."""
    weights_i, weights_r = _weights(table)
    old = np.asarray(table.values, float)
    changed, whole = (
        np.einsum("ijklc,ij,kl->", square, weights_i, weights_r, optimize=True)
        for square in ((np.asarray(values) - old) ** 2, old**2)
    )
    return float(np.sqrt(changed / whole)) if changed > 0 else 0.0


def _nearest(table: TabulatedBRDF, values: Float[np.ndarray, "..."]) -> Nearest:
    found = values.astype(table.values.dtype)
    return Nearest(eqx.tree_at(lambda t: t.values, table, found), relative_change(table, found))


def _weights(
    table: TabulatedBRDF,
) -> tuple[Float[np.ndarray, "row column"], Float[np.ndarray, "row column"]]:
    return (
        cell_weights(table.embedding, table.size[:2]),
        cell_weights(table.embedding, table.size[2:]),
    )


def _product(
    matrix: Float[np.ndarray, "incoming outgoing"],
    weights_i: Float[np.ndarray, "incoming"],
    weights_r: Float[np.ndarray, "outgoing"],
) -> Float[np.ndarray, "incoming outgoing"]:
    """Find the best product; cells without weight have the factors that suit the others best."""
    scaled = np.sqrt(weights_i)[:, None] * matrix * np.sqrt(weights_r)
    if min(matrix.shape) == 1 or not scaled.any():
        return matrix
    # What is nowhere negative has a singular vector that is nowhere negative: ones are near it.
    found = svds(scaled, k=1, v0=np.ones(min(scaled.shape)))
    incoming = matrix @ (np.sqrt(weights_r) * np.asarray(found[2])[0])
    outgoing = (weights_i * incoming) @ matrix / (weights_i @ incoming**2)
    return np.outer(incoming, outgoing)


def _bounded(
    rows: Float[np.ndarray, "row cell"], weights: Float[np.ndarray, "cell"]
) -> Float[np.ndarray, "row cell"]:
    """Take from each row the least constant that leaves positive parts of sum at most 1."""
    rows = np.asarray(rows, float)
    order = np.argsort(-rows, axis=1)
    sorted_rows, sorted_weights = np.take_along_axis(rows, order, 1), weights[order]
    share = np.cumsum(sorted_weights, axis=1)
    excess = np.cumsum(sorted_weights * sorted_rows, axis=1) - 1
    # With the k highest kept, the constant is excess / share; it grows until the next would go.
    constants = np.divide(excess, share, out=np.full_like(share, -np.inf), where=share > 0)
    return np.maximum(rows - np.maximum(constants.max(axis=1), 0)[:, None], 0)
