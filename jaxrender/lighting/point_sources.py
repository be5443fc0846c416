"""Point sources: light from places near enough to count, such as a flash or a lamp on a stand."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.lighting.base import Light, LightNodes
from jaxrender.lighting.directional import DirectionalSources
from jaxrender.shapes import AnyArray, Array, Float, as_jax, checked


class PointSources(Light):
    """Light that comes from a few places, the same in all directions.

    ``positions`` are in the units of the shape; ``intensity`` is the irradiance on a plane that
    faces the source at the distance 1.  It falls with the square of the distance (L 2.10).  Raises
    ValueError for numbers that are not finite, negative intensity, and counts that do not match.
    """

    positions: Float[Array, "source 3"]
    intensity: Float[Array, "source channel"]

    def __init__(
        self, positions: Float[AnyArray, "source 3"], intensity: Float[AnyArray, "_ channel"]
    ):
        _check(positions, intensity)
        dtype = jax.dtypes.canonicalize_dtype(
            np.result_type(positions.dtype, intensity.dtype, np.float32)
        )
        self.positions, self.intensity = (
            as_jax(part, dtype) if isinstance(part, np.ndarray) else jnp.asarray(part, dtype)
            for part in (positions, intensity)
        )

    def nodes(self) -> LightNodes:
        """Refuse: every place sees these sources in other directions.  Always ``ValueError``."""
        raise ValueError(
            "point sources lie in another direction from every place; use seen_from(place), or "
            "directional sources where all are far away"
        )

    @checked
    def seen_from(self, place: Float[AnyArray, "3"]) -> DirectionalSources:
        """Look at the sources from one place.  Raises ``ValueError`` for one that lies there."""
        towards = self.positions - jnp.asarray(place, self.positions.dtype)[None]
        square = jnp.sum(towards**2, axis=1, keepdims=True)
        if not isinstance(square, Tracer) and not np.all(np.asarray(square) > 0):
            raise ValueError(f"a source lies at {np.asarray(place).tolist()} itself")
        return DirectionalSources(towards, self.intensity / square)

    @checked
    def at(self, points: Float[AnyArray, "point 3"]) -> LightNodes:
        """Look at them from many places: directions and irradiance by point, then by source."""
        towards = self.positions[None] - jnp.asarray(points, self.positions.dtype)[:, None]
        square = jnp.sum(towards**2, axis=2, keepdims=True)
        # A place at a source itself is lit by nothing.
        square = jnp.where(square > 0, square, jnp.inf)
        directions = jnp.where(square < jnp.inf, towards / jnp.sqrt(square), 0)
        return LightNodes(directions, self.intensity[None] / square)


def _check(positions: AnyArray, intensity: AnyArray) -> None:
    if positions.shape[0] != intensity.shape[0]:
        raise ValueError(
            f"{positions.shape[0]} positions but {intensity.shape[0]} intensities: give one each"
        )
    # Values exist only outside a traced function.
    for name, values, lowest in (("position", positions, -np.inf), ("intensity", intensity, 0.0)):
        if isinstance(values, Tracer):
            continue
        rows = np.asarray(values)
        bad = np.flatnonzero(~np.all(np.isfinite(rows) & (rows >= lowest), axis=1))
        if bad.size:
            wanted = "finite" if lowest < 0 else "finite, and 0 or more"
            raise ValueError(
                f"point source {bad[0]} has the {name} {rows[bad[0]].tolist()}: it must be {wanted}"
            )
