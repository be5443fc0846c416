"""Arithmetic of coefficient trees without leaving the wavelet domain (L 7.1, 7.6, 7.7).

Coefficients are linear in the function, so sums and multiples are those of the coefficients; and
they do not know the number of samples, so that a finer resolution needs nothing (L 7.1) and a
coarser one leaves levels out.  Values may be traced: ``jit`` and ``grad`` go through all of it.
"""

import dataclasses
import functools
import operator
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.shapes import AnyArray, Float
from jaxrender.wavelets.nodes import Entries
from jaxrender.wavelets.tree import CoefficientTree

Weights = Sequence[float | Float[AnyArray, ""]] | Float[AnyArray, "tree"]


def weighted_sum(trees: Sequence[CoefficientTree], weights: Weights) -> CoefficientTree:
    """Add up multiples of trees of one wavelet, size and number of channels.

    Coefficients that cancel exactly are kept as zeros.  Raises ``ValueError`` for no tree, another
    number of weights, and trees that differ in more than coefficients.
    """
    if not trees or len(trees) != len(weights):
        raise ValueError(f"{len(trees)} trees and {len(weights)} weights; give one for each")
    first = trees[0]
    for tree in trees[1:]:
        _refuse_unlike(first, tree)
    lists = [tree.entries() for tree in trees]
    roots = [weight * tree.root for tree, weight in zip(trees, weights)]
    values = [weight * entries.values for entries, weight in zip(lists, weights)]
    known = all(isinstance(part, np.ndarray) for part in values)
    joined = Entries(
        np.concatenate([entries.level for entries in lists]),
        np.concatenate([entries.code for entries in lists]),
        np.concatenate([entries.selector for entries in lists]),
        np.concatenate(values) if known else jnp.concatenate(values),
    )
    root = functools.reduce(operator.add, roots)
    total = CoefficientTree.of_entries(first.wavelet, first.size, first.axes, joined, root)
    return dataclasses.replace(total, offset=first.offset)


def scaled(tree: CoefficientTree, factor: float | Float[AnyArray, "*channel"]) -> CoefficientTree:
    """Multiply a tree by a number, or each channel by its own."""
    if not isinstance(factor, jax.Array):
        factor = np.asarray(factor, tree.values.dtype)
    row = factor.reshape(1, -1)
    return dataclasses.replace(tree, root=tree.root * row[0], values=tree.values * row)


def resampled(tree: CoefficientTree, size: int) -> CoefficientTree:
    """Give a tree another number of samples along each axis.

    A finer one has the same coefficients, and is the same function if Haar's or the linear
    spline's; a coarser one loses the levels that it has no room for.  Raises ``ValueError`` for a
    size that is no power of two.
    """
    if size >= tree.size:
        return dataclasses.replace(tree, size=size)
    entries = tree.entries()
    held = entries.level < size.bit_length() - 1
    coarse = CoefficientTree.of_entries(
        tree.wavelet,
        size,
        tree.axes,
        entries.chosen(held),
        tree.root,
    )
    return dataclasses.replace(coarse, offset=tree.offset)


def _refuse_unlike(first: CoefficientTree, other: CoefficientTree):
    for name, what in (
        ("wavelet", "wavelets"),
        ("size", "sizes; resample one of them"),
        ("axes", "numbers of axes"),
        ("channels", "numbers of channels"),
        ("offset", "places of their samples"),
    ):
        mine, theirs = getattr(first, name), getattr(other, name)
        if mine != theirs:
            mine, theirs = (getattr(v, "name", v) for v in (mine, theirs))
            raise ValueError(f"trees of different {what}: {mine} and {theirs}")
