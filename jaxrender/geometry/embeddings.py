"""The hemisphere of directions on the unit square: Nusselt's and the polar map (L 3.3.1, 4.1).

``NUSSELT``: (kappa, lambda) = ((x + 1) / 2, (y + 1) / 2) of the direction (x, y, z).  Directions
fill the disc at the square's centre, and projected solid angle is cos t dw = 4 dkappa dlambda: the
cosine of reflection is in the area, and the shading integral becomes L 4.2.

``POLAR``: (s, t) = (polar angle / (pi/2), azimuth / 2 pi), azimuth in [0, 2 pi).  The second axis
is periodic, the pole is a whole side, and cos t dw = pi^2 sin t cos t ds dt.

Directions are local, +Z the normal; those below the horizon lie nowhere on the square.  A table of
n samples along an axis has them at the centres of its cells, (i + 1/2) / n.
"""

import abc
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry.components import Components
from jaxrender.geometry.directions import direction_from_angles
from jaxrender.shapes import AnyArray, Array, Bool, Directions, Float

Places = Float[AnyArray, "*batch 2"]

_HALF_PI = np.pi / 2


@dataclass(frozen=True)
class Embedding(abc.ABC):
    """A map between the upper hemisphere and the unit square; hashable, so static under jit."""

    @property
    @abc.abstractmethod
    def name(self) -> str:
        """What files and configurations call it."""

    @property
    @abc.abstractmethod
    def periodic(self) -> tuple[bool, bool]:
        """Which of the two axes close upon themselves."""

    @abc.abstractmethod
    def square_from_direction(self, directions: Directions) -> Float[Array, "*batch 2"]:
        """Map unit directions to the square; those below the horizon as if mirrored above it."""

    @abc.abstractmethod
    def direction_from_square(self, places: Places) -> Float[Array, "*batch 3"]:
        """Map places to unit directions; where ``covers`` is false, to the nearest horizon."""

    @abc.abstractmethod
    def covers(self, places: Places) -> Bool[Array, "*batch"]:
        """Say which places stand for a direction above the horizon."""

    @abc.abstractmethod
    def projected_solid_angle(self, places: Places) -> Float[Array, "*batch"]:
        """Evaluate cos t dw for a unit of area of the square; zero where ``covers`` is false."""

    def centres(self, size: tuple[int, int]) -> Float[np.ndarray, "row column 2"]:
        """Lay out the centres of the cells of a table, float64 on the host.

        Raises ``ValueError`` for an axis without samples.
        """
        if min(size) < 1:
            raise ValueError(f"a table of {size[0]} x {size[1]} directions; give at least one")
        axes = [(np.arange(n) + 0.5) / n for n in size]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)

    def cell_directions(self, size: tuple[int, int]) -> Float[np.ndarray, "row column 3"]:
        """Lay out the directions of those centres, float64 on the host."""
        return np.asarray(self.direction_from_square(self.centres(size)), float)


@dataclass(frozen=True)
class NusseltEmbedding(Embedding):
    """The direction's shadow on the plane, scaled to the unit square."""

    @property
    def name(self) -> str:
        """``nusselt``."""
        return "nusselt"

    @property
    def periodic(self) -> tuple[bool, bool]:
        """Neither."""
        return False, False

    def square_from_direction(self, directions: Directions) -> Float[Array, "*batch 2"]:
        """((x + 1) / 2, (y + 1) / 2)."""
        return (jnp.asarray(directions)[..., :2] + 1) / 2

    def direction_from_square(self, places: Places) -> Float[Array, "*batch 3"]:
        """(x, y, sqrt(1 - x^2 - y^2)); derivatives are finite everywhere, 0 of z outside."""
        flat = 2 * jnp.asarray(places) - 1
        square = jnp.sum(flat * flat, axis=-1)
        inside = square < 1
        # Either branch of a square root under `where` is differentiated: keep both away from 0.
        z = jnp.where(inside, jnp.sqrt(jnp.where(inside, 1 - square, 1)), 0)
        scale = jnp.where(inside, 1, jax.lax.rsqrt(jnp.where(inside, 1, square)))
        return jnp.concatenate([flat * scale[..., None], z[..., None]], axis=-1)

    def covers(self, places: Places) -> Bool[Array, "*batch"]:
        """Inside the disc."""
        flat = 2 * jnp.asarray(places) - 1
        return jnp.sum(flat * flat, axis=-1) < 1

    def projected_solid_angle(self, places: Places) -> Float[Array, "*batch"]:
        """4: the Jacobian of L 4.1 with the cosine in it."""
        inside = self.covers(places)
        return jnp.where(inside, 4, 0).astype(jnp.asarray(places).dtype)


@dataclass(frozen=True)
class PolarEmbedding(Embedding):
    """Polar angle and azimuth, scaled to the unit square (L 3.3.1)."""

    @property
    def name(self) -> str:
        """``polar``."""
        return "polar"

    @property
    def periodic(self) -> tuple[bool, bool]:
        """The azimuth."""
        return False, True

    def square_from_direction(self, directions: Directions) -> Float[Array, "*batch 2"]:
        """(t / (pi/2), p / 2 pi); azimuth 0 at the pole, without derivatives there."""
        x, y, z = Components.of(directions)
        square = x * x + y * y
        at_pole = square == 0
        x = jnp.where(at_pole, 1, x)
        polar = jnp.where(at_pole, 0, jnp.arctan2(jnp.sqrt(jnp.where(at_pole, 1, square)), abs(z)))
        turn = jnp.where(at_pole, 0, jnp.arctan2(y, x)) / (2 * np.pi)
        turn = jnp.where(turn < 0, turn + 1, turn)
        # A tiny negative azimuth rounds up to a whole turn.
        return jnp.stack([polar / _HALF_PI, jnp.where(turn < 1, turn, 0)], axis=-1)

    def direction_from_square(self, places: Places) -> Float[Array, "*batch 3"]:
        """The usual angles; the square has no place outside."""
        places = jnp.asarray(places)
        return direction_from_angles(places[..., 0] * _HALF_PI, places[..., 1] * 2 * np.pi)

    def covers(self, places: Places) -> Bool[Array, "*batch"]:
        """Everywhere short of the horizon."""
        return jnp.asarray(places)[..., 0] < 1

    def projected_solid_angle(self, places: Places) -> Float[Array, "*batch"]:
        """pi^2 sin t cos t."""
        places = jnp.asarray(places)
        measure = (np.pi**2 / 2) * jnp.sin(np.pi * places[..., 0])
        return jnp.where(self.covers(places), measure, 0)


NUSSELT = NusseltEmbedding()
POLAR = PolarEmbedding()
EMBEDDINGS: dict[str, Embedding] = {chosen.name: chosen for chosen in (NUSSELT, POLAR)}
