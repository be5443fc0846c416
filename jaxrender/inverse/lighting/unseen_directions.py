"""Directions that no sample reflects: two rules for the moments of an image with holes.

``smooth``
    the discrete Laplace equation on the sphere with the observed bins as boundary, a membrane: it
    is linear in them, and each bin stays within the range of its neighbours
``left-out``
    the moments are fitted by least squares to the observed bins alone; unobserved bins are 0.  It
    has no bias only for light of no higher degree than the moments

From grid, observed bins and band limit each rule makes the matrix E of T 6.21, such that moments =
E'image of the observed bins, and a function that fills an image.  Host side, NumPy float64.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import splu

from jaxrender.harmonics import LatLongGrid, real_basis
from jaxrender.shapes import Bool, Float


class Filled(NamedTuple):
    """The matrix E of T 6.21 of the observed bins, and what fills an image from their values."""

    moments: Float[np.ndarray, "seen coefficient"]
    fill: Callable[[np.ndarray], np.ndarray]


def _filled_smoothly(
    grid: LatLongGrid, observed: Bool[np.ndarray, "bin"], band_limit: int
) -> Filled:
    """Give unobserved bins the values of the membrane spanned by the observed ones."""
    weighted = _weighted_basis(grid, band_limit)
    laplacian = _laplacian(grid)
    seen, hidden = np.flatnonzero(observed), np.flatnonzero(~observed)
    moments = weighted[seen]
    if not hidden.size:
        return Filled(moments, lambda values: _spread(values, seen, observed))
    inner = splu(laplacian[hidden][:, hidden].tocsc())
    across = laplacian[hidden][:, seen]
    moments = moments - across.T @ inner.solve(weighted[hidden])

    def fill(values: np.ndarray) -> np.ndarray:
        image = _spread(values, seen, observed)
        image[hidden] = -inner.solve(across @ values)
        return image

    return Filled(moments, fill)


def _left_out(grid: LatLongGrid, observed: Bool[np.ndarray, "bin"], band_limit: int) -> Filled:
    """Fit the coefficients to the observed bins by least squares over their solid angles."""
    seen = np.flatnonzero(observed)
    weighted = _weighted_basis(grid, band_limit)[seen]
    basis = weighted / grid.weights().ravel()[seen][:, None]
    moments = weighted @ np.linalg.pinv(weighted.T @ basis)
    return Filled(moments, lambda values: _spread(values, seen, observed))


UNSEEN = {"smooth": _filled_smoothly, "left-out": _left_out}


def _spread(values: np.ndarray, seen: np.ndarray, observed: np.ndarray) -> np.ndarray:
    image = np.zeros(observed.shape)
    image[seen] = values
    return image


def _weighted_basis(grid: LatLongGrid, band_limit: int) -> Float[np.ndarray, "bin coefficient"]:
    basis = np.asarray(real_basis(grid.directions().reshape(-1, 3), band_limit))
    return basis * grid.weights().ravel()[:, None]


def _laplacian(grid: LatLongGrid) -> sparse.csr_array:
    """Build the graph Laplacian of the texels: width of the shared edge over the distance."""
    rows, columns = grid.shape
    number = np.arange(rows * columns).reshape(rows, columns)
    down, across = np.pi / rows, 2 * np.pi / columns
    edges = np.sin(np.arange(1, rows) * down) * across / down
    sides = down / (np.sin(grid.polar_angles()) * across)
    pairs = [
        (number[:-1], number[1:], np.repeat(edges[:, None], columns, axis=1)),
        (number, np.roll(number, -1, axis=1), np.repeat(sides[:, None], columns, axis=1)),
    ]
    one, other, strength = (np.concatenate([p[k].ravel() for p in pairs]) for k in range(3))
    links = sparse.coo_array((strength, (one, other)), (rows * columns,) * 2)
    return sparse.csr_array(csgraph.laplacian(links + links.T))
