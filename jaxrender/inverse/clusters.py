"""Errors that know of misfit: what samples leave unexplained together counts together.

Least squares takes what a model leaves of each sample to be noise of its own.  Where the model is
wrong, it leaves the same of many samples: of those of one photograph (its exposure, its pose), or
of those that reflect the same part of the light.  The covariance of an estimate is then

    sum_g m_g m_g',    m_g = the sum over cluster g of how far each sample moves the estimate

once over photographs and once over cells of the reflected direction; clusters of both at once would
count twice and are subtracted (Cameron, Gelbach and Miller 2011).  What is wrong in the same way
everywhere is in no difference between clusters: that is for ``diagnosis`` to find.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.geometry import fibonacci_sphere
from jaxrender.inverse.observations import Observations
from jaxrender.shapes import AnyArray, Float, Int

# Cells of the reflected direction: 30 degrees wide, as wide as most lobes.
_CELLS = 60
# Fewer photographs than this say by chance alone what they leave together.
FEWEST = 8


class Clusters(NamedTuple):
    """The photograph of each sample, and the cell that its reflected direction lies in."""

    photograph: Int[np.ndarray, "sample"]
    cell: Int[np.ndarray, "sample"]

    @classmethod
    def of(cls, observations: Observations) -> "Clusters":
        """Sort samples into clusters."""
        centres = np.asarray(fibonacci_sphere(_CELLS))
        cell = np.argmax(np.asarray(observations.samples.reflected) @ centres.T, axis=1)
        return cls(np.asarray(observations.frame), cell)

    def take(self, chosen: AnyArray) -> "Clusters":
        """Keep the samples of a mask or of indices."""
        return Clusters(self.photograph[chosen], self.cell[chosen])

    @property
    def both(self) -> "Groups":
        """Put what is in one photograph and in one cell into a group."""
        names, group = np.unique(self.photograph * _CELLS + self.cell, return_inverse=True)
        return Groups(Clusters(names // _CELLS, names % _CELLS), group)

    def covariance(
        self, influence: Float[np.ndarray, "sample parameter"]
    ) -> Float[np.ndarray, "parameter parameter"]:
        """Sum up, cluster by cluster, how far the samples move the parameters.

        It is what both kinds of clusters show; of fewer than eight photographs what the cells show
        alone.  It may come out negative where there is next to nothing.
        """
        if len(np.unique(self.photograph)) < FEWEST:
            return _between(influence, self.cell)
        single = _between(influence, self.photograph) + _between(influence, self.cell)
        return single - _between(influence, self.both.group)


class Groups(NamedTuple):
    """The clusters that each group of samples lies in, and the group of each sample."""

    clusters: Clusters
    group: Int[np.ndarray, "sample"]


def widened(
    covariance: Float[np.ndarray, "parameter parameter"],
    clustered: Float[np.ndarray, "parameter parameter"],
) -> Float[np.ndarray, "parameter parameter"]:
    """Widen a model's own covariance to the standard errors that clusters show, never narrow it.

    Correlations stay the model's: those of a dozen clusters are mostly chance.
    """
    own, shown = np.diag(covariance), np.diag(clustered)
    factor = np.sqrt(np.maximum(1, np.divide(shown, own, out=np.ones_like(own), where=own > 0)))
    return factor[:, None] * covariance * factor[None, :]


def _between(
    influence: Float[np.ndarray, "sample parameter"], cluster: Int[np.ndarray, "sample"]
) -> Float[np.ndarray, "parameter parameter"]:
    """Sum over clusters, with the correction for few of them."""
    names, place = np.unique(cluster, return_inverse=True)
    sums = np.zeros((len(names), influence.shape[1]))
    np.add.at(sums, place, influence)
    few = len(names) / max(len(names) - 1, 1)
    return few * sums.T @ sums
