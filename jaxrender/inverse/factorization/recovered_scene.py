"""The light of a factorization and how well it is known."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics import band_limit_of, real_basis
from jaxrender.inverse.factorization.source_clusters import SourceCluster
from jaxrender.inverse.factorization.source_nodes import as_points, nodes_of, summed
from jaxrender.lighting import DirectionalSources
from jaxrender.shapes import Float


class RecoveredScene(NamedTuple):
    """The light of a factorization, in the gauge of its material: the slow part and the sources.

    ``covariance`` is that of each channel's slow coefficients and the energies of its sources.
    ``determined`` is the share of each degree that the photographs determine, from 0 to 1.  The
    rest is what smooth light is expected to have.  ``clusters`` are sources that the lobe does not
    tell apart; where each of them lies is not known better than to the width of its cluster.
    ``widths`` say where sources have fallen to 1/e (radians); None: all are points.
    """

    slow: Float[np.ndarray, "coefficient channel"]
    sources: DirectionalSources
    covariance: Float[np.ndarray, "channel part part"]
    direction_error: Float[np.ndarray, "source"]
    determined: Float[np.ndarray, "degree"]
    clusters: tuple[SourceCluster, ...] = ()
    widths: Float[np.ndarray, "source"] | None = None

    @property
    def points(self) -> DirectionalSources:
        """The sources as points: a wide one is several (``source_nodes``)."""
        return self.sources if self.widths is None else as_points(self.sources, self.widths)

    @property
    def slow_error(self) -> Float[np.ndarray, "coefficient channel"]:
        """Standard errors of the slow coefficients."""
        return np.sqrt(np.einsum("cpp->pc", self.covariance))[: len(self.slow)]

    @property
    def energy_error(self) -> Float[np.ndarray, "source channel"]:
        """Standard errors of the sources' irradiance."""
        return np.sqrt(np.einsum("cpp->pc", self.covariance))[len(self.slow) :]

    @property
    def total(self) -> Float[np.ndarray, "coefficient channel"]:
        """Coefficients of slow light and sources together, known better than either."""
        return self.slow + self._towards.T @ np.asarray(self.sources.irradiance)

    @property
    def total_error(self) -> Float[np.ndarray, "coefficient channel"]:
        """Standard errors of the total."""
        both = np.concatenate([np.eye(len(self.slow)), self._towards.T], axis=1)
        return np.sqrt(np.stack([np.sum(both @ own * both, axis=1) for own in self.covariance], 1))

    @property
    def _towards(self) -> Float[np.ndarray, "source coefficient"]:
        directions, degree = np.asarray(self.sources.directions), band_limit_of(len(self.slow))
        if self.widths is None or not self.widths.any():
            return np.asarray(real_basis(directions, degree))
        nodes = nodes_of(directions, self.widths**2 / 2)
        return np.asarray(summed(jnp.asarray(real_basis(nodes, degree)).T)).T
