"""Distributions of microfacet normals, with the part of their area that a direction sees.

``density`` is D(h) in 1/sr, normalised so that the facets' projected area is the surface's,
int D(h) cos t_h dw_h = 1.  With it the Torrance-Sparrow factor is 1/4 (ERRATA 54).
``smith_lambda`` is Smith's Lambda(w) = int D(h) max(w . h, 0) dw_h / cos t - 1, the share of facets
facing w that is hidden: one direction's masking is 1 / (1 + Lambda).
"""

import abc
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import erf

from jaxrender.brdf.parameters import Scalar, as_scalar, as_scalar_or_none, matching, refuse_outside
from jaxrender.geometry import Components, squared_angle_of_versine
from jaxrender.shapes import AnyArray, Array, Float

_SMOOTHER = "for a mirror use a small one such as 0.001, for a rougher surface oren-nayar"

# Gauss-Legendre nodes on (0, 1) for the Gaussian's normalisation (1e-13) and its Lambda (1e-4).
_GAUSS = np.polynomial.legendre.leggauss(48)
_NODES, _WEIGHTS = (_GAUSS[0] + 1) / 2, _GAUSS[1] / 2
# The Gaussian is 1e-19 of its peak beyond this many widths.
_REACH = 6.6
# Beckmann's Lambda is 0 in any precision where the squared slope is smaller (exp(-1000)).
_FLATTEST = 1e-3
# So is exp(-tan^2 t / a^2) for a <= 1 where the squared cosine is smaller; the floor keeps what
# multiplies that 0 finite.
STEEPEST = 1e-3


class Distribution(eqx.Module):
    """How many microfacets face where."""

    @abc.abstractmethod
    def density(self, half: Components) -> Float[Array, "*batch"]:
        """Evaluate D(h) in 1/sr for unit half vectors above the horizon."""

    @abc.abstractmethod
    def smith_lambda(self, direction: Components) -> Float[Array, "*batch"]:
        """Evaluate Smith's Lambda for unit directions above the horizon."""


class Gaussian(Distribution):
    """D = c exp(-(t_h / roughness)^2), Torrance and Sparrow's of 1967, c by quadrature.

    T 6.2 sets c = 1 / (pi roughness^2), its limit for smooth surfaces.  Isotropic only.
    """

    roughness: Scalar = eqx.field(converter=as_scalar)

    def __check_init__(self):
        refuse_outside("roughness", self.roughness, "(0, 1]", _SMOOTHER)

    def density(self, half: Components) -> Float[Array, "*batch"]:
        """Evaluate the Gaussian in the angle from the normal."""
        along = half.x * half.x + half.y * half.y
        squared_angle = squared_angle_of_versine(
            jnp.minimum(along / (1 + jnp.maximum(half.z, 0)), 1)
        )
        roughness = matching(self.roughness, squared_angle)
        angles, weights = self._quadrature(squared_angle)
        area = 2 * jnp.pi * jnp.sum(weights * jnp.sin(angles) * jnp.cos(angles))
        return jnp.exp(-squared_angle / roughness**2) / area

    def smith_lambda(self, direction: Components) -> Float[Array, "*batch"]:
        """Integrate the visible facets: over azimuth exactly, over their angle by quadrature."""
        cosines = jnp.asarray(direction.z)
        # The floor keeps the square root's derivative finite head-on.
        sines = jnp.sqrt(jnp.maximum(1 - cosines * cosines, float(jnp.finfo(cosines.dtype).eps)))
        angles, weights = self._quadrature(cosines)

        def add(total: Array, node: tuple[Array, Array]) -> tuple[Array, None]:
            angle, weight = node
            facing = ring_facing(cosines * jnp.cos(angle), sines * jnp.sin(angle))
            return total + weight * jnp.sin(angle) * facing, None

        seen, _ = jax.lax.scan(add, jnp.zeros_like(cosines), (angles, weights))
        area = 2 * jnp.pi * jnp.sum(weights * jnp.sin(angles) * jnp.cos(angles))
        return jnp.maximum(seen / (area * cosines) - 1, 0)

    def _quadrature(
        self, like: Float[AnyArray, "..."]
    ) -> tuple[Float[Array, "node"], Float[Array, "node"]]:
        """Angles from the normal, and weights that contain the Gaussian."""
        roughness = matching(self.roughness, like)
        reach = jnp.minimum(_REACH * roughness, np.pi / 2)
        angles = reach * matching(_NODES, like)
        weights = reach * matching(_WEIGHTS, like)
        return angles, weights * jnp.exp(-((angles / roughness) ** 2))


class Beckmann(Distribution):
    """D = exp(-tan^2 t_h / a^2) / (pi a^2 cos^4 t_h): slopes are Gaussian with variance a^2 / 2.

    ``roughness`` is along the tangent +X, ``roughness_y`` along +Y (``None``: the same).
    """

    roughness: Scalar = eqx.field(converter=as_scalar)
    roughness_y: Scalar | None = eqx.field(converter=as_scalar_or_none, default=None)

    def __check_init__(self):
        _refuse_roughnesses(self.roughness, self.roughness_y)

    def density(self, half: Components) -> Float[Array, "*batch"]:
        """Evaluate the Gaussian in the slopes."""
        ax, ay = _both(self.roughness, self.roughness_y, half.z)
        squared_cosine = jnp.maximum(half.z * half.z, STEEPEST)
        squared_slope = ((half.x / ax) ** 2 + (half.y / ay) ** 2) / squared_cosine
        return jnp.exp(-squared_slope) / (jnp.pi * ax * ay * squared_cosine**2)

    def smith_lambda(self, direction: Components) -> Float[Array, "*batch"]:
        """Evaluate exp(-q^2) / (2 q sqrt(pi)) - erfc(q) / 2 with q = 1 / (a tan t)."""
        ax, ay = _both(self.roughness, self.roughness_y, direction.z)
        squared = _squared_slope(direction, ax, ay)
        q = 1 / jnp.sqrt(jnp.maximum(squared, _FLATTEST))
        return (erf(q) - 1) / 2 + jnp.exp(-(q**2)) / (2 * q * math.sqrt(math.pi))


class TrowbridgeReitz(Distribution):
    """D = 1 / (pi ax ay ((h_x / ax)^2 + (h_y / ay)^2 + h_z^2)^2), also called GGX.

    ``roughness`` is along the tangent +X, ``roughness_y`` along +Y (``None``: the same).
    """

    roughness: Scalar = eqx.field(converter=as_scalar)
    roughness_y: Scalar | None = eqx.field(converter=as_scalar_or_none, default=None)

    def __check_init__(self):
        _refuse_roughnesses(self.roughness, self.roughness_y)

    def density(self, half: Components) -> Float[Array, "*batch"]:
        """Evaluate the density of an ellipsoid's normals."""
        ax, ay = _both(self.roughness, self.roughness_y, half.z)
        stretched = (half.x / ax) ** 2 + (half.y / ay) ** 2 + half.z * half.z
        return 1 / (jnp.pi * ax * ay * stretched**2)

    def smith_lambda(self, direction: Components) -> Float[Array, "*batch"]:
        """Evaluate (sqrt(1 + a^2 tan^2 t) - 1) / 2."""
        ax, ay = _both(self.roughness, self.roughness_y, direction.z)
        return (jnp.sqrt(1 + _squared_slope(direction, ax, ay)) - 1) / 2


DISTRIBUTIONS: dict[str, type[Gaussian] | type[Beckmann] | type[TrowbridgeReitz]] = {
    "gaussian": Gaussian,
    "beckmann": Beckmann,
    "ggx": TrowbridgeReitz,
}


def _refuse_roughnesses(roughness: Scalar, roughness_y: Scalar | None) -> None:
    refuse_outside("roughness", roughness, "(0, 1]", _SMOOTHER)
    if roughness_y is not None:
        refuse_outside("roughness_y", roughness_y, "(0, 1]", _SMOOTHER)


def _both(
    roughness: Scalar, roughness_y: Scalar | None, like: Float[AnyArray, "..."]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    along = matching(roughness, like)
    return along, along if roughness_y is None else matching(roughness_y, like)


def _squared_slope(
    direction: Components, ax: Float[Array, ""], ay: Float[Array, ""]
) -> Float[Array, "*batch"]:
    """Evaluate a^2 tan^2 t with the roughness a in the direction's own azimuth."""
    return ((ax * direction.x) ** 2 + (ay * direction.y) ** 2) / direction.z**2


def ring_facing(a: Float[Array, "*batch"], b: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Evaluate int_0^2pi max(a + b cos p, 0) dp for a, b >= 0."""
    turned_away = a < b
    cosine = jnp.where(turned_away, -a / jnp.where(turned_away, b, 1), 0)
    # Strictly inside (-1, 0]: arc cosine's derivative is infinite at the end.
    cosine = jnp.maximum(cosine, -1 + float(jnp.finfo(a.dtype).eps))
    edge = jnp.arccos(cosine)
    return jnp.where(turned_away, 2 * (a * edge + b * jnp.sin(edge)), 2 * np.pi * a)
