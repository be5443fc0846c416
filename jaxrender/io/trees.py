"""Coefficient trees as NetCDF files of named arrays, to be used without us.

``child_mask`` and ``value_mask`` [node] are 16 bits each, ``values`` [value, channel] and ``root``
[channel] the coefficients; levels and places follow from the masks.  All else is attributes, with a
sentence for each convention (``tree_layout``).
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.io.netcdf import Group, Reader, Variable, opened, write
from jaxrender.io.tree_layout import (
    FORMAT,
    MOST_BITS,
    MOST_CHANNELS,
    MOST_NODES,
    MOST_NUMBERS,
    NODE_ARRAYS,
    TreeAbout,
    attributes,
    fault_of,
    wavelet_of,
)
from jaxrender.wavelets import CoefficientTree, Structure, Wavelet

_PRECISIONS = (np.float32, np.float64)
_CHILDREN, _SELECTORS = "places of a node's children", "selectors of a node's coefficients"


class TreeFile(NamedTuple):
    """A tree, and what it was made from."""

    tree: CoefficientTree
    about: TreeAbout


def write_tree(
    path: str | Path, tree: CoefficientTree, about: TreeAbout, precision: type = np.float32
) -> None:
    """Write a tree, whole or not at all; its numbers in float32 unless asked for float64.

    Raises ``InputError`` where the folder is missing, ``ValueError`` for another precision, numbers
    that are not finite in it, more than a file may hold, a wavelet that files have no name for and
    a description that does not go with the tree.
    """
    path = Path(path)
    if precision not in _PRECISIONS:
        raise ValueError(f"precision={precision}: choose numpy.float32 or numpy.float64")
    with np.errstate(over="ignore"):
        root, values = (np.asarray(a).astype(precision) for a in (tree.root, tree.values))
    if not (np.isfinite(root).all() and np.isfinite(values).all()):
        raise ValueError(f"{path}: coefficients are not finite as {precision.__name__}")
    structure = tree.structure
    if len(structure) > MOST_NODES or values.size > MOST_NUMBERS:
        raise ValueError(f"{len(structure):,} nodes, {values.size:,} numbers: threshold more")
    if wavelet_of(tree.wavelet.name) != tree.wavelet:
        raise ValueError(f"wavelet {tree.wavelet.name!r} has no name in files; use one that has")
    fault = fault_of(about, tree)
    if fault is not None:
        raise ValueError(f"{path}: {fault}")
    units = about.units
    variables = {
        "child_mask": Variable(("node",), structure.child_masks.astype(np.uint16), "1", _CHILDREN),
        "value_mask": Variable(("node",), structure.value_masks.astype(np.uint16), "1", _SELECTORS),
        "root": Variable(("channel",), root, units, "mean of the function"),
    }
    if len(values):
        variables["values"] = Variable(("value", "channel"), values, units, "coefficients")
    if about.wavelengths:
        lengths = np.array(about.wavelengths, float)
        variables["wavelength"] = Variable(("channel",), lengths, "nm", "wavelength of a channel")
    write(path, FORMAT, Group(variables, attributes(tree, about)))


def read_tree(path: str | Path) -> TreeFile:
    """Read a tree and what it was made from, as ``write_tree`` wrote them.

    Raises ``InputError`` for a file that is missing, damaged, too large, or something else.
    """
    with opened(path, FORMAT) as file:
        wavelet, size, axes = _cube(file)
        root = file.array("root", ("channel",), _PRECISIONS, MOST_CHANNELS, finite=True)
        children, selectors = (
            file.array(name, ("node",), (np.uint16,), MOST_NODES).astype(np.int64)
            for name in NODE_ARRAYS
        )
        _refuse_deeper(file, children, size.bit_length() - 1)
        values, wavelengths = np.zeros((0, len(root)), root.dtype), ()
        if "values" in file:
            dimensions = ("value", "channel")
            values = file.array("values", dimensions, _PRECISIONS, MOST_NUMBERS, finite=True)
        if "wavelength" in file:
            found = file.array("wavelength", ("channel",), _PRECISIONS, MOST_CHANNELS, finite=True)
            wavelengths = tuple(found.tolist())
        names = tuple(file.attribute("axis_names").split())
        older = {} if "value_transform" in file.attributes else {"value_transform": "none"}
        about = file.record(TreeAbout, axis_names=names, wavelengths=wavelengths, **older)
        offset = file.attribute("offset", float)
        if not 0 <= offset <= 1:
            file.refuse(f"`offset` is {offset}; wanted 0 to 1")
        if root.dtype != values.dtype:
            file.refuse(f"`root` is {root.dtype}, `values` {values.dtype}")
        try:
            structure = Structure(children, selectors, axes)
            tree = CoefficientTree(wavelet, size, structure, root, values, offset)
        except ValueError as error:
            file.refuse(str(error))
        fault = fault_of(about, tree)
        if fault is not None:
            file.refuse(fault)
    return TreeFile(tree, about)


def _cube(file: Reader) -> tuple[Wavelet, int, int]:
    """Find wavelet, size and number of axes, before anything of that size is made."""
    name = file.attribute("wavelet")
    wavelet = wavelet_of(name)
    if wavelet is None:
        file.refuse(f"no wavelet is named {name!r}")
    size, axes = (file.attribute(word, int) for word in ("size", "axes"))
    if size < 1 or size & (size - 1):
        file.refuse(f"`size` is {size}, no power of two")
    if not 1 <= axes <= 4:
        file.refuse(f"`axes` is {axes}; wanted 1 to 4")
    if axes * size.bit_length() > MOST_BITS:
        file.refuse(
            f"`size` is {size} along {axes} axes, and {MOST_BITS} bits tell a place",
            "give fewer samples",
        )
    return wavelet, size, axes


def _refuse_deeper(file: Reader, child_masks: np.ndarray, levels: int) -> None:
    """Go down level by level, no further than there are levels, whatever the masks say."""
    counts = np.bitwise_count(child_masks).astype(np.int64)
    start, stop = 0, 1
    for _ in range(max(levels, 1)):
        start, stop = stop, stop + int(counts[start:stop].sum())
    if stop > start and stop <= len(counts):
        file.refuse(
            f"`child_mask` of node {start} is at level {max(levels, 1)}, and the size has {levels}"
        )
