"""Errors of sites whose chi-squared has several minima, all of which the photographs allow.

The curvature at the best of them tells the error about that one alone.  Ends of searches from
several starts are minima k, which differ, of chi-squared c_k and matrix M_k.  By Laplace's method

    w_k  ~  exp(-c_k / 2) / sqrt(det M_k)

is how likely each is, and the covariance about the best, x_0, is

    sum_k w_k (M_k^-1 + (x_k - x_0) (x_k - x_0)').
"""

from collections.abc import Sequence

import jax
import numpy as np

from jaxrender.inverse.texture.coloured_sites import KsPrior
from jaxrender.inverse.texture.site_solver import Solved
from jaxrender.inverse.texture.site_sums import by_channel
from jaxrender.shapes import Bool, Float, Int

# Ends that differ by less than so many standard deviations are one minimum.
_SAME = 0.5


def joined_minima(
    ends: Sequence[Solved], prior: KsPrior, site: Int[np.ndarray, "sample"]
) -> tuple[Solved, Float[np.ndarray, "site unknown unknown"]]:
    """Keep the best end of every site, with the covariance of all its unknowns.

    An end that has an infinite cost is none.
    """
    amplitudes = prior.amplitudes(ends[0].predicted.shape[1])
    minima = [
        (np.array(one.local.cost), _point(one, amplitudes), np.array(one.local.matrix))
        for one in ends
    ]
    which = np.argmin([cost for cost, _, _ in minima], axis=0)
    best = Solved(*jax.tree.map(np.copy, ends[0]))
    for number, other in enumerate(ends[1:], 1):
        best.put(which == number, other)
        own = which[site] == number
        best.predicted[own] = other.predicted[own]
    at = _point(best, amplitudes)
    weights, spreads = [], []
    kept: list[tuple[Float[np.ndarray, "site unknown"], Float[np.ndarray, "site unknown unknown"]]]
    kept = []
    for cost, point, matrix in minima:
        inverse = inverses(matrix)
        new = np.isfinite(cost)
        for other, precision in kept:
            new &= ~_alike(point, other, precision)
        kept.append((np.where(new[:, None], point, np.inf), matrix))
        weights.append(np.where(new, -cost / 2 - np.linalg.slogdet(matrix)[1] / 2, -np.inf))
        off = np.where(new[:, None], point - at, 0)
        spreads.append(inverse + off[:, :, None] * off[:, None, :])
    logs = np.stack(weights)
    # Where nothing was seen there is no end, and the first stands for it.
    logs[0] = np.where(np.isfinite(logs).any(axis=0), logs[0], 0)
    logs = logs - np.max(logs, axis=0)
    share = np.exp(logs) / np.sum(np.exp(logs), axis=0)
    return best, np.einsum("ks,ksij->sij", share, np.stack(spreads))


def inverses(matrix: Float[np.ndarray, "site n n"]) -> Float[np.ndarray, "site n n"]:
    """Invert every matrix, scaled to comparable sizes."""
    size = np.sqrt(np.maximum(np.diagonal(matrix, axis1=1, axis2=2), 1e-300))
    scale = size[:, :, None] * size[:, None, :]
    return np.linalg.inv(matrix / scale + 1e-14 * np.eye(matrix.shape[1])) / scale


def _point(end: Solved, amplitudes: int) -> Float[np.ndarray, "site unknown"]:
    """Line up K_d, free K_s and numbers, as the matrix has them."""
    material = end.local.material
    ks = np.asarray(by_channel(np.asarray(material.ks)))[:, :amplitudes]
    return np.concatenate([np.asarray(material.kd), ks, end.value], axis=1)


def _alike(
    one: Float[np.ndarray, "site unknown"],
    other: Float[np.ndarray, "site unknown"],
    precision: Float[np.ndarray, "site unknown unknown"],
) -> Bool[np.ndarray, "site"]:
    """Say where two ends are one minimum; what is infinite is none."""
    off = np.where(np.isfinite(other), one - other, np.inf)
    known = np.asarray(np.all(np.isfinite(off), axis=1))
    off = np.where(known[:, None], off, 0)
    return known & (np.einsum("si,sij,sj->s", off, precision, off) < _SAME**2)
