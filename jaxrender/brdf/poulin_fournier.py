"""Poulin and Fournier's model of 1990: parallel cylinders along the tangent +X, and their floor.

Cylinders of radius 1 lie ``spacing`` apart and rise ``height`` above a floor.  What leaves towards
w_o is what the parts of one period reflect that are both lit and seen, over the period's area:

rho cos t_i cos t_o = 1 / d int (n . w_i) (n . w_o) f(w_i, w_o; n) over lit and seen arc and floor

Seen from w_o at the angle v from the normal, in the plane across the cylinders, an arc's point at
angle p is hidden by the next cylinder unless sin(v - p) >= 1 - d cos v, and by its own unless
|v - p| < pi / 2; both bounds and the floor's are one interval each, so lit and seen is one too.
The material f is Lambertian plus Blinn's normalised power of n . h.  The diffuse integral is exact;
the specular one uses Gauss-Legendre nodes about its peak where the authors used Chebyshev
polynomials.  Light that bounces twice is left out.
"""

from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.blinn_phong import blinn_normalisation
from jaxrender.brdf.half_vector import are_visible, half_vector, lifted, power_of_cosine
from jaxrender.brdf.parameters import (
    Scalar,
    as_scalar,
    matching,
    refuse_outside,
    share_of_energy_is_bounded,
)
from jaxrender.brdf.parametric import ByOwnNumber, ShapeParameter
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Bool, Float

_GAUSS = np.polynomial.legendre.leggauss(32)
# cos^s of 8 / sqrt(s + 1) is below 1e-13 for large s; for small s it is the whole arc.
_REACH = 8.0


class _Interval(NamedTuple):
    """A part of a period, from ``low`` to ``high``; empty when these have crossed."""

    low: Float[Array, "*batch"]
    high: Float[Array, "*batch"]

    def within(self, other: "_Interval") -> "_Interval":
        return _Interval(jnp.maximum(self.low, other.low), jnp.minimum(self.high, other.high))

    def closed(self) -> "_Interval":
        """Make an empty interval one of no length."""
        return _Interval(self.low, jnp.maximum(self.low, self.high))


class PoulinFournier(ByOwnNumber):
    """Cylinders with a material of kd and Blinn's lobe ks, ``exponent`` s >= 0.

    ``spacing`` d >= 2 between the axes and ``height`` in (0, 1], both in radii: 1 is half a
    cylinder, near 0 the surface is flat.  Raises ``ValueError`` outside these ranges.
    """

    # Of the material, as that of Blinn's lobe.
    shape: ClassVar[ShapeParameter] = ShapeParameter("exponent", 2.0, -2.0)

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    exponent: Scalar = eqx.field(converter=as_scalar)
    spacing: Scalar = eqx.field(converter=as_scalar, default=2.0)
    height: Scalar = eqx.field(converter=as_scalar, default=1.0)

    def __check_init__(self):
        refuse_outside("exponent", self.exponent, "[0, inf)", "larger is narrower, 32 is glossy")
        refuse_outside("spacing", self.spacing, "[2, inf)", "cylinders of radius 1 touch at 2")
        refuse_outside("height", self.height, "(0, 1]", "1 is half of a cylinder of radius 1")

    @property
    def reciprocal(self) -> bool:
        """Always: lit and seen are the same question."""
        return True

    @property
    def conserves_energy(self) -> bool:
        """When pi kd + ks is at most 1: each point of the material then absorbs some."""
        return share_of_energy_is_bounded(np.pi * self.kd, self.ks)

    @property
    def isotropic(self) -> bool:
        """Never: the cylinders have a direction."""
        return False

    @property
    def energy(self) -> float:
        """About one: ks is the material's albedo."""
        return 1.0

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
        """Evaluate both parts of the material over the lit and seen part of a period."""
        visible = are_visible(incoming, outgoing)
        incoming, outgoing = lifted(incoming), lifted(outgoing)
        spacing = matching(self.spacing, incoming.z)
        height = matching(self.height, incoming.z)
        arcs, floors = (
            [part(direction, spacing, height) for direction in (incoming, outgoing)]
            for part in (_seen_arc, _seen_floor)
        )
        arc = arcs[0].within(arcs[1]).closed()
        low, high = floors[0].within(floors[1]).closed()
        floor = (high - low) * incoming.z * outgoing.z
        diffuse = _diffuse_arc(arc, incoming, outgoing) + floor
        exponent = matching(self.exponent, incoming.z)
        half = half_vector(incoming, outgoing)
        specular = _specular_arc(arc, incoming, outgoing, half.direction, exponent)
        specular = specular + floor * power_of_cosine(half.versine, exponent)
        area = spacing * outgoing.z
        return (
            jnp.where(visible, diffuse / area, 0),
            jnp.where(visible, blinn_normalisation(exponent) * specular / area, 0),
        )


def _edge(height: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The cylinder's angle where it meets the floor, and its half width there."""
    half_width = jnp.sqrt(height * (2 - height))
    return jnp.arctan2(half_width, 1 - height), half_width


def _seen_arc(
    direction: Components, spacing: Float[Array, ""], height: Float[Array, ""]
) -> _Interval:
    """The angles on the arc from which a direction is open, mirrored so as to lie on +Y's side."""
    angle = jnp.arctan2(direction.y, direction.z)
    tilt = jnp.abs(angle)
    edge, _ = _edge(height)
    bound = jnp.clip(1 - spacing * jnp.cos(tilt), *_open_interval(direction.z))
    # Steeper directions pass over the next cylinder's visible part wherever they start.
    steep = tilt + edge <= np.pi / 2
    high = jnp.where(steep, edge, jnp.minimum(edge, tilt - jnp.arcsin(bound)))
    low = jnp.maximum(-edge, tilt - np.pi / 2)
    return _mirrored(_Interval(low, high), direction.y < 0, jnp.zeros_like(edge))


def _seen_floor(
    direction: Components, spacing: Float[Array, ""], height: Float[Array, ""]
) -> _Interval:
    """The places on the floor between two axes from which a direction is open."""
    tilt = jnp.abs(jnp.arctan2(direction.y, direction.z))
    edge, half_width = _edge(height)
    shade = (1 - (1 - height) * jnp.sin(tilt)) / jnp.cos(tilt)
    shade = jnp.where(tilt + edge <= np.pi / 2, half_width, shade)
    interval = _Interval(half_width, spacing - shade)
    return _mirrored(interval, direction.y < 0, spacing)


def _mirrored(
    interval: _Interval, mirror: Bool[AnyArray, "*batch"], ends: Float[Array, ""]
) -> _Interval:
    """Replace x by ``ends - x`` where asked."""
    low, high = interval
    return _Interval(jnp.where(mirror, ends - high, low), jnp.where(mirror, ends - low, high))


def _open_interval(like: Float[AnyArray, "..."]) -> tuple[float, float]:
    """The ends of (-1, 1), where arc sine's derivative is still finite."""
    end = 1 - 4 * float(jnp.finfo(like.dtype).eps)
    return -end, end


def _diffuse_arc(
    arc: _Interval, incoming: Components, outgoing: Components
) -> Float[Array, "*batch"]:
    """Integrate (n . w_i) (n . w_o) over the arc, n = (0, sin p, cos p), in closed form."""
    yy, zz = jnp.asarray(incoming.y * outgoing.y), jnp.asarray(incoming.z * outgoing.z)
    crossed = incoming.y * outgoing.z + incoming.z * outgoing.y

    def primitive(p: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        mixed = crossed * jnp.sin(p) ** 2
        return ((yy + zz) * p + (zz - yy) * jnp.sin(2 * p) / 2 + mixed) / 2

    return primitive(arc.high) - primitive(arc.low)


def _specular_arc(
    arc: _Interval,
    incoming: Components,
    outgoing: Components,
    half: Components,
    exponent: Float[Array, ""],
) -> Float[Array, "*batch"]:
    """Integrate (n . w_i) (n . w_o) (n . h)^s over the arc, with nodes about the peak at h."""
    peak = jnp.arctan2(half.y, half.z)
    reach = _REACH / jnp.sqrt(exponent + 1)
    low, high = arc.within(_Interval(peak - reach, peak + reach)).closed()

    def add(total: Array, node: tuple[Array, Array]) -> tuple[Array, None]:
        position, weight = node
        p = (low + high) / 2 + (high - low) / 2 * position
        y, z = jnp.sin(p), jnp.cos(p)
        facing = (y * incoming.y + z * incoming.z) * (y * outgoing.y + z * outgoing.z)
        versine = (half.x**2 + (y - half.y) ** 2 + (z - half.z) ** 2) / 2
        return total + weight * facing * power_of_cosine(versine, exponent), None

    nodes = matching(_GAUSS[0], peak), matching(_GAUSS[1], peak)
    total, _ = jax.lax.scan(add, jnp.zeros_like(low + high), nodes)
    return total * (high - low) / 2
