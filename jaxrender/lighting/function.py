"""Light as a function of direction, which any grid may sample."""

import abc

from jaxrender.harmonics import LatLongGrid
from jaxrender.lighting.base import Light
from jaxrender.lighting.environment import Environment
from jaxrender.shapes import Array, Directions, Float


class FunctionLight(Light):
    """Light whose radiance is a function of direction; a fit samples it as an image."""

    @abc.abstractmethod
    def radiance(self, directions: Directions) -> Float[Array, "*batch channel"]:
        """Evaluate the radiance from unit world directions."""

    def to_environment(self, height: int) -> Environment:
        """Sample the light at the texels of an image; ``ValueError`` where it is negative.

        A jump, as at the horizon of a sky, costs the integrals of such an image the order of
        1 / height.
        """
        directions = LatLongGrid(height, 2 * height).directions()
        image = self.radiance(directions.reshape(-1, 3)).reshape(height, 2 * height, -1)
        return Environment(image)
