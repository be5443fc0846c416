"""Sources with a width: each is seven points, its middle and a hexagon about it.

A window far away and a lamp under a wider lobe look alike.  So a source has a variance v along each
axis of its tangent plane.  Half of its energy stands in the middle, and a twelfth at each of six
points at the distance 2 sqrt(v).  Up to the fifth order in their distances that is what a Gaussian
of this variance sends through any lobe; a window narrower than the lobe shows no more.
"""

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import world_from_local
from jaxrender.lighting import DirectionalSources
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Float

# The share of a source's energy at each of its points, the middle first.
SHARES = np.array([1 / 2] + [1 / 12] * 6)
POINTS = len(SHARES)
_TURNS = np.arange(6) * np.pi / 3
_HEXAGON = np.concatenate([np.zeros((1, 2)), np.stack([np.cos(_TURNS), np.sin(_TURNS)], axis=1)])
# Variances in parts of the lobe's: of a source that counts as a point, and at most.  A wider one
# would show its seven points.
LEAST, _MOST = 1e-4, 0.5
# Above this one a source has a width.
_WIDE = 2 * LEAST
# Sources are filled up to a multiple of this, so that few programs are compiled.
_BATCH = 8


@stored(jax.jit, effort="least")
def nodes_of(
    directions: Float[AnyArray, "source 3"], variance: Float[AnyArray, "source"]
) -> Float[Array, "node 3"]:
    """Lay out the points of each source, one source after the other."""
    middles, variance = jnp.asarray(directions), jnp.asarray(variance)
    # Which way the hexagon lies shows nowhere.
    frames = jax.lax.stop_gradient(world_from_local(middles)[..., :2])
    aside = jnp.einsum("sxa,na->snx", frames, jnp.asarray(_HEXAGON, middles.dtype))
    moved = middles[:, None] + 2 * jnp.sqrt(variance)[:, None, None] * aside
    moved = moved / jnp.linalg.norm(moved, axis=-1, keepdims=True)
    return moved.reshape(-1, 3)


def summed(columns: Float[Array, "sample node"]) -> Float[Array, "sample source"]:
    """Add up what the points of each source send."""
    each = columns.reshape(columns.shape[0], -1, POINTS)
    return each @ jnp.asarray(SHARES, columns.dtype)


def filled_up(count: int | np.integer) -> int:
    """Say how many sources a program has for so many."""
    return -(-int(count) // _BATCH) * _BATCH


def range_of(sigma: Float[AnyArray, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Bound the variance of a source; ``sigma`` is the logarithm of the lobe's width."""
    squared = jnp.exp(2 * jnp.asarray(sigma))
    return LEAST * squared, _MOST * squared


def widths_of(
    variance: Float[AnyArray, "source"] | None, sigma: Float[AnyArray, ""], count: int
) -> Float[np.ndarray, "source"]:
    """Say how wide sources are (radians, where they have fallen to 1/e); 0 is a point."""
    if variance is None:
        return np.zeros(count)
    found = np.asarray(variance, float)
    return np.where(found > _WIDE * np.exp(2 * float(sigma)), np.sqrt(2 * found), 0)


def as_points(
    sources: DirectionalSources, widths: Float[np.ndarray, "source"]
) -> DirectionalSources:
    """Put the points of wide sources in their places: the same light without a width."""
    wide = np.asarray(widths) > 0
    if not wide.any():
        return sources
    directions, energies = (np.asarray(part, float) for part in sources.nodes())
    points = np.asarray(nodes_of(directions[wide], widths[wide] ** 2 / 2))
    shared = (SHARES[None, :, None] * energies[wide][:, None]).reshape(len(points), -1)
    return DirectionalSources(
        np.concatenate([directions[~wide], points]), np.concatenate([energies[~wide], shared])
    )
