"""An environment: light from all directions, as a latitude-longitude image.

Row i lies at polar angle (i + 1/2) pi / H from +Z at the top, column j at azimuth
(j + 1/2) 2 pi / W, increasing left to right (T fig. 6.4).  The image defines the light *at these
nodes*, with the weights of Fejer's first rule: analysis is exact to degree (H - 1) / 2, and the
reference integral is the sum over the nodes.
"""

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.harmonics.grids import LatLongGrid
from jaxrender.lighting.base import Light, LightNodes
from jaxrender.lighting.panoramas import turned_latlong
from jaxrender.shapes import AnyArray, Array, Float, ImageArray, as_jax, checked


class Environment(Light):
    """Distant light as radiance on a latitude-longitude grid.

    Raises ValueError unless the image is twice as wide as high, finite and not negative.
    """

    radiance: Float[Array, "row column channel"]

    def __init__(self, radiance: ImageArray):
        _check(radiance)
        held = as_jax(radiance) if isinstance(radiance, np.ndarray) else radiance
        self.radiance = jnp.asarray(held)

    @property
    def grid(self) -> LatLongGrid:
        """Directions and weights of the texels."""
        rows, columns = self.radiance.shape[:2]
        return LatLongGrid(rows, columns)

    def nodes(self) -> LightNodes:
        """Each texel is a node, row by row, of irradiance weight x radiance."""
        dtype, channels = self.radiance.dtype, self.radiance.shape[-1]
        radiance = self.radiance if isinstance(self.radiance, Tracer) else np.asarray(self.radiance)
        irradiance = self.grid.weights().astype(dtype)[..., None] * radiance
        directions = self.grid.directions().astype(dtype)
        return LightNodes(directions.reshape(-1, 3), irradiance.reshape(-1, channels))

    @checked
    def scaled(self, factor: float | int | Float[AnyArray, ""]) -> "Environment":
        """The same light, ``factor`` times as bright."""
        return Environment(self.radiance * jnp.asarray(factor, self.radiance.dtype))

    @checked
    def turned(self, rotation: Float[np.ndarray, "3 3"]) -> "Environment":
        """Turn it, resampled: what came from direction d comes from ``rotation`` @ d."""
        return Environment(turned_latlong(np.asarray(self.radiance), rotation))


def _check(radiance: ImageArray) -> None:
    rows, columns = radiance.shape[:2]
    if rows < 1 or columns != 2 * rows:
        raise ValueError(
            f"the environment image is {columns} x {rows} (width x height): a latitude-longitude "
            "image is twice as wide as high; convert other panoramas by name"
        )
    # Values exist only outside a traced function; inside one there is nothing to look at.
    if isinstance(radiance, Tracer):
        return
    values = np.asarray(radiance)
    broken = ~(np.isfinite(values) & (values >= 0))
    if broken.any():
        row, column, channel = np.argwhere(broken)[0]
        raise ValueError(
            f"the environment's texel (row {row}, column {column}), channel {channel} is "
            f"{values[row, column, channel]:g}: radiance must be finite and not negative"
        )
