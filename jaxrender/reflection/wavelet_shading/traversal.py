"""Reflected radiance by nested traversal of two coefficient trees (L fig. 6.1): the slow twin.

    L_r(u, v, k_r, l_r) = 4 sum over j, k of f_j b_k G_j(k_r) G_j(l_r) G_k(u) G_k(v)
                            int G_j G_k dkappa  int G_j G_k dlambda                       (L 6.9)

with b_k of the radiance over (u, v, kappa, lambda) and f_j of the BRDF over (kappa, lambda,
kappa_r, lambda_r) (ERRATA 70 has the letters of 6.8 and 6.9 right).  Two recursions, as in the
figure, with bit b of a mask as 1 << b and lambda_r at bit 3 of b (ERRATA 63, 64), a node's support
taken at its own level and with all that its descendants reach, and the mean at the root
(ERRATA 59).  Only pairs are visited whose functions reach the place, the direction, and each other.

Host side, one pixel; ``shading`` does images.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.reflection.wavelet_shading.overlaps import (
    cell_integrals,
    check_trees,
    haar_overlaps,
    values_at,
)
from jaxrender.shapes import AnyArray, Bool, Float
from jaxrender.wavelets.nodes import Structure, separated
from jaxrender.wavelets.tree import CoefficientTree

# Integrals below this part of a level's largest are rounding.
_NOTHING = 1e-13


class Traversed(NamedTuple):
    """What leaves the point, and how many pairs of nodes and of coefficients were visited."""

    radiance: Float[np.ndarray, "channel"]
    nodes: int
    coefficients: int

    def plus(self, other: "Traversed") -> "Traversed":
        """Add what is reflected and what was visited."""
        return Traversed(
            self.radiance + other.radiance,
            self.nodes + other.nodes,
            self.coefficients + other.coefficients,
        )


class _Opened(NamedTuple):
    """A tree with the place of every node, and its values below the root's."""

    structure: Structure
    places: np.ndarray
    root: np.ndarray
    values: np.ndarray

    @classmethod
    def of(cls, tree: CoefficientTree) -> "_Opened":
        structure = tree.structure
        places = separated(structure.code, tree.axes)
        return cls(structure, places, np.asarray(tree.root), np.asarray(tree.values))

    def children(self, node: int) -> list[int]:
        """Follow the child mask."""
        mask = int(self.structure.child_masks[node])
        first = int(self.structure.first_child[node])
        present = [b for b in range(16) if mask & (1 << b)]
        return [first + row for row in range(len(present))]

    def coefficients(self, node: int) -> list[tuple[int, np.ndarray]]:
        """List selectors and values, the root's mean as selector 0."""
        mask = int(self.structure.value_masks[node])
        row = int(self.structure.first_value[node])
        present = [b for b in range(1, 16) if mask & (1 << b)]
        held = [(b, self.values[row + i]) for i, b in enumerate(present)]
        return [(0, self.root), *held] if node == 0 else held


class _Axis(NamedTuple):
    """A variable that is fixed: for each level the functions' values, and who reaches it."""

    values: tuple[np.ndarray, ...]
    reached: tuple[np.ndarray, ...]

    @classmethod
    def at(cls, tree: CoefficientTree, place: float) -> "_Axis":
        values = values_at(tree, place)
        return cls(values, _with_descendants([np.abs(v).max(axis=0) for v in values]))


class _Pixel(NamedTuple):
    """All that the recursions look things up in."""

    light: _Opened
    brdf: _Opened
    position: dict[int, _Axis]
    """By the number of the radiance's axis: u and v."""
    reflected: dict[int, _Axis]
    """By the number of the BRDF's axis: kappa_r and lambda_r."""
    overlaps: tuple[tuple[np.ndarray, ...], ...]
    touched: tuple[np.ndarray, ...]
    """For each level of the BRDF, which of the radiance's cells a node or its descendants touch."""


def traverse(
    light: CoefficientTree,
    brdf: CoefficientTree,
    place: Float[AnyArray, "2"],
    direction: Float[AnyArray, "2"],
) -> Traversed:
    """Reflect the radiance that arrives at ``place`` (u, v) towards ``direction`` (k_r, l_r).

    Raises ``ValueError`` as ``wavelet_overlaps.check_trees`` does.
    """
    check_trees(light, brdf)
    place, direction = np.asarray(place, float), np.asarray(direction, float)
    pixel = _Pixel(
        _Opened.of(light),
        _Opened.of(brdf),
        {0: _Axis.at(light, place[0]), 1: _Axis.at(light, place[1])},
        {2: _Axis.at(brdf, direction[0]), 3: _Axis.at(brdf, direction[1])},
        haar_overlaps(brdf, light.size),
        _with_descendants([np.abs(c).max(axis=0) for c in cell_integrals(brdf, light.size)]),
    )
    found = _over_radiance(pixel, 0)
    channels = max(light.channels, brdf.channels)
    return found._replace(radiance=np.broadcast_to(4 * found.radiance, channels))


def _over_radiance(pixel: _Pixel, node: int) -> Traversed:
    """RadTraverse: nodes of the radiance whose support has the point in it."""
    total = _over_brdf(pixel, node, 0)
    for child in pixel.light.children(node):
        level = pixel.light.structure.level[child]
        u, v = pixel.light.places[child, :2]
        if pixel.position[0].reached[level][u] and pixel.position[1].reached[level][v]:
            total = total.plus(_over_radiance(pixel, child))
    return total


def _over_brdf(pixel: _Pixel, light_node: int, node: int) -> Traversed:
    """BRDFTraverse: nodes of the BRDF that reach the direction, and overlap with the radiance's."""
    if not _overlap(pixel, light_node, node):
        return Traversed(np.zeros(1), 0, 0)
    total = _integrate(pixel, light_node, node)
    for child in pixel.brdf.children(node):
        level = pixel.brdf.structure.level[child]
        kappa, lambda_ = pixel.brdf.places[child, 2:]
        in_kappa, in_lambda = (pixel.reflected[axis].reached[level] for axis in (2, 3))
        if in_kappa[kappa] and in_lambda[lambda_]:
            total = total.plus(_over_brdf(pixel, light_node, child))
    return total


def _overlap(pixel: _Pixel, light_node: int, node: int) -> bool:
    """Whether the two, or descendants of the BRDF's, overlap in kappa and in lambda."""
    touched = pixel.touched[pixel.brdf.structure.level[node]]
    width = touched.shape[1] >> pixel.light.structure.level[light_node]
    places = zip(pixel.brdf.places[node, :2], pixel.light.places[light_node, 2:])
    return all(touched[own, width * other : width * (other + 1)].any() for own, other in places)


def _integrate(pixel: _Pixel, light_node: int, node: int) -> Traversed:
    """Sum what L 6.9 has for all coefficients of two nodes."""
    level, other = pixel.brdf.structure.level[node], pixel.light.structure.level[light_node]
    reflecting, held = _with_two_held(pixel.brdf, node, pixel.reflected)
    arriving, met = _with_two_held(pixel.light, light_node, pixel.position)
    own, others = pixel.brdf.places[node, :2], pixel.light.places[light_node, 2:]
    kappa, lambda_ = (
        pixel.overlaps[level][other][:, m, :, n] for m, n in zip(own, others, strict=True)
    )
    total = np.einsum("klc,ijc,ki,lj->c", reflecting, arriving, kappa, lambda_)
    return Traversed(total, 1, held * met)


def _with_two_held(tree: _Opened, node: int, held: dict[int, _Axis]) -> tuple[np.ndarray, int]:
    """Sum a node's coefficients by the kinds of the two free axes, [kind, kind, channel]."""
    level, places = tree.structure.level[node], tree.places[node]
    free = [axis for axis in range(4) if axis not in held]
    total = np.zeros((2, 2, len(tree.root)))
    coefficients = tree.coefficients(node)
    for nu, value in coefficients:
        bit = [(nu >> axis) & 1 for axis in range(4)]
        first, second = (
            along.values[level][bit[axis], places[axis]] for axis, along in held.items()
        )
        total[bit[free[0]], bit[free[1]]] += value * first * second
    return total, len(coefficients)


def _with_descendants(sizes: list[np.ndarray]) -> tuple[Bool[np.ndarray, "place *any"], ...]:
    """Say, for each level, where functions are not zero, or those of finer levels below."""
    found: list[np.ndarray] = []
    for size in reversed(sizes):
        own = size > _NOTHING * size.max()
        found.append(own | found[-1][0::2] | found[-1][1::2] if found else own)
    return tuple(reversed(found))
