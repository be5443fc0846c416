"""Coefficients in the order of their importance, and what stopping early leaves out (L 9.1).

Importance is the norm of a coefficient over its channels.  After the first k of N,

    rms error   = sqrt(sum of the squares of the rest)         exact for orthonormal wavelets
    |error(q)| <= sum over levels l and selectors nu of W_{l,nu} max over the rest of |f_j|

with W_{l,nu} = product over axes of max over x of sum over m |Gamma_{l,m,nu[a]}(x)|, since a point
is in the support of few places of a level: for Haar of one.  The bound holds for every wavelet.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from jaxrender.shapes import Float, Int
from jaxrender.wavelets.supports import overlaps
from jaxrender.wavelets.tree import CoefficientTree


class Importance(NamedTuple):
    """The order of a tree's values, and the errors left after the first 0, 1, .. N of them."""

    order: Int[np.ndarray, "value"]
    rms: Float[np.ndarray, "kept"]
    """Root mean square of the error's norm over channels; exact if the wavelet is orthonormal."""
    bound: Float[np.ndarray, "kept"]
    """The error's norm over channels is nowhere larger."""

    def within(self, bound: float) -> int:
        """Count the coefficients after which the error is nowhere above ``bound``."""
        return int(np.argmax(self.bound <= bound))


def importance(tree: CoefficientTree) -> Importance:
    """Rank the coefficients of a tree; the root's is always kept."""
    entries = tree.entries()
    norms = np.linalg.norm(np.asarray(entries.values, float), axis=1)
    order = np.argsort(-norms, kind="stable")
    norms = norms[order]
    squares = np.concatenate([np.cumsum(norms[::-1] ** 2)[::-1], [0.0]])
    weights = overlaps(tree.wavelet, tree.size, tree.axes)
    group = (entries.level << tree.axes) + entries.selector
    bound = _bound(norms, weights.ravel()[group[order]], group[order])
    return Importance(order, np.sqrt(squares), bound)


def most_important(tree: CoefficientTree, count: int) -> CoefficientTree:
    """Keep so many of the tree's values, the most important ones, besides the root.

    Raises ``ValueError`` for a negative count.
    """
    if count < 0:
        raise ValueError(f"{count} coefficients to keep; give 0 or more")
    entries = tree.entries()
    held = np.sort(importance(tree).order[:count])
    smaller = CoefficientTree.of_entries(
        tree.wavelet,
        tree.size,
        tree.axes,
        entries.chosen(held),
        tree.root,
    )
    return dataclasses.replace(smaller, offset=tree.offset)


def _bound(
    norms: Float[np.ndarray, "value"],
    weights: Float[np.ndarray, "value"],
    group: Int[np.ndarray, "value"],
) -> Float[np.ndarray, "kept"]:
    """Sum, over groups, the largest norm that is left: that of the group's next one."""
    by_group = np.argsort(group, kind="stable")
    last = np.append(np.diff(group[by_group]) != 0, True)
    following = np.where(last, 0.0, np.append((norms * weights)[by_group][1:], 0.0))
    # Passing one of a group lowers the group's share to the next one's; after the last all is 0.
    drop = np.zeros(len(norms))
    drop[by_group] = (norms * weights)[by_group] - following
    return np.append(np.cumsum(drop[::-1])[::-1], 0.0)
