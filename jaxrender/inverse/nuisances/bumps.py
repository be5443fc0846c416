"""A smooth displacement of the surface, by harmonics of its normals: how it turns them."""

import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import world_from_local
from jaxrender.harmonics import coefficient_count, real_basis
from jaxrender.shapes import Float, checked

# Harmonics of the displacement up to this degree; the constant turns nothing.
_DEGREE = 4
BUMPS = coefficient_count(_DEGREE) - 1
# The mean square of a harmonic's gradient is l (l + 1) / 4 pi; this is that of all together.
SLOPES = sum((2 * k + 1) * k * (k + 1) for k in range(1, _DEGREE + 1)) / (4 * np.pi)
# Derivatives of harmonics are taken over this step (radians).
_STEP = 1e-4


@checked
def bumps(normals: Float[np.ndarray, "sample 3"]) -> Float[np.ndarray, "harmonic sample 3"]:
    """Differentiate all harmonics but the constant along the sphere, by central differences.

    A displacement of height h turns normals by minus its gradient (radians).
    """
    found = np.zeros((BUMPS, len(normals), 3))
    tangents = np.asarray(world_from_local(jnp.asarray(normals)))[:, :, :2]
    for along in np.moveaxis(tangents, -1, 0):
        ahead, behind = (_harmonics(normals + sign * _STEP * along) for sign in (1, -1))
        found += ((ahead - behind) / (2 * _STEP)).T[:, :, None] * along
    return found


def _harmonics(vectors: Float[np.ndarray, "sample 3"]) -> Float[np.ndarray, "sample harmonic"]:
    unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(real_basis(unit, _DEGREE))[:, 1:]
