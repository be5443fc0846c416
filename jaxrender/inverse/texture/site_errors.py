"""What photographs leave of each site, by which the errors of its numbers are widened.

The matrix of a site holds K_d, K_s and numbers, so that what one photograph leaves moves them all
together (:mod:`.clustered`).
"""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.texture.clustered import Excess, Groups
from jaxrender.inverse.texture.forward import ModelOf
from jaxrender.inverse.texture.measurements import SiteObservations
from jaxrender.inverse.texture.site_equations import excess_of_numbers
from jaxrender.inverse.texture.site_minima import inverses
from jaxrender.inverse.texture.site_solver import Asked, Solved, parts_of
from jaxrender.inverse.texture.site_sums import by_channel, site_sums
from jaxrender.shapes import Float

# This near to a bound a number is held by it.
_AT_BOUND = 1e-6


class Left(NamedTuple):
    """What is left of each site.

    ``squares`` are those of the weighted residuals, ``excess`` what photographs leave of the mean
    of K_d, of a K_s that is not known, and of each number together.  ``diffuse`` is the variance of
    K_d if all else were known.
    """

    squares: Float[np.ndarray, "site"]
    excess: Excess
    diffuse: Float[np.ndarray, "site channel"]


def left_of_sites(
    measured: SiteObservations, model_of: ModelOf, asked: Asked, solved: Solved
) -> Left:
    """Compare what is left with noise, a part of the surface at a time."""
    channels = measured.radiance.shape[1]
    kinds = 1 + min(asked.prior.amplitudes(channels), 1) + len(asked.names)
    squares, diffuse = np.zeros(measured.count), np.full((measured.count, channels), np.inf)
    excess = Excess(*np.zeros((3, measured.count, kinds)))
    inverse, photograph = inverse_of_free(solved, asked), measured.clusters.photograph
    for part in parts_of(measured, model_of, asked, solved.value, solved.predicted, asked.names):
        count = len(part.sites)
        with np.errstate(divide="ignore"):
            diffuse[part.sites] = 1 / np.asarray(site_sums(part.data, part.near.at).dd)[:count]
        left = np.asarray(part.data.weights)[: part.kept] * (
            part.data.radiance[: part.kept] - solved.predicted[part.rows]
        )
        site = measured.site[part.rows]
        squares += np.bincount(site, np.sum(left**2, axis=1), minlength=measured.count)
        filled = len(part.data.site) - part.kept
        groups = Groups.of(
            np.asarray(part.data.site), np.pad(photograph[part.rows], (0, filled), mode="edge")
        )
        own = np.pad(inverse[part.sites], ((0, len(part.value) - count), (0, 0), (0, 0)))
        shown = excess_of_numbers(part.near, part.data, asked.prior, asked.names, groups, own)
        for whole, some in zip(excess, shown, strict=True):
            whole[part.sites] = np.asarray(some)[:count]
    return Left(squares, excess, diffuse)


def inverse_of_free(solved: Solved, asked: Asked) -> Float[np.ndarray, "site unknown unknown"]:
    """Invert the matrix of every site's unknowns; 0 of those that are black or at a bound."""
    low, high = asked.bounds
    material, channels = solved.local.material, solved.predicted.shape[1]
    ks = np.asarray(by_channel(np.asarray(material.ks)))[:, : asked.prior.amplitudes(channels)]
    ended = (solved.value <= low + _AT_BOUND) | (solved.value >= high - _AT_BOUND)
    held = np.concatenate([np.asarray(material.kd) <= 0, ks <= 0, ended], axis=1)
    pairs = held[:, :, None] | held[:, None, :]
    matrix = np.where(pairs, np.eye(held.shape[1]), np.asarray(solved.local.matrix))
    return np.where(pairs, 0, inverses(matrix))
