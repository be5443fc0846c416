"""Pixels of several exposures from which a response is found: of all brightnesses, not too many."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

# Pixels of each of these brightnesses, per photograph, and the side of the cells of the picture
# in which errors are not independent.
_BRIGHTNESSES, _PIXELS_OF_EACH, _CELL = 64, 50, 16
# So many pixels must be shared, and values from here on are saturated.
_FEWEST, _FULL = 20, 0.998


class Measurements(NamedTuple):
    """Stored values, the logarithms of their exposures, and their pixels and cells by number."""

    value: Float[np.ndarray, "measurement"]
    exposure: Float[np.ndarray, "measurement"]
    pixel: np.ndarray
    cell: np.ndarray


def measurements_of(values: np.ndarray, usable: np.ndarray, exposures: np.ndarray) -> Measurements:
    """List all values of pixels that two photographs or more show well, of all brightnesses."""
    rng = np.random.default_rng(0)
    shared = np.argwhere(usable.sum(axis=-1) >= 2)
    if len(shared) < _FEWEST:
        raise ValueError(
            f"{len(shared)} pixels are well exposed in two photographs: take exposures closer "
            "together, such as one or two stops"
        )
    shared = shared[rng.permutation(len(shared))]
    chosen = np.zeros(values.shape[:2], bool)
    for photograph in range(len(exposures)):
        good = shared[usable[shared[:, 0], shared[:, 1], photograph]]
        level = np.floor(values[good[:, 0], good[:, 1], photograph] * _BRIGHTNESSES)
        order = np.argsort(level, kind="stable")
        rank = np.arange(len(order)) - np.searchsorted(level[order], level[order])
        kept = good[order[rank < _PIXELS_OF_EACH]]
        chosen[kept[:, 0], kept[:, 1]] = True
    places = np.argwhere(chosen)
    # Black values measure, too, where others foretell them: without them noise would brighten.
    pixel, photograph = np.nonzero(values[chosen] < _FULL)
    cells = places // _CELL
    number = cells[:, 0] * (values.shape[1] // _CELL + 1) + cells[:, 1]
    cell = np.unique(number, return_inverse=True)[1][pixel]
    own = values[chosen][pixel, photograph]
    return Measurements(own, np.log(exposures)[photograph], pixel, cell)
