"""What is expected of a correction before any photograph is seen: that it is smooth, and near 1.

The logarithm of the factor is a Gaussian process over the half and difference angles.  Its standard
deviation tau is learnt by the fit; how fast it changes is told by ``Lengths``.  A table has more
nodes than a smooth function has freedom: the process is a sum of as many smooth functions as matter
(the leading eigenvectors of its covariance), each with a weight of standard deviation tau.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from jaxrender.brdf.tables.isotropic import HALF_PI, node_angles
from jaxrender.shapes import Float, Int

# What is left out of the variance at any node, about.
_LEFT_OUT = 1e-4
# Nodes whose places differ by less than this (in lengths) are one.
_SAME = 1e-9


class Lengths(NamedTuple):
    """How far apart two pairs of directions still have like corrections.

    ``half`` is in sqrt(2 t_h / pi), as the nodes are laid out, ``difference`` in 2 t_d / pi.
    ``azimuth`` is in the product of these two times cos 2 p_d: the azimuth means nothing where
    either angle is zero, and a surface without handedness has the same value at -p_d.
    """

    half: float = 0.08
    difference: float = 0.15
    azimuth: float = 0.6


DEFAULT_LENGTHS = Lengths()


class Smooth(NamedTuple):
    """Smooth functions, tabulated at all places of a table; their squares add up to about 1.

    ``place`` is that of each cell: cells that mirror one another have one place.
    """

    functions: Float[np.ndarray, "place function"]
    place: Int[np.ndarray, "cell"]

    @property
    def at_cells(self) -> Float[np.ndarray, "cell function"]:
        """The functions at all cells."""
        return self.functions[self.place]

    def by_place(self, sums: Float[np.ndarray, "*any cell"]) -> Float[np.ndarray, "*any place"]:
        """Add up what belongs to the cells of one place."""
        order = np.argsort(self.place, kind="stable")
        first = np.searchsorted(self.place[order], np.arange(len(self.functions)))
        return np.add.reduceat(sums[..., order], first, axis=-1)


@lru_cache(maxsize=4)
def smooth_functions(shape: tuple[int, int, int], lengths: Lengths = DEFAULT_LENGTHS) -> Smooth:
    """Tabulate the smooth functions of a table of so many nodes."""
    angles = node_angles(shape)
    across, along = np.sqrt(angles.theta_h / HALF_PI), angles.theta_d / HALF_PI
    around = across * along * np.cos(2 * angles.phi_d)
    places = np.stack([axis.ravel() for axis in (across, along, around)], axis=1) / lengths
    # Mirrored nodes have one place, and so has the azimuth where it means nothing.
    places, which = np.unique(np.round(places / _SAME) * _SAME, axis=0, return_inverse=True)
    squares = np.sum((places[:, None] - places[None]) ** 2, axis=-1)
    values, vectors = np.linalg.eigh(np.exp(-squares / 2))
    kept = values > _LEFT_OUT * values[-1]
    return Smooth(vectors[:, kept] * np.sqrt(values[kept]), which.ravel())
