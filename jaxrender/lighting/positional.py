"""Lights without extent at a place: intensity by direction, cones, flaps (L 2.2.1, Warn 1983).

A point light has intensity I(w), W/sr, towards unit directions w *away* from it, in its own frame;
at distance r, in direction w_s from the surface towards the light, it makes the irradiance

    E = I(-w_s) cos t / r^2                                  (L 2.10; the argument: ERRATA 67)

``Distribution`` is what has such an intensity: those here, with +Z as the axis of the beam, and the
tables of ``photometric``, which shine towards -Z.  A ``PointLight`` sets it up in the world.  A
cone cuts the beam by its angle; flaps (barn doors) cut it by planes in the world, so that only
places on their inner side are lit.  Differentiable; the dtype is the input's.
"""

from typing import NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.geometry import to_local
from jaxrender.shapes import AnyArray, Array, Directions, Float, checked


@runtime_checkable
class Distribution(Protocol):
    """How the intensity of a light depends on direction."""

    def intensity(self, directions: Directions) -> Float[Array, "*batch channel"]:
        """Evaluate W/sr towards unit directions away from the light, in its own frame."""
        ...


class IsotropicIntensity(eqx.Module):
    """The same in all directions; of a source of power P it is P / 4 pi."""

    value: Float[AnyArray, "channel"]

    @checked
    def intensity(self, directions: Directions) -> Float[Array, "*batch channel"]:
        """Repeat the value."""
        directions = jnp.asarray(directions)
        value = jnp.asarray(self.value, directions.dtype)
        return jnp.broadcast_to(value, (*directions.shape[:-1], len(value)))


class SpotIntensity(eqx.Module):
    """I = peak cos^exponent t about +Z, zero backwards (Warn 1983).

    Raises ``ValueError`` for a negative exponent.
    """

    peak: Float[AnyArray, "channel"]
    exponent: float | Float[Array, ""]

    def __check_init__(self):
        if not isinstance(self.exponent, Tracer) and not self.exponent >= 0:
            raise ValueError(f"a spot of exponent {self.exponent}; give 0 or more")

    @checked
    def intensity(self, directions: Directions) -> Float[Array, "*batch channel"]:
        """Evaluate the power of the cosine."""
        cosine = jnp.asarray(directions)[..., 2:]
        forward = cosine > 0
        # The power of 0 has no derivative by the exponent.
        power = jnp.where(forward, cosine, 1) ** jnp.asarray(self.exponent, cosine.dtype)
        peak = jnp.asarray(self.peak, cosine.dtype)
        lit = jnp.where(forward, power, 0)
        return lit * peak.reshape((1,) * (lit.ndim - 1) + (-1,))


class ConeIntensity(eqx.Module):
    """Another distribution within a cone about +Z, dark outside it (Warn 1983).

    ``half_angle`` in radians.  Raises ``ValueError`` unless it is above 0 and at most pi.
    """

    within: Distribution
    half_angle: float

    def __check_init__(self):
        if not 0 < self.half_angle <= np.pi:
            raise ValueError(f"a cone of half angle {self.half_angle}; give radians in (0, pi]")

    @checked
    def intensity(self, directions: Directions) -> Float[Array, "*batch channel"]:
        """Cut by the cosine."""
        inside = jnp.asarray(directions)[..., 2:] >= float(np.cos(self.half_angle))
        return jnp.where(inside, self.within.intensity(directions), 0)


class Flaps(NamedTuple):
    """Half-spaces n . x <= d of the world, as barn doors are; a place is lit within all of them."""

    normals: Float[AnyArray, "flap 3"]
    offsets: Float[AnyArray, "flap"]


class Arrival(NamedTuple):
    """Light of a point light at places: where it comes from, and the intensity sent this way."""

    directions: Float[Array, "point 3"]
    """Unit, from the place to the light: w_s."""
    distance: Float[Array, "point"]
    intensity: Float[Array, "point channel"]
    """W/sr; over the squared distance it is the irradiance on a plane facing the light."""


class PointLight(eqx.Module):
    """A distribution of intensity at a ``position``, turned by ``world_from_local``.

    Raises ``ValueError`` for a matrix that is no rotation.
    """

    position: Float[AnyArray, "3"]
    distribution: Distribution
    world_from_local: Float[AnyArray, "3 3"] = eqx.field(default_factory=lambda: np.eye(3))
    flaps: Flaps | None = None

    def __check_init__(self):
        turn = self.world_from_local
        if isinstance(turn, np.ndarray):
            gram = turn.T.astype(float) @ turn.astype(float)
            if not np.allclose(gram, np.eye(3), atol=1e-4) or np.linalg.det(turn) < 0:
                raise ValueError(f"world_from_local {turn.tolist()} is no rotation")

    @checked
    def intensity(self, directions: Directions) -> Float[Array, "*batch channel"]:
        """Evaluate W/sr towards unit world directions away from the light."""
        directions = jnp.asarray(directions)
        turn = jnp.asarray(self.world_from_local, directions.dtype)
        return self.distribution.intensity(to_local(turn, directions))

    @checked
    def arriving(self, points: Float[AnyArray, "point 3"]) -> Arrival:
        """Find what reaches places if nothing stands between; at the light itself, nothing."""
        points = jnp.asarray(points)
        towards = jnp.asarray(self.position, points.dtype)[None] - points
        square = jnp.sum(towards * towards, axis=1)
        apart = square > 0
        distance = jnp.sqrt(jnp.where(apart, square, 1))
        directions = towards / distance[:, None]
        lit = apart & self._within_flaps(points)
        intensity = jnp.where(lit[:, None], self.intensity(-directions), 0)
        return Arrival(directions, distance, intensity)

    def _within_flaps(self, points: Array) -> Array:
        if self.flaps is None:
            return jnp.ones(len(points), bool)
        normals = jnp.asarray(self.flaps.normals, points.dtype)
        heights = jnp.einsum("fi,pi->pf", normals, points, precision="highest")
        return jnp.all(heights <= jnp.asarray(self.flaps.offsets, points.dtype)[None], axis=1)
