"""He, Torrance, Sillion and Greenberg's model of 1991: diffraction by a rough surface, unpolarised.

The surface's height has the deviation ``roughness`` (sigma_0) and its correlation falls as
exp(-(x / tau)^2) over the ``correlation_length`` tau; both in the unit of the ``wavelengths``.

rho_c = kd_c + ks_c F(eta_c, k_c, w_i . h) S D (2 (1 + w_i . w_o) / (cos t_i + cos t_o))^2
        / (pi cos t_i cos t_o)
D = (pi tau / (2 lambda))^2 sum_m exp(-g) g^m / (m! m) exp(-v^2 tau^2 / (4 m))         (their 78)

with v = 2 pi |(w_i + w_o)_xy| / lambda, g = (2 pi sigma (cos t_i + cos t_o) / lambda)^2 and sigma
the roughness of the part of the surface that is seen and lit (80).  Their geometric factor (76) is
the square above for unpolarised light: each bracket there is |w_i x w_o|^2.  S is Smith's masking
in Sancer's form (23 to 25), with the exponential that the printed Lambda lacks.  For rough surfaces
all of it is Beckmann's lobe of roughness 2 sigma / tau over 4 cos t_i cos t_o.

The light that is reflected as by a mirror, F S exp(-g), is a delta and no part of the transfer
function: ``specular_reflectance`` states it.

``HeTorranceLobe`` is the model with one lobe for all channels, which a fit can recover.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import erfc

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.cook_torrance import diagonal_amplitudes, refuse_metal
from jaxrender.brdf.fresnel import conductor_fresnel, fresnel, head_on_reflectance
from jaxrender.brdf.glossy import Glossy
from jaxrender.brdf.half_vector import are_visible, half_vector, lifted
from jaxrender.brdf.parameters import (
    Scalar,
    as_scalar,
    as_scalar_or_none,
    matching,
    refuse_other_channels,
    refuse_outside,
)
from jaxrender.brdf.parametric import ShapeParameter
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float, checked

# Up to this g the series is summed to 6 standard deviations above its mean, from there on it is
# expanded in so many moments; the error is below 1e-7 of the sum's largest value over all
# directions at that g.
_SMOOTH, _TERMS, _MOMENTS = 64.0, 112, 12
_TERMS_AT_ONCE = 8
_VANISHED = 90.0
# Newton's steps for u exp(u) = c: ten settle any c up to 1e12, which is grazing.
_NEWTON_STEPS = 10
# Lambda is 0 in any precision for slopes q = cot t / (2 sigma / tau) above it.
_LARGEST_Q = 30.0


class HeTorrance(BRDF):
    """Directional-diffuse and uniform-diffuse reflection of a rough surface, index eta + i k.

    ``ks`` scales the physical lobe of each channel and is 1 for a clean surface.  Raises
    ``ValueError`` for roughness or lengths not above 0 and arrays of other numbers of channels.
    """

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    roughness: Scalar = eqx.field(converter=as_scalar)
    correlation_length: Scalar = eqx.field(converter=as_scalar)
    wavelengths: Float[AnyArray, "_"]
    eta: Float[AnyArray, "_"]
    k: Float[AnyArray, "_"]

    def __check_init__(self):
        same_unit = "in the unit of the wavelengths, such as micrometres"
        refuse_outside("roughness", self.roughness, "(0, inf)", same_unit)
        refuse_outside("correlation_length", self.correlation_length, "(0, inf)", same_unit)
        refuse_outside("wavelengths", self.wavelengths, "(0, inf)", "red is .61 micrometres")
        refuse_other_channels("wavelengths", self.wavelengths, self.kd.shape[0])
        refuse_metal(self.eta, self.k, self.kd.shape[0])

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """The clamped cosine's row kd, then each channel's own lobe: ks on the diagonal."""
        return diagonal_amplitudes(self.kd, self.ks)

    @property
    def reciprocal(self) -> bool:
        """Always."""
        return True

    @property
    def conserves_energy(self) -> bool:
        """Never promised: a single scattering by Kirchhoff's approximation has no such bound."""
        return False

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate the clamped cosine, and the directional-diffuse part of each channel."""
        visible = are_visible(incoming, outgoing)
        incoming, outgoing = lifted(incoming), lifted(outgoing)
        roughness, length = (
            matching(v, incoming.z) for v in (self.roughness, self.correlation_length)
        )
        lobe_at, cosine = _white_lobe(roughness, length, incoming, outgoing)
        lobes = []
        for wavelength, eta, k in self._channels(cosine):
            lobe = lobe_at(wavelength) * conductor_fresnel(eta, k, cosine)
            lobes.append(jnp.where(visible, lobe, 0))
        return jnp.where(visible, incoming.z, 0), *lobes

    @checked
    def specular_reflectance(
        self, cosines: Float[AnyArray, "*batch"]
    ) -> Float[Array, "*batch channel"]:
        """Evaluate ks F S exp(-g), the share that is reflected as by a mirror."""
        cosines = jnp.maximum(cosines, 1e-6)
        roughness, length = (
            matching(v, cosines) for v in (self.roughness, self.correlation_length)
        )
        sigma, shadowing = _seen_surface(roughness, length, cosines, cosines)
        shares = []
        for (wavelength, eta, k), scale in zip(
            self._channels(cosines), matching(self.ks, cosines), strict=True
        ):
            g = (4 * np.pi / wavelength * sigma * cosines) ** 2
            mirrored = conductor_fresnel(eta, k, cosines) * shadowing * jnp.exp(-g)
            shares.append(scale * mirrored)
        return jnp.stack(shares, axis=-1)

    def _channels(self, like: Float[AnyArray, "..."]) -> zip:
        """The wavelength and complex index of each channel."""
        return zip(*(matching(v, like) for v in (self.wavelengths, self.eta, self.k)), strict=True)


class HeTorranceLobe(Glossy):
    """One lobe of the model for all channels, of index ``mu`` at the half angle (None: F = 1).

    ``roughness`` in (0, 1] is 2 sigma / tau, Beckmann's in the limit of a rough surface;
    ``deviation`` is sigma in wavelengths, from which the lobe's diffraction follows.  ``ks`` scales
    the physical lobe.  Raises ``ValueError`` for values outside.
    """

    shape: ClassVar[ShapeParameter] = ShapeParameter("roughness")

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    roughness: Scalar = eqx.field(converter=as_scalar)
    mu: Scalar | None = eqx.field(converter=as_scalar_or_none, default=None)
    deviation: Scalar = eqx.field(converter=as_scalar, default=0.5)

    def __check_init__(self):
        refuse_outside("roughness", self.roughness, "(0, 1]", "2 sigma over the correlation length")
        refuse_outside("deviation", self.deviation, "(0, inf)", "in wavelengths, .2 is smooth")
        if self.mu is not None:
            refuse_outside("mu", self.mu, "(1, inf)", "None sets the Fresnel factor to 1")

    @property
    def sigma(self) -> Scalar:
        """The roughness, as a lobe's width."""
        return self.roughness

    @property
    def reciprocal(self) -> bool:
        """Always."""
        return True

    @property
    def conserves_energy(self) -> bool:
        """Never promised, as of ``HeTorrance``."""
        return False

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    @property
    def fresnel_is_factor(self) -> bool:
        """Only where there is none: it is taken at the half angle."""
        return self.mu is None

    @property
    def reach(self) -> None:
        """None: diffraction by a surface that is not much rougher than a wave has a tail."""
        return None

    @property
    def energy(self) -> Scalar:
        """F(mu, 0) of what is not reflected as by a mirror, 1 - exp(-(4 pi deviation)^2)."""
        reflectance = 1.0 if self.mu is None else head_on_reflectance(self.mu)
        return -reflectance * jnp.expm1(-((4 * np.pi * self.deviation) ** 2))

    def as_metal(self) -> "HeTorranceLobe":
        """Have no factor to drop: the reflectance belongs to the lobe."""
        return self

    def specular_transfer(
        self, incoming: Components, outgoing: Components
    ) -> Float[Array, "*batch"]:
        """Evaluate the lobe times cos t_i."""
        incoming, outgoing = lifted(incoming), lifted(outgoing)
        deviation, slope = (matching(v, incoming.z) for v in (self.deviation, self.roughness))
        lobe_at, cosine = _white_lobe(deviation, 2 * deviation / slope, incoming, outgoing)
        lobe = lobe_at(jnp.ones((), cosine.dtype))
        return lobe if self.mu is None else lobe * fresnel(matching(self.mu, cosine), cosine)


def _white_lobe(
    roughness: Float[Array, ""],
    length: Float[Array, ""],
    incoming: Components,
    outgoing: Components,
) -> tuple[Callable[[Float[Array, ""]], Float[Array, "*batch"]], Float[Array, "*batch"]]:
    """Return what gives the lobe times cos t_i without Fresnel's factor, and the half cosine.

    It is given a wavelength; what all wavelengths have in common is found once.
    """
    sigma, shadowing = _seen_surface(roughness, length, incoming.z, outgoing.z)
    cosine = jnp.minimum(half_vector(incoming, outgoing).cosine, 1)
    cosines = incoming.z + outgoing.z
    tangential = jnp.asarray((incoming.x + outgoing.x) ** 2 + (incoming.y + outgoing.y) ** 2)
    shared = shadowing * (4 * cosine**2 / cosines) ** 2 / (np.pi * outgoing.z)

    def lobe_at(wavelength: Float[Array, ""]) -> Float[Array, "*batch"]:
        per_length = 2 * np.pi / wavelength
        g = (per_length * sigma * cosines) ** 2
        series = diffraction_series(g, tangential * (per_length * length / 2) ** 2)
        return shared * (np.pi * length / (2 * wavelength)) ** 2 * series

    return lobe_at, cosine


def _seen_surface(
    roughness: Float[Array, ""],
    length: Float[Array, ""],
    cos_in: Float[AnyArray, "*#batch"],
    cos_out: Float[AnyArray, "*#batch"],
) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
    """The roughness of the part that is seen and lit, and the share of it that is."""
    slope = 2 * roughness / length
    shadowing, hidden = 1.0, 0.0
    for cosine in (cos_in, cos_out):
        # The floor keeps the square root's derivative finite head-on.
        eps = float(jnp.finfo(cosine.dtype).eps)
        cotangent = cosine / jnp.sqrt(jnp.maximum(1 - cosine * cosine, eps))
        q = jnp.minimum(cotangent / slope, _LARGEST_Q)
        tail = erfc(q)
        smith = jnp.exp(-q * q) / (2 * q * math.sqrt(math.pi)) - tail / 2
        shadowing = shadowing * (1 - tail / 2) / (1 + smith)
        hidden = hidden + tail / cotangent
    # x exp(x^2 / 2) = c with x = z_0 / sigma_0 is u exp(u) = c^2 with u = x^2     (81)
    u = product_logarithm(hidden**2 / (8 * np.pi))
    return roughness / jnp.sqrt(1 + u), shadowing


def product_logarithm(c: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Solve u exp(u) = c for u >= 0 by Newton's method, from log(1 + c), which lies above."""
    u = jnp.log1p(c)
    for _ in range(_NEWTON_STEPS):
        u = (u * u + c * jnp.exp(-u)) / (1 + u)
    return u


def diffraction_series(
    g: Float[Array, "*#batch"], q: Float[Array, "*#batch"]
) -> Float[Array, "*batch"]:
    """Evaluate sum_{m >= 1} exp(-g) g^m / (m! m) exp(-q / m), the mean over Poisson's law of m."""
    return jnp.where(g < _SMOOTH, _summed(jnp.minimum(g, _SMOOTH), q), _by_moments(g, q))


def _summed(g: Float[Array, "*#batch"], q: Float[Array, "*#batch"]) -> Float[Array, "*batch"]:
    """Sum the series term by term."""

    def add(carry: tuple[Array, Array], m: Array) -> tuple[tuple[Array, Array], None]:
        weight, total = carry
        weight = weight * (g / m)
        return (weight, total + weight / m * jnp.exp(-q / m)), None

    start = jnp.exp(-g), jnp.zeros_like(g + q)
    orders = jnp.arange(1, _TERMS + 1, dtype=g.dtype)
    return jax.lax.scan(add, start, orders, unroll=_TERMS_AT_ONCE)[0][1]


def _by_moments(g: Float[Array, "*#batch"], q: Float[Array, "*#batch"]) -> Float[Array, "*batch"]:
    """Expand about the mean: m = g (1 + d) makes exp(-q / m) / m a generating function.

    exp(-z / (1 + d)) / (1 + d) = exp(-z) sum_k L_k(z) (-d)^k, z = q / g, with Laguerre's
    polynomials, and the means of d^k are Poisson's central moments over g^k.
    """
    g = jnp.maximum(g, _SMOOTH)
    # Further off exp(-z) is zero, and powers of z would overflow.
    z = jnp.minimum(q / g, _VANISHED)
    before, here, total = jnp.zeros_like(z), jnp.ones_like(z), jnp.zeros_like(z)
    for k, moment in enumerate(_poisson_moments(_MOMENTS)):
        # Coefficients of g^0 to g^k, divided by g^k, are those of a polynomial in 1 / g.
        mean = jnp.polyval(jnp.asarray(moment, g.dtype), 1 / g)
        total = total + (-1) ** k * mean * here
        before, here = here, ((2 * k + 1 - z) * here - k * before) / (k + 1)
    return jnp.exp(-z) / g * total


@lru_cache(maxsize=1)
def _poisson_moments(highest: int) -> list[Float[np.ndarray, "power"]]:
    """Return Poisson's central moments as coefficients of g^0 to g^k: mu_n = g sum C mu_k."""
    moments = [np.eye(1, highest + 1)[0]]
    for n in range(highest):
        below = sum((math.comb(n, k) * moments[k] for k in range(n)), np.zeros(highest + 1))
        moments.append(np.roll(below, 1))
    return [moment[: k + 1] for k, moment in enumerate(moments)]
