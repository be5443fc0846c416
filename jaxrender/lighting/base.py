"""What a light is to the rest of the house: point masses on the sphere of directions.

The slow reference integral of the reflection equation is a sum over these nodes,
B = sum_k rho(w_k, w_o) cos t_k E_k, so a light is defined exactly by them.  Directions are world
directions *towards* the light.  Lights add up: ``probe + source`` is a light.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from jaxrender.shapes import AnyArray, Float


class LightNodes(NamedTuple):
    """Unit directions, and for each the irradiance on a plane facing it.

    Of a light with radiance L sampled with quadrature weight w (solid angle) that is w L.
    """

    directions: Float[AnyArray, "node 3"]
    irradiance: Float[AnyArray, "node channel"]


class Light(eqx.Module):
    """Light that reaches an object: incoming radiance as a function of direction.

    All lights are distant but ``PointSources``, which have nodes as seen from a place alone.
    """

    @abc.abstractmethod
    def nodes(self) -> LightNodes:
        """The light as point masses."""

    @property
    def parts(self) -> tuple["Light", ...]:
        """The lights that add up to this one: itself, unless it is a sum."""
        return (self,)

    def __add__(self, other: "Light") -> "Light":
        """Add two lights."""
        return LightSum((*self.parts, *other.parts)) if isinstance(other, Light) else NotImplemented


class LightSum(Light):
    """Several lights at once; made by adding them.  Raises ``ValueError`` for none."""

    lights: tuple[Light, ...]

    def __check_init__(self):
        if not self.lights:
            raise ValueError("a LightSum without lights; give at least one")

    @property
    def parts(self) -> tuple[Light, ...]:
        """The lights that add up to this one."""
        return tuple(part for light in self.lights for part in light.parts)

    def nodes(self) -> LightNodes:
        """The point masses of all, one light after the other.

        Raises ``ValueError`` for lights of different numbers of channels.
        """
        directions, irradiance = zip(*(light.nodes() for light in self.lights))
        channels = {part.shape[1] for part in irradiance}
        if len(channels) > 1:
            raise ValueError(
                f"lights of {' and '.join(map(str, sorted(channels)))} channels; give all alike"
            )
        return LightNodes(jnp.concatenate(directions), jnp.concatenate(irradiance))
