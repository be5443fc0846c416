"""Errors of coefficients that know of misfit: the fit without one photograph at a time.

A photograph of a wrong exposure or pose pulls the coefficients its way, and with so many of them
they follow it nearly: what is left of it says little.  So each photograph is left out in turn, and
each cell of reflected directions; how far the coefficients then move is how uncertain they are (the
jackknife).  If all is noise, either says what the model does; what goes beyond that is added up.
"""

import numpy as np

from jaxrender.inverse.clusters import FEWEST, Clusters
from jaxrender.shapes import Float, Int


def without_each(
    rows: Float[np.ndarray, "sample unknown"],
    target: Float[np.ndarray, "sample"],
    prior: Float[np.ndarray, "unknown unknown"],
    clusters: Clusters,
) -> Float[np.ndarray, "unknown unknown"]:
    """Estimate the covariance of weighted least squares under a prior by leaving out clusters.

    It is what photographs show, plus what cells do, less the model's own.  Of fewer than eight
    photographs it is what cells show.
    """
    matrix, vector = rows.T @ rows + prior, rows.T @ target
    by_cell = _moved(rows, target, matrix, vector, clusters.cell)
    if len(np.unique(clusters.photograph)) < FEWEST:
        return by_cell
    by_photograph = _moved(rows, target, matrix, vector, clusters.photograph)
    return by_photograph + by_cell - np.linalg.inv(matrix)


def _moved(
    rows: Float[np.ndarray, "sample unknown"],
    target: Float[np.ndarray, "sample"],
    matrix: Float[np.ndarray, "unknown unknown"],
    vector: Float[np.ndarray, "unknown"],
    cluster: Int[np.ndarray, "sample"],
) -> Float[np.ndarray, "unknown unknown"]:
    """Sum up the squares of how far the answer moves without each cluster."""
    names = np.unique(cluster)
    found = np.zeros((len(names), len(vector)))
    for at, name in enumerate(names):
        own, seen = rows[cluster == name], target[cluster == name]
        found[at] = np.linalg.solve(matrix - own.T @ own, vector - own.T @ seen)
    off = found - found.mean(axis=0)
    return (len(names) - 1) / len(names) * off.T @ off
