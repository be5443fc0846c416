"""Smooth light as a function: lobes that fall off like a Gaussian on the sphere.

An area source far away is such a lobe.  It is no image, so that photographs made with it owe
nothing to any grid.
"""

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.geometry.directions import normalise
from jaxrender.lighting.base import LightNodes
from jaxrender.lighting.function import FunctionLight
from jaxrender.shapes import AnyArray, Array, Directions, Float, checked

# Rows of the grid that a sum over nodes samples: at least so many, and so many within a width.
_ROWS, _ROWS_PER_WIDTH = 64, 8


class SmoothLobes(FunctionLight):
    """L(w) = sum_k radiance_k exp(-(1 - w . d_k) / (1 - cos width_k)): von Mises-Fisher lobes.

    At the angle ``width`` (radians) from its middle a lobe has fallen to 1/e.
    """

    directions: Float[AnyArray, "lobe 3"]
    widths: Float[AnyArray, "lobe"]
    middle: Float[AnyArray, "lobe channel"]

    def __check_init__(self):
        # Values exist only outside a traced function.
        if isinstance(self.widths, Tracer):
            return
        if not (np.all(np.asarray(self.widths) > 0) and np.all(np.asarray(self.widths) <= np.pi)):
            raise ValueError(f"widths {self.widths}: give angles above 0 and up to pi radians")

    @checked
    def radiance(self, directions: Directions) -> Float[Array, "*batch channel"]:
        """Evaluate the radiance from world directions."""
        middles = normalise(self.directions)
        towards = jnp.asarray(directions, middles.dtype) @ middles.T
        sharpness = 1 / (1 - jnp.cos(jnp.asarray(self.widths)))
        fallen = jnp.einsum("...k,k->...k", towards - 1, sharpness)
        return jnp.exp(fallen) @ jnp.asarray(self.middle)

    def nodes(self) -> LightNodes:
        """Sample the lobes on a grid that has many rows within the narrowest one."""
        finest = _ROWS_PER_WIDTH * np.pi / float(np.min(np.asarray(self.widths)))
        return self.to_environment(max(_ROWS, int(np.ceil(finest)))).nodes()
