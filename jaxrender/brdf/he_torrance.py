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
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import erfc, gammaln

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.cook_torrance import diagonal_amplitudes, refuse_metal
from jaxrender.brdf.fresnel import conductor_fresnel
from jaxrender.brdf.half_vector import are_visible, half_vector, lifted
from jaxrender.brdf.parameters import (
    Scalar,
    as_scalar,
    matching,
    refuse_other_channels,
    refuse_outside,
)
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float

# The series is summed over at most this many m, from g - 6 sqrt(g) to g + 6 sqrt(g); where these
# are more than a step of 1 apart, the Poisson weights are smooth enough for longer steps.  The
# error is below 1e-7 of the sum's largest value over all directions at that g.
_TERMS = 64
_DEVIATIONS = 6.0
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
        sigma, shadowing = self._seen_surface(incoming.z, outgoing.z)
        cosine = jnp.minimum(half_vector(incoming, outgoing).cosine, 1)
        cosines = incoming.z + outgoing.z
        tangential = (incoming.x + outgoing.x) ** 2 + (incoming.y + outgoing.y) ** 2
        tau = matching(self.correlation_length, cosine)
        shared = shadowing * (4 * cosine**2 / cosines) ** 2 / (np.pi * outgoing.z)
        lobes = []
        for wavelength, eta, k in self._channels(cosine):
            per_length = 2 * np.pi / wavelength
            g = (per_length * sigma * cosines) ** 2
            series = diffraction_series(g, tangential * (per_length * tau / 2) ** 2)
            density = (np.pi * tau / (2 * wavelength)) ** 2 * series
            lobe = shared * density * conductor_fresnel(eta, k, cosine)
            lobes.append(jnp.where(visible, lobe, 0))
        return jnp.where(visible, incoming.z, 0), *lobes

    def specular_reflectance(
        self, cosines: Float[AnyArray, "*batch"]
    ) -> Float[Array, "*batch channel"]:
        """Evaluate ks F S exp(-g), the share that is reflected as by a mirror."""
        cosines = jnp.maximum(cosines, 1e-6)
        sigma, shadowing = self._seen_surface(cosines, cosines)
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

    def _seen_surface(
        self, cos_in: Float[AnyArray, "*#batch"], cos_out: Float[AnyArray, "*#batch"]
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
        """The roughness of the part that is seen and lit, and the share of it that is."""
        roughness = matching(self.roughness, cos_in)
        slope = 2 * roughness / matching(self.correlation_length, cos_in)
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
    deviation = jnp.sqrt(g)
    first = jnp.maximum(g - _DEVIATIONS * deviation, 1)
    step = jnp.maximum(2 * _DEVIATIONS / _TERMS * deviation, 1)

    def add(total: Array, index: Array) -> tuple[Array, None]:
        m = first + step * index
        return total + jnp.exp(_poisson_logarithm(m, g) - q / m) / m, None

    indices = jnp.arange(_TERMS, dtype=g.dtype)
    total, _ = jax.lax.scan(add, jnp.zeros_like(g + q), indices)
    return total * step


def _poisson_logarithm(m: Float[Array, "*batch"], g: Float[Array, "*batch"]) -> Array:
    """Evaluate log(exp(-g) g^m / m!) by its distance from the peak, which does not cancel."""
    near = m < 16
    small, large = jnp.where(near, m, 1), jnp.where(near, 16, m)
    # What Stirling's formula leaves of log m!.
    exact = gammaln(small + 1) - (small + 0.5) * jnp.log(small) + small - math.log(2 * math.pi) / 2
    inverse = 1 / large
    series = inverse * (1 / 12 - inverse**2 * (1 / 360 - inverse**2 / 1260))
    rest = jnp.where(near, exact, series)
    deviance = m * jnp.log(m / g) - (m - g)
    excess = (m - g) / g
    close = jnp.abs(excess) < 0.5
    bounded = jnp.where(close, excess, 0)
    deviance = jnp.where(close, g * ((1 + bounded) * jnp.log1p(bounded) - bounded), deviance)
    return -deviance - jnp.log(2 * np.pi * m) / 2 - rest
