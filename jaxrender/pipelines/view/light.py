"""The light of a page: point masses of what surrounds the object, and sources.

Sources are evaluated at every pixel.  What surrounds the object is summed at many normals instead.
Its point masses are gathered in a few hundred cells: the sum goes into a cell only where that is
near the mirror direction or the horizon, and a quick picture goes into none.
"""

from typing import Any, NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry import Shape
from jaxrender.harmonics import real_basis
from jaxrender.inverse import KnownLight
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.lighting import (
    DirectionalSources,
    Environment,
    HarmonicLight,
    Light,
    LightNodes,
    LightSum,
    positive_environment,
)
from jaxrender.pipelines.view.packing import octahedral, packed
from jaxrender.shapes import Float, Int

# Sources that are evaluated at every pixel, the brightest ones; the rest is summed with the nodes.
MOST_SOURCES = 8
# Point masses are cells of so many widths of a lobe, or the texels where these are coarser.
_ANGLE_PER_WIDTH = 0.5
# Rows of the cells, and the fewest columns in a row: about 300 of them, of 11 degrees.
_ROWS, _FEWEST_COLUMNS = 16, 4
# Light by its coefficients is drawn in so many rows where no image says.
_SAMPLED_ROWS = 64
# The degree of the harmonics that a page has sliders for.
DEGREE = 2


class PageLight(NamedTuple):
    """A light as a page holds it.

    ``fine`` are the point masses around the object, cell by cell; those of a cell begin at its
    ``first``, which has one number more than there are cells.  ``cells`` are the masses of all
    cells.  ``coefficients`` are those of the whole light to a degree.
    """

    fine: LightNodes
    cells: LightNodes
    first: Int[np.ndarray, "end"]
    sources: LightNodes
    coefficients: Float[np.ndarray, "coefficient 3"]

    @property
    def nodes(self) -> LightNodes:
        """All of it as point masses."""
        return _together(self.fine, self.sources)

    def scaled(self, factor: float) -> "PageLight":
        """The same so many times as bright."""

        def brighter(nodes: LightNodes) -> LightNodes:
            return nodes._replace(irradiance=factor * np.asarray(nodes.irradiance))

        return PageLight(
            brighter(self.fine),
            brighter(self.cells),
            self.first,
            brighter(self.sources),
            factor * self.coefficients,
        )

    def document(self) -> dict[str, Any]:
        """Lay it out as text."""
        return {
            "fine": _nodes_document(self.fine),
            "cells": _nodes_document(self.cells),
            "first": packed(self.first.astype(np.uint32)),
            "sources": _nodes_document(self.sources),
            "coefficients": packed(self.coefficients.astype(np.float32)),
        }


def page_light(light: KnownLight, width: float) -> PageLight:
    """Make the light of a page from one that no photograph changes, for lobes of some width."""
    upright = light.upright
    directions, irradiance = (np.asarray(part, float) for part in upright.directional.nodes())
    sources = LightNodes(directions, _three(irradiance))
    lit = np.any(sources.irradiance > 0, axis=1)
    order = np.argsort(-sources.irradiance.sum(axis=1), kind="stable")[: int(lit.sum())]
    bright, rest = (
        LightNodes(directions[part], sources.irradiance[part])
        for part in (order[:MOST_SOURCES], order[MOST_SOURCES:])
    )
    fine = rest
    if upright.environment is not None:
        around = KnownLight(upright.environment, DirectionalSources.none())
        (nodes,) = exact_nodes(around, np.zeros(0, int), width, _ANGLE_PER_WIDTH)
        assert isinstance(nodes, LightNodes)
        fine = _together(_plain(nodes), rest)
    fine, cells, first = gathered(fine)
    return PageLight(fine, cells, first, bright, _coefficients(_together(fine, bright)))


def page_light_of(light: Light, shape: Shape, width: float) -> PageLight:
    """Make the light of a page from any light; coefficients become light nowhere negative.

    Raises ``ValueError`` as ``KnownLight.of`` does.
    """
    images = [part for part in light.parts if isinstance(part, Environment)]
    rows = images[0].grid.shape[0] if images else _SAMPLED_ROWS
    parts = [
        positive_environment(np.asarray(part.coefficients, float), None, rows)
        if isinstance(part, HarmonicLight)
        else part
        for part in light.parts
    ]
    return page_light(KnownLight.of(LightSum(tuple(parts)), shape=shape).far, width)


def gathered(nodes: LightNodes) -> tuple[LightNodes, LightNodes, Int[np.ndarray, "end"]]:
    """Sort nodes by cells; find each cell's sum at its mean direction, and where it begins."""
    directions, irradiance = (np.asarray(part) for part in nodes)
    polar = np.arccos(np.clip(directions[:, 2], -1, 1))
    row = np.minimum((polar * _ROWS / np.pi).astype(int), _ROWS - 1)
    columns = np.maximum(
        _FEWEST_COLUMNS, np.rint(2 * _ROWS * np.sin((row + 0.5) * np.pi / _ROWS)).astype(int)
    )
    around = np.mod(np.arctan2(directions[:, 1], directions[:, 0]) / (2 * np.pi), 1)
    cell = row * 2 * _ROWS + np.minimum((around * columns).astype(int), columns - 1)
    order = np.argsort(cell, kind="stable")
    directions, irradiance, cell = directions[order], irradiance[order], cell[order]
    _, start = np.unique(cell, return_index=True)
    first = np.append(start, len(cell)).astype(int)
    if not len(start):
        return nodes, nodes, first
    mean = np.add.reduceat(directions * irradiance.sum(axis=1, keepdims=True), start)
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    cells = LightNodes(mean, np.add.reduceat(irradiance, start))
    return LightNodes(directions, irradiance), cells, first


def _plain(nodes: LightNodes) -> LightNodes:
    return LightNodes(np.asarray(nodes.directions, float), _three(np.asarray(nodes.irradiance)))


def _three(irradiance: np.ndarray) -> np.ndarray:
    if irradiance.shape[1] not in (1, 3):
        raise InputError(
            f"a page shows one or three channels, and the light has {irradiance.shape[1]}"
        )
    return np.broadcast_to(np.asarray(irradiance, float), (len(irradiance), 3)).copy()


def _together(*parts: LightNodes) -> LightNodes:
    return LightNodes(*(np.concatenate(arrays) for arrays in zip(*parts)))


def _coefficients(nodes: LightNodes) -> Float[np.ndarray, "coefficient 3"]:
    """Project point masses on harmonics up to the page's degree."""
    basis = np.asarray(real_basis(np.asarray(nodes.directions), DEGREE))
    return basis.T @ np.asarray(nodes.irradiance)


def _nodes_document(nodes: LightNodes) -> dict[str, Any]:
    irradiance = np.asarray(nodes.irradiance)
    scale = float(irradiance.max()) if irradiance.size and irradiance.max() > 0 else 1.0
    return {
        "directions": packed(octahedral(np.asarray(nodes.directions))),
        "irradiance": packed((irradiance / scale).astype(np.float16)),
        "scale": scale,
    }
