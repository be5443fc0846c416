"""A light given by its harmonic coefficients, as a light like any other (T 2.36, 2.52).

Such a light may be negative somewhere (a truncated series rings), which an environment image may
not be; its nodes carry the signs along.
"""

import equinox as eqx
import jax.numpy as jnp

from jaxrender.harmonics import LatLongGrid, band_limit_of, evaluate, synthesise
from jaxrender.lighting.base import LightNodes
from jaxrender.lighting.environment import Environment
from jaxrender.lighting.function import FunctionLight
from jaxrender.shapes import Array, Coefficients, Directions, Float, checked


def _height(value: int | None) -> int | None:
    return None if value is None else int(value)


class HarmonicLight(FunctionLight):
    """L(w) = sum_lm L_lm Y_lm(w), real harmonics in the flat order l(l+1)+m.

    ``height`` is the number of rows of the latitude-longitude grid that ``nodes`` samples: the sum
    over the nodes is exact against every function up to degree height - 1 - F.  The default,
    4 (F + 1) rows, is exact up to degree 3 F + 3.

    Raises ``ValueError`` unless there are (F + 1)^2 coefficients, and for fewer rows than the
    2 F + 1 that determine the light.
    """

    coefficients: Coefficients
    height: int | None = eqx.field(static=True, converter=_height, default=None)

    def __check_init__(self):
        fewest = 2 * self.band_limit + 1
        if self.height is not None and self.height < fewest:
            raise ValueError(
                f"height={self.height}: light of degree {self.band_limit} needs {fewest} rows or "
                "more; leave the height out, or cut the coefficients"
            )

    @property
    def band_limit(self) -> int:
        """The highest degree."""
        return band_limit_of(self.coefficients.shape[0])

    @property
    def grid(self) -> LatLongGrid:
        """The grid of the nodes."""
        rows = 4 * (self.band_limit + 1) if self.height is None else self.height
        return LatLongGrid(rows, 2 * rows)

    @checked
    def radiance(self, directions: Directions) -> Float[Array, "*batch channel"]:
        """Evaluate the radiance from world directions."""
        return evaluate(self.coefficients, directions)

    def nodes(self) -> LightNodes:
        """Weigh the light at the nodes of its grid, row by row: weight x radiance."""
        coefficients = jnp.asarray(self.coefficients)
        weights = jnp.asarray(self.grid.weights(), coefficients.dtype)
        irradiance = weights[..., None] * synthesise(self.grid, coefficients)
        directions = jnp.asarray(self.grid.directions(), coefficients.dtype)
        return LightNodes(directions.reshape(-1, 3), irradiance.reshape(-1, coefficients.shape[1]))

    def to_environment(self, height: int) -> Environment:
        """Sample the light at the texels of an image; ``ValueError`` where it is negative."""
        grid = LatLongGrid(height, 2 * height)
        if grid.band_limit >= self.band_limit:
            return Environment(synthesise(grid, jnp.asarray(self.coefficients)))
        return super().to_environment(height)
