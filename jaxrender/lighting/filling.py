"""Directions that nothing showed, filled smoothly from those around them.

The filled part of a latitude-longitude image solves Laplace's equation on the sphere: each texel is
the mean of its neighbours, weighted by the borders that they share over their distance.  So it has
no maximum of its own: no lamp appears where none was seen.  Host side, NumPy float64.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy import sparse
from scipy.sparse.linalg import spsolve

from jaxrender.shapes import checked


@checked
def fill_smoothly(
    radiance: Float[np.ndarray, "row column channel"], seen: Bool[np.ndarray, "row column"]
) -> Float[np.ndarray, "row column channel"]:
    """Replace what is not ``seen``; raises ``ValueError`` where nothing is seen at all."""
    if not seen.any():
        raise ValueError("no direction was seen: there is nothing to fill from")
    values = np.array(radiance, np.float64)
    if seen.all():
        return values
    laplacian = _laplacian(*seen.shape)
    unknown = ~seen.ravel()
    flat = values.reshape(seen.size, -1)
    inner = laplacian[unknown][:, unknown].tocsc()
    right = -laplacian[unknown][:, ~unknown] @ flat[~unknown]
    solved = spsolve(inner, right)
    flat[unknown] = np.asarray(solved).reshape(right.shape)
    return np.maximum(flat.reshape(values.shape), 0)


def _laplacian(rows: int, columns: int) -> sparse.csr_array:
    """Sum the differences to all neighbours; a pole is a point, over which there is no border."""
    number = np.arange(rows * columns).reshape(rows, columns)
    polar = (np.arange(rows) + 0.5) * np.pi / rows
    down, across = np.pi / rows, 2 * np.pi / columns
    one, other, weight = [], [], []

    def link(a: np.ndarray, b: np.ndarray, w: np.ndarray) -> None:
        for first, second in ((a, b), (b, a)):
            one.append(first.ravel())
            other.append(second.ravel())
            weight.append(np.broadcast_to(w, a.shape).ravel())

    link(number, np.roll(number, -1, axis=1), (down / (np.sin(polar) * across))[:, None])
    link(number[:-1], number[1:], (np.sin(polar[:-1] + down / 2) * across / down)[:, None])
    rows_of, columns_of, weights = (np.concatenate(part) for part in (one, other, weight))
    size = (rows * columns, rows * columns)
    links = sparse.csr_array((weights, (rows_of, columns_of)), shape=size)
    return (sparse.diags_array(np.asarray(links.sum(axis=1)).ravel()) - links).tocsr()
