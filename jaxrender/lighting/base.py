"""What a light is to the rest of the house: point masses on the sphere of directions.

The slow reference integral of the reflection equation is a sum over these nodes,
B = sum_k rho(w_k, w_o) cos t_k E_k, so a light is defined exactly by them.  Directions are world
directions *towards* the light.
"""

import abc
from typing import NamedTuple

import equinox as eqx

from jaxrender.shapes import AnyArray, Float


class LightNodes(NamedTuple):
    """Unit directions, and for each the irradiance on a plane facing it.

    Of a light with radiance L sampled with quadrature weight w (solid angle) that is w L.
    """

    directions: Float[AnyArray, "node 3"]
    irradiance: Float[AnyArray, "node channel"]


class Light(eqx.Module):
    """Distant light: incoming radiance as a function of direction alone."""

    @abc.abstractmethod
    def nodes(self) -> LightNodes:
        """The light as point masses."""
