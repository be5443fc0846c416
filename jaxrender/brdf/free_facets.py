"""Facets whose slopes and Fresnel curve are free: between a named model and a table (T 7.3).

rho = kd + ks D(h) G(w_i, w_o) F(t_d) / (F(0) 4 cos t_i cos t_o)

*The distribution.*  With x = tan t_h / sigma the share of a GGX surface that is flatter than t_h is
u = x^2 / (1 + x^2).  D is GGX's times what the surface has more or less of each part of it,

D = D_ggx p(u),     p ~ (1 - u)^(tail - 2) exp(sum_{k > 1} wave_k cos(k pi u)),     int_0^1 p du = 1

so that the projected area is right.  ``tail`` is how D falls off, as tan^(-2 tail) (GTR's gamma):
2 is GGX's, and where it is large D is Beckmann's of the width sigma / sqrt(tail).  The waves are
what is left, smooth because they are few.

*The masking* is Smith's of this distribution, by quadrature, so that the lobe is physical.

*The Fresnel curve*: log F is a monotone cubic of glass's, through 0, 45, 60, 75 and 90 degrees.
``rise_60`` is how many times higher it is at 60 than at 45 degrees, and so on: at least 1.  Below
45 degrees it may fall, as a metal's does.
"""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.distributions import Distribution, ring_facing
from jaxrender.brdf.facets import facet_transfer
from jaxrender.brdf.fresnel import normalised_fresnel
from jaxrender.brdf.half_vector import are_visible, lifted
from jaxrender.brdf.parameters import (
    Scalar,
    as_scalar,
    matching,
    refuse_outside,
    share_of_energy_is_bounded,
)
from jaxrender.brdf.parametric import Searched, ShapeParameter, WithoutIndex
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float, checked

# The first wave is left out: width and tail together do what it would.
WAVES = (2, 3, 4)
_LEAST_TAIL, _MOST_TAIL, _TAIL_ORIGIN = 1.75, 60.0, 1.5
_HIGHEST, _WAVE_ORIGIN = 6.0, -18.0
_MOST_RISE = 100.0
# What is expected of them, with the standard deviation; of wave k 0, within .5 / k.
_FIRST_RISE = (1.2, 0.4)
# Glass's index, its rises, and its log F where that of the curve is known.
_INDEX, _GLASS = 1.5, (1.2559978, 1.7752164, 2.8374245, 3.9516232)
_KNOTS = np.concatenate([[0.0], np.cumsum(np.log(_GLASS))])
# Where GGX falls to 1/e of its peak, and where another distribution may (x = tan t_h / sigma).
_FALLEN, _TRIED = np.sqrt(np.sqrt(np.e) - 1), np.geomspace(0.01, 100, 400)
# Gauss-Legendre nodes in s = (1 - u)^(1/4): what lies at the horizon is smooth in it.
_GAUSS = np.polynomial.legendre.leggauss(40)
_ROOTS, _WEIGHTS = (_GAUSS[0] + 1) / 2, _GAUSS[1] / 2
# Smith's Lambda is a series of Chebyshev polynomials in v / (1 + v), v = sigma tan t.
_TERMS = 16
_PLACES = (1 - np.cos((np.arange(_TERMS) + 0.5) * np.pi / _TERMS)) / 2
_SERIES = np.linalg.inv(np.polynomial.chebyshev.chebvander(2 * _PLACES - 1, _TERMS - 1))


class FreeDistribution(Distribution):
    """GGX of width ``sigma`` times a smooth curve of the share of its area."""

    sigma: Scalar = eqx.field(converter=as_scalar)
    tail: Scalar = eqx.field(converter=as_scalar, default=2.0)
    waves: tuple[Scalar, ...] = ()

    @property
    def width(self) -> Float[Array, ""]:
        """The width of the GGX whose density falls to 1/e of its peak where this one first does."""
        sigma = jnp.asarray(self.sigma, float)
        squared = jnp.asarray(_TRIED**2, sigma.dtype)
        peak = self._curve(*jnp.asarray([0.0, 1.0], sigma.dtype))
        falls = self._curve(squared / (1 + squared), 1 / (1 + squared)) / peak / (1 + squared) ** 2
        return sigma * jnp.asarray(_TRIED, sigma.dtype)[jnp.argmax(falls < np.exp(-1))] / _FALLEN

    def density(self, half: Components) -> Float[Array, "*batch"]:
        """Evaluate D(h) in 1/sr."""
        sigma = matching(self.sigma, half.z)
        x, y, z = (jnp.asarray(part) for part in half)
        along, up = (x * x + y * y) / sigma**2, z * z
        stretched = along + up
        ggx = 1 / (jnp.pi * sigma**2 * stretched**2)
        return ggx * self._curve(along / stretched, up / stretched) / self._area(half.z)

    def smith_lambda(self, direction: Components) -> Float[Array, "*batch"]:
        """Look Lambda up: a series that is made of the integral over the facets seen."""
        sigma = matching(self.sigma, direction.z)
        # The floor keeps the square root's derivative finite head-on.
        squared = (direction.x**2 + direction.y**2) / direction.z**2
        v = sigma * jnp.sqrt(jnp.maximum(squared, float(jnp.finfo(sigma.dtype).eps)))
        x = 2 * v / (1 + v) - 1
        after = before = jnp.zeros_like(x)
        mean, *terms = self._series(sigma)
        for term in reversed(terms):
            after, before = term + 2 * x * after - before, after
        ratio = mean + x * after - before
        return jnp.maximum(ratio * _ggx_facing(v) - 1, 0)

    def _curve(
        self, flatter: Float[Array, "*batch"], steeper: Float[Array, "*batch"]
    ) -> Float[Array, "*batch"]:
        """Evaluate p(u) but for its integral; ``steeper`` is 1 - u."""
        tail = matching(self.tail, flatter)
        cosine = jnp.cos(jnp.pi * flatter)
        now, before, total = 2 * cosine * cosine - 1, cosine, jnp.zeros_like(cosine)
        for wave in self.waves:
            total = total + matching(wave, flatter) * now
            now, before = 2 * cosine * now - before, now
        tiny = float(jnp.finfo(steeper.dtype).tiny)
        return jnp.exp((tail - 2) * jnp.log(jnp.maximum(steeper, tiny)) + total)

    def _parts(self, like: Float[AnyArray, "..."]) -> Float[Array, "node"]:
        """Evaluate what each node's facets are of all, but for the sum."""
        roots, weights = matching(_ROOTS, like), matching(_WEIGHTS, like)
        return 4 * roots**3 * weights * self._curve(1 - roots**4, roots**4)

    def _area(self, like: Float[AnyArray, "..."]) -> Float[Array, ""]:
        return jnp.sum(self._parts(like))

    def _series(self, like: Float[AnyArray, "..."]) -> Float[Array, "term"]:
        """Expand (1 + Lambda) / (1 + Lambda of GGX)."""
        parts, roots = self._parts(like), matching(_ROOTS, like)
        slopes = jnp.sqrt(1 - roots**4) / roots**2
        v = matching(_PLACES / (1 - _PLACES), like)
        across = v[:, None] * slopes[None]
        seen = ring_facing(jnp.ones_like(across), across) / (2 * np.pi)
        facing = seen @ parts / jnp.sum(parts)
        return matching(_SERIES, like) @ (facing / _ggx_facing(v))


class FreeFacets(WithoutIndex):
    """A Lambertian base under facets of any smooth isotropic distribution.

    Raises, outside traced functions, ``ValueError`` for numbers out of their range.
    """

    shape: ClassVar[ShapeParameter] = ShapeParameter("sigma")

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    sigma: Scalar = eqx.field(converter=as_scalar)
    tail: Scalar = eqx.field(converter=as_scalar, default=2.0)
    wave_2: Scalar = eqx.field(converter=as_scalar, default=0.0)
    wave_3: Scalar = eqx.field(converter=as_scalar, default=0.0)
    wave_4: Scalar = eqx.field(converter=as_scalar, default=0.0)
    rise_45: Scalar = eqx.field(converter=as_scalar, default=_GLASS[0])
    rise_60: Scalar = eqx.field(converter=as_scalar, default=_GLASS[1])
    rise_75: Scalar = eqx.field(converter=as_scalar, default=_GLASS[2])
    rise_90: Scalar = eqx.field(converter=as_scalar, default=_GLASS[3])

    def __check_init__(self):
        refuse_outside("sigma", self.sigma, "(0, 1]", "for a rougher surface use oren-nayar")
        refuse_outside("tail", self.tail, "(1.5, inf)", "2 is GGX's")
        refuse_outside("rise_45", self.rise_45, "(0, inf)", "1 is a curve that stays level")
        for name in ("rise_60", "rise_75", "rise_90"):
            refuse_outside(name, getattr(self, name), "[1, inf)", "beyond 45 degrees F only rises")

    @property
    def searched(self) -> tuple[Searched, ...]:
        """The width, the distribution's tail and waves, and the rises of the Fresnel curve."""
        tail = Searched("tail", _LEAST_TAIL, _MOST_TAIL, 2.2, _TAIL_ORIGIN, closed=True)
        waves = (
            Searched(f"wave_{k}", -_HIGHEST, _HIGHEST, 0.0, _WAVE_ORIGIN, expected=(0.0, 0.5 / k))
            for k in WAVES
        )
        first = Searched("rise_45", 0.25, 4.0, _GLASS[0], expected=_FIRST_RISE)
        rises = (
            Searched(name, 1.0, _MOST_RISE, start, closed=True, expected=(start, start))
            for name, start in zip(("rise_60", "rise_75", "rise_90"), _GLASS[1:])
        )
        return (self.shape.searched, tail, *waves, first, *rises)

    @property
    def distribution(self) -> FreeDistribution:
        """How many facets face where."""
        waves = (self.wave_2, self.wave_3, self.wave_4)
        return FreeDistribution(self.sigma, self.tail, waves)

    @property
    def width(self) -> Float[Array, ""]:
        """That of the facets' distribution, of which ``sigma`` is but a part."""
        return self.distribution.width

    @property
    def reciprocal(self) -> bool:
        """Always."""
        return True

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    @property
    def conserves_energy(self) -> bool:
        """When pi kd + ks times the Fresnel ratio's largest value is at most 1."""
        rises = (self.rise_45, self.rise_60, self.rise_75, self.rise_90)
        rises = np.cumprod([float(rise) for rise in rises])
        return share_of_energy_is_bounded(np.pi * self.kd, self.ks * max(1.0, rises.max()))

    @property
    def energy(self) -> float:
        """One: ks is about the lobe's albedo at normal exitance."""
        return 1.0

    @checked
    def fresnel_ratio(self, cosines: Float[AnyArray, "*batch"]) -> Float[Array, "*batch"]:
        """Evaluate F(t_d) / F(0)."""
        rises = (self.rise_45, self.rise_60, self.rise_75, self.rise_90)
        steps = jnp.log(jnp.stack([matching(rise, cosines) for rise in rises]))
        width = matching(np.diff(_KNOTS), cosines)
        secants = steps / width
        # Fritsch and Butland's slopes: nothing between two knots is beyond both.
        agree = secants[:-1] * secants[1:] > 0
        both = jnp.where(agree, secants[:-1] + secants[1:], 1)
        inner = jnp.where(agree, 2 * secants[:-1] * secants[1:] / both, 0)
        first, last = (3 * secants[at] - inner[at] for at in (0, -1))
        ends = [_within(end / 2, secants[at]) for end, at in ((first, 0), (last, -1))]
        slopes = jnp.concatenate([ends[0][None], inner, ends[1][None]])
        glass = jnp.log(normalised_fresnel(_INDEX, jnp.clip(cosines, 0, 1)))
        at = jnp.clip(jnp.searchsorted(matching(_KNOTS, cosines), glass) - 1, 0, len(steps) - 1)
        below = jnp.concatenate([jnp.zeros(1, steps.dtype), jnp.cumsum(steps)])
        h = width[at]
        s = (glass - matching(_KNOTS, cosines)[at]) / h
        rest = 1 - s
        log = below[at] * (1 + 2 * s) * rest**2 + below[at + 1] * s**2 * (3 - 2 * s)
        log = log + h * (slopes[at] * s * rest**2 - slopes[at + 1] * s**2 * rest)
        return jnp.exp(log)

    @checked
    def curves(self, angles: Float[AnyArray, "angle"]) -> Mapping[str, Float[AnyArray, "angle"]]:
        """Evaluate D by the facets' tilt, and F / F(0) by the angle of incidence on them."""
        angles = jnp.asarray(angles)
        sines, cosines = jnp.sin(angles), jnp.cos(angles)
        tilted = Components(sines, jnp.zeros_like(sines), cosines)
        return {
            "distribution": self.distribution.density(tilted),
            "fresnel": self.fresnel_ratio(cosines),
        }

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate the clamped cosine and the lobe."""
        visible = are_visible(incoming, outgoing)
        raised = lifted(incoming), lifted(outgoing)
        facets = facet_transfer(self.distribution, "smith", *raised)
        lobe = facets.lobe * self.fresnel_ratio(facets.half_cosine)
        return jnp.where(visible, incoming.z, 0), jnp.where(visible, lobe, 0)


def _ggx_facing(v: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Evaluate 1 + Lambda of GGX."""
    return (1 + jnp.sqrt(1 + v * v)) / 2


def _within(slope: Float[Array, ""], secant: Float[Array, ""]) -> Float[Array, ""]:
    """Keep an end's slope between 0 and three secants, where the cubic is monotone."""
    part = jnp.where(secant == 0, 0, slope / jnp.where(secant == 0, 1, secant))
    return jnp.clip(part, 0, 3) * secant
