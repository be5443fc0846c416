"""The principal components of a reflection map: its own best basis instead of harmonics (T 5.8).

The viewers' harmonics are orthonormal, so the principal components of the whole light field are
those of the (P+1)^2 maps: an eigenproblem of that size instead of one of the dense light field's.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.reflection.shrm.maps import Shrm
from jaxrender.shapes import AnyArray, Array, Float


class PrincipalMaps(NamedTuple):
    """B(R, o) = sum_k maps_k(R) viewer_k(o), components in falling order of energy."""

    maps: Float[Array, "row column component channel"]
    viewers: Float[Array, "component outgoing"]
    """Each component's dependence on the viewer in harmonics; orthonormal."""
    energy: Float[np.ndarray, "outgoing"]
    """What part of the light field's energy every component holds; sums to 1."""

    def expanded(self) -> Float[Array, "row column outgoing channel"]:
        """Return to the maps B_pq, of the components that are kept."""
        return jnp.einsum("rckd,ko->rcod", self.maps, self.viewers, precision="highest")


def principal_maps(shrm: Shrm, count: int) -> PrincipalMaps:
    """Compute the ``count`` strongest components; all channels share one set of viewers' functions.

    Raises ``ValueError`` for a count outside 1 ... (P+1)^2 and for dark maps.
    """
    maps = jnp.asarray(shrm.maps)
    most = maps.shape[2]
    if not 1 <= count <= most:
        raise ValueError(f"{count} components of {most} maps: ask for 1 to {most}")
    weights = jnp.asarray(shrm.grid.weights(), maps.dtype)
    gram = _gram(maps, weights)
    values, vectors = np.linalg.eigh(np.asarray(gram, float))
    values, vectors = np.maximum(values[::-1], 0), vectors[:, ::-1]
    if not values.sum() > 0:
        raise ValueError("dark maps have no components: prefilter light that shines")
    kept = jnp.asarray(vectors[:, :count].T, maps.dtype)
    components = jnp.einsum("rcod,ko->rckd", maps, kept, precision="highest")
    return PrincipalMaps(components, kept, values / values.sum())


def _gram(
    maps: Float[AnyArray, "row column outgoing channel"], weights: Float[AnyArray, "row column"]
) -> Float[Array, "outgoing outgoing"]:
    return jnp.einsum("rc,rcod,rcpd->op", weights, maps, maps, precision="highest")
