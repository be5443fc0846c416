"""Sources that lie closer together than the lobe is wide: a cluster, and what is known of it.

A few lamps within the width of the lobe look like any other few of the same sum, centre and spread.
The photographs hardly tell how many there are, and where each of them is.  The errors of single
sources assume that their number is right, so that they are too small there.  Those of the cluster
hold.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.sparse.csgraph import connected_components

from jaxrender.shapes import Array, Float, Int

# Sources this near to each other, as part of the lobe's width, may be one.
NEIGHBOURS_PER_SIGMA = 1.0


class SourceCluster(NamedTuple):
    """Sources that the lobe does not tell apart, by their places among all sources.

    ``direction`` is their centre and ``width`` the root mean square distance from it (radians),
    both weighted by energy; ``irradiance`` is their sum.
    """

    members: Int[np.ndarray, "member"]
    direction: Float[np.ndarray, "3"]
    direction_error: float
    width: float
    width_error: float
    irradiance: Float[np.ndarray, "channel"]
    irradiance_error: Float[np.ndarray, "channel"]


class Centred(NamedTuple):
    """The centre of a cluster and its width, with their standard errors."""

    direction: Float[np.ndarray, "3"]
    direction_error: float
    width: float
    width_error: float


def grouped(
    directions: Float[np.ndarray, "source 3"], sigma: float
) -> tuple[Int[np.ndarray, "member"], ...]:
    """Group sources of which each has a neighbour within the width of the lobe."""
    near = directions @ directions.T > np.cos(NEIGHBOURS_PER_SIGMA * sigma)
    count, group = connected_components(near, directed=False)
    members = (np.flatnonzero(group == one) for one in range(count))
    return tuple(one for one in members if len(one) > 1)


def centred(
    directions: Float[np.ndarray, "member 3"],
    energies: Float[np.ndarray, "member"],
    frames: Float[np.ndarray, "member 3 2"],
    covariance: Float[np.ndarray, "number number"],
) -> Centred:
    """Find centre and width of some sources.

    ``covariance`` is that of energies, then of steps along the first tangents of ``frames``, then
    along the second.
    """
    count = len(energies)
    at = jnp.concatenate([jnp.asarray(energies), jnp.zeros(2 * count)])

    def centre_and_width(numbers: Float[Array, "number"]) -> Float[Array, "4"]:
        energies, first, second = jnp.split(numbers, 3)
        steps = first[:, None] * frames[:, :, 0] + second[:, None] * frames[:, :, 1]
        moved = jnp.asarray(directions) + steps
        centre = energies @ moved / jnp.sum(energies)
        centre = centre / jnp.linalg.norm(centre)
        apart = jnp.sum((moved - centre[None]) ** 2, axis=1)
        width = jnp.sqrt(energies @ apart / jnp.sum(energies))
        return jnp.append(centre, width)

    found = np.asarray(centre_and_width(at))
    slopes = np.asarray(jax.jacfwd(centre_and_width)(at))
    spread = slopes @ covariance @ slopes.T
    variance = np.maximum(np.diag(spread), 0)
    # One of the three components lies along the centre and does not move.
    across = np.sqrt(variance[:3].sum())
    return Centred(found[:3], float(across), float(found[3]), float(np.sqrt(variance[3])))
