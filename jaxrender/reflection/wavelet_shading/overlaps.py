"""Integrals and values of the basis functions of one axis, exactly (L 6.3, the paragraph to 6.9).

Between samples a function is what ``wavelets.supports`` says: constant in each cell for Haar's
wavelet, linear from sample to sample for the others.  Its integral from 0 to x is therefore
piecewise linear or quadratic, and is tabulated at the samples; differences of it are the integrals
over any interval, rectangles and trapezoids without error.  A Haar function of the other tree is
constant in each of that tree's cells, so that an overlap integral is a sum over cells.

Host side, float64: sum over levels of 2 x 2^l x cells numbers.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from jaxrender.shapes import Float, Int
from jaxrender.wavelets.filters import Wavelet, haar
from jaxrender.wavelets.supports import functions, is_stepwise
from jaxrender.wavelets.tree import CoefficientTree

Along = Float[np.ndarray, "2 _ sample"]


@lru_cache(maxsize=32)
def both_functions(wavelet: Wavelet, size: int) -> tuple[Along, ...]:
    """Return, for each level, scaling functions and wavelets at all samples.

    A single sample has one level with a wavelet that is 0 everywhere.
    """
    if size == 1:
        return (np.array([[[1.0]], [[0.0]]]),)
    levels = range(size.bit_length() - 1)
    return tuple(np.stack([functions(wavelet, size, level, k) for k in (0, 1)]) for level in levels)


def values_at(tree: CoefficientTree, place: float) -> tuple[Float[np.ndarray, "2 _"], ...]:
    """Evaluate, for each level, all scaling functions and wavelets at a place of [0, 1]."""
    sample, fraction = _between(tree, np.array([place]))
    following = np.minimum(sample + 1, tree.size - 1)
    return tuple(
        (table[..., sample] * (1 - fraction) + table[..., following] * fraction)[..., 0]
        for table in both_functions(tree.wavelet, tree.size)
    )


def cell_integrals(tree: CoefficientTree, cells: int) -> tuple[Float[np.ndarray, "2 _ cell"], ...]:
    """Integrate, for each level, all scaling functions and wavelets over equal cells of [0, 1].

    Raises ``ValueError`` unless there is a cell.
    """
    if cells < 1:
        raise ValueError(f"{cells} cells of the unit interval; give at least one")
    return _cell_integrals(tree.wavelet, tree.size, tree.offset, cells)


def haar_overlaps(
    tree: CoefficientTree, cells: int
) -> tuple[tuple[Float[np.ndarray, "2 _ 2 _"], ...], ...]:
    """Integrate all functions of a tree's axis times all of a Haar tree's with so many cells.

    Indexed [level][level of the Haar tree][kind, place, kind, place]: the tables of L 6.9.
    """
    others = both_functions(haar(), cells)
    return tuple(
        tuple(np.einsum("kpc,jqc->kpjq", own, other, optimize=True) for other in others)
        for own in cell_integrals(tree, cells)
    )


def check_trees(light: CoefficientTree, brdf: CoefficientTree):
    """Raise ``ValueError`` unless both have four axes, fitting channels, and light is Haar's."""
    for name, tree in (("radiance", light), ("BRDF", brdf)):
        if tree.axes != 4:
            raise ValueError(f"the {name} has {tree.axes} axes; two for each of its ends make four")
    if light.wavelet.name != "haar":
        raise ValueError(
            f"the radiance is in {light.wavelet.name}; overlaps are tabulated for Haar's wavelet, "
            "analyse it with that one"
        )
    if light.channels != brdf.channels and 1 not in (light.channels, brdf.channels):
        raise ValueError(
            f"{light.channels} channels of radiance and {brdf.channels} of the BRDF; give equal "
            "numbers, or one of either"
        )


@lru_cache(maxsize=32)
def _cell_integrals(
    wavelet: Wavelet, size: int, offset: float, cells: int
) -> tuple[Float[np.ndarray, "2 _ cell"], ...]:
    ends = np.arange(cells + 1) / cells
    integral = _of_steps if is_stepwise(wavelet) or size == 1 else _of_lines
    return tuple(
        np.diff(integral(table, offset, ends), axis=-1) for table in both_functions(wavelet, size)
    )


def _of_steps(table: Along, offset: float, ends: Float[np.ndarray, "end"]) -> np.ndarray:
    """Integrate from 0: constant in each cell, wherever samples are said to stand."""
    size = table.shape[-1]
    cell = np.minimum((ends * size).astype(int), size - 1)
    before = np.cumsum(table, axis=-1) - table
    return (before[..., cell] + table[..., cell] * (ends * size - cell)) / size


def _of_lines(table: Along, offset: float, ends: Float[np.ndarray, "end"]) -> np.ndarray:
    """Integrate from 0: linear between samples, constant before the first and after the last."""
    size = table.shape[-1]
    trapezoids = (table[..., 1:] + table[..., :-1]) / 2
    before = np.cumsum(trapezoids, axis=-1) - trapezoids
    place = np.clip((ends - offset) * size, 0, size - 1)
    sample = np.minimum(place.astype(int), size - 2)
    part = place - sample
    here, there = table[..., sample], table[..., sample + 1]
    between = (before[..., sample] + here * part + (there - here) * part**2 / 2) / size
    ahead = table[..., :1] * np.minimum(ends, offset)
    last = offset + (size - 1) / size
    return ahead + between + table[..., -1:] * np.maximum(ends - last, 0)


def _between(
    tree: CoefficientTree, places: Float[np.ndarray, "*any"]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the sample at or before each place, and how far the next one is on its way."""
    if is_stepwise(tree.wavelet):
        cell = np.clip(np.floor(places * tree.size), 0, tree.size - 1)
        return cell.astype(np.int64), np.zeros_like(places)
    place = np.clip((places - tree.offset) * tree.size, 0, tree.size - 1)
    sample = np.clip(np.floor(place), 0, max(tree.size - 2, 0)).astype(np.int64)
    return sample, place - sample


class Taps(NamedTuple):
    """The samples along two axes whose weighted sum is the value at each place."""

    samples: Int[np.ndarray, "row tap 2"]
    weights: Float[np.ndarray, "row tap"]


def taps(tree: CoefficientTree, places: Float[np.ndarray, "row 2"]) -> Taps:
    """List what makes up the value at each place: one tap for Haar's wavelet, four for others."""
    places = np.asarray(places, float)
    sample, fraction = _between(tree, places)
    if is_stepwise(tree.wavelet):
        return Taps(sample[:, None], np.ones((len(places), 1)))
    steps = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    samples = np.minimum(sample[:, None] + steps, tree.size - 1)
    weights = np.where(steps == 1, fraction[:, None], 1 - fraction[:, None])
    return Taps(samples, weights.prod(axis=-1))
