"""What a concave shape keeps from its samples, as each stage of a fit asks for it.  Host side.

Of a convex shape nothing is asked: ``concave`` lets it pass for none, and all else follows.
"""

import numpy as np

from jaxrender.geometry import Shape, SurfacePlaces
from jaxrender.harmonics import band_limit_of
from jaxrender.inverse.observations import Observations
from jaxrender.lighting import LightNodes
from jaxrender.reflection import (
    DualLight,
    FrameNodes,
    Shadows,
    cast_shadows,
    transfer_vectors,
    visible_nodes,
)
from jaxrender.shapes import AnyArray, Bool, Float

# Degree to which slow light is followed into the diffuse part.  The edges of shadows have all
# degrees, slow light next to none above this: 20 leave the same error, half a per cent.
MOST_DIFFUSE_DEGREES = 8
# Y~_00 of a place that sees its whole hemisphere: A_0 Y_00 = pi / sqrt(4 pi).
_OPEN = np.sqrt(np.pi) / 2


def concave(shape: Shape | None) -> Shape | None:
    """The shape if it can cast shadows on itself, None if it is convex (or not given)."""
    return None if shape is None or shape.is_convex() else shape


def places_of(observations: Observations) -> SurfacePlaces:
    """Where the samples lie; ``ValueError`` where nobody said so."""
    if observations.places is None:
        raise ValueError(
            "the shape is concave, and its shadows need to know where the samples lie: "
            "give observations.places"
        )
    return observations.places


def with_transfer(observations: Observations, shape: Shape, band_limit: int) -> Observations:
    """Find the samples' transfer vectors (T 6.10), unless they are known to that degree already."""
    known = observations.transfer
    if known is not None and band_limit_of(known.shape[1]) >= band_limit:
        return observations
    normals = np.asarray(observations.samples.normals)
    vectors = transfer_vectors(shape, places_of(observations), normals, band_limit)
    return observations._replace(transfer=vectors.values)


def shadows_of(shape: Shape | None, observations: Observations, light: DualLight) -> Shadows | None:
    """Trace what the dual model asks for (T 6.12); the light's frames are the observations' own.

    Samples that were moved have lost their transfer vectors, which are then found anew.
    """
    if shape is None:
        return None
    degrees = min(MOST_DIFFUSE_DEGREES, light.band_limit)
    transfer = with_transfer(observations, shape, degrees).transfer
    places = places_of(observations)
    return cast_shadows(shape, places, observations.samples, light, np.asarray(transfer))


def nodes_seen(
    shape: Shape | None, observations: Observations, nodes: tuple[LightNodes | FrameNodes, ...]
) -> tuple[Bool[np.ndarray, "sample node"], ...] | None:
    """Trace which nodes of each part of a light every sample sees."""
    if shape is None:
        return None
    places = places_of(observations)
    return tuple(visible_nodes(shape, places, part) for part in nodes)


def hidden_fraction(transfer: Float[AnyArray, "sample coefficient"]) -> float:
    """Average over samples how much of the hemisphere, by its cosine, the shape itself hides."""
    open_part = np.asarray(transfer)[:, 0] / _OPEN
    return float(np.clip(1 - open_part, 0, 1).mean())
