"""Coefficients of any BRDF by quadrature over both hemispheres (T 2.38, 2.47 to 2.59).

All are those of the transfer function rho^ = rho cos t_i about the *normal*, complex harmonics with
the Condon-Shortley sign (T 2.26), one array for each of the BRDF's lobes at amplitude one:

    rho^ = sum rho_{ln,pq} Y*_ln(i) Y_pq(o)     anisotropic, T 2.38
    rho^ = sum rho_lpq Y*_lq(i) Y_pq(o)         isotropic, T 2.53: real, and the same for -q
    rho^ = sum rho_ln(o) Y*_ln(i)               at a fixed exit o, T 2.44, and T 2.56 isotropic

``reciprocal=True`` takes rho~ = rho cos t_i cos t_o instead (T 2.58), of which
rho~_lpq = rho~_plq, and rho~_{ln,pq} = conj(rho~_{pq,ln}): without the conjugate, as printed, it is
false (ERRATA 9).  Note that T 3.42's rho^, which rises as 1 / cos t_o, has no finite energy about
the normal (ERRATA 24): use the reciprocal form, or a fixed exit angle.

The rules are products of Gauss-Legendre in the cosine and equal azimuths; a lobe narrower than a
few of their nodes (pi / 2 over ``polar``) needs a finer rule.  Differentiable in the BRDF.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Inexact

from jaxrender.brdf import BRDF
from jaxrender.geometry import Components
from jaxrender.harmonics import associated, coefficient_count, complex_basis
from jaxrender.shapes import AnyArray, Array, Complex, Float, checked


class PolarRule(NamedTuple):
    """Cosines from 0 to 1 and their weights, which sum to 1."""

    cosines: Float[np.ndarray, "row"]
    weights: Float[np.ndarray, "row"]


class HemisphereRule(eqx.Module):
    """Quadrature over the upper hemisphere: ``polar`` rows, ``azimuth`` columns; all static.

    Raises ``ValueError`` for a side below 1.
    """

    polar: int = eqx.field(static=True, default=32)
    azimuth: int = eqx.field(static=True, default=64)

    def __check_init__(self):
        if self.polar < 1 or self.azimuth < 1:
            raise ValueError(
                f"a rule of {self.polar} rows and {self.azimuth} columns; give 1 or more of each"
            )

    def rows(self) -> PolarRule:
        """Gauss and Legendre's rule over the cosine."""
        cosines, weights = np.polynomial.legendre.leggauss(self.polar)
        return PolarRule((cosines + 1) / 2, weights / 2)

    def azimuths(self) -> Float[np.ndarray, "column"]:
        """Equal steps over the circle; none at 0."""
        return (np.arange(self.azimuth) + 0.5) * 2 * np.pi / self.azimuth

    def directions(self) -> Float[np.ndarray, "node 3"]:
        """Every row at every azimuth, row by row."""
        cosines, azimuths = self.rows().cosines[:, None], self.azimuths()[None, :]
        sines = np.sqrt(1 - cosines**2)
        x, y = sines * np.cos(azimuths), sines * np.sin(azimuths)
        z = np.broadcast_to(cosines, x.shape)
        return np.stack([x, y, z], axis=-1).reshape(-1, 3)

    def weights(self) -> Float[np.ndarray, "node"]:
        """Solid angle of each direction; sums to 2 pi."""
        return np.repeat(self.rows().weights, self.azimuth) * 2 * np.pi / self.azimuth


def isotropic_coefficients(
    brdf: BRDF,
    band_limits: tuple[int, int],
    rule: HemisphereRule | None = None,
    reciprocal: bool = False,
) -> Float[Array, "lobe degree outgoing_degree order"]:
    """Compute rho_lpq for l and p to the two band limits and q = 0 ... min of them (T 2.47, 2.53).

    Zero where q > min(l, p).
    Raises ``ValueError`` for an anisotropic BRDF, and for degrees that the rule cannot tell.
    """
    _check_isotropic(brdf)
    rule = HemisphereRule() if rule is None else rule
    _check(band_limits, rule)
    cosines, weights = rule.rows()
    values = _ring_values(brdf, cosines, rule, reciprocal)
    limit = min(band_limits)
    incoming, outgoing = (
        jnp.asarray(_polar_factors(cosines, band, limit) * weights, values.dtype)
        for band in band_limits
    )
    waves = _waves(rule, limit, values)
    return jnp.einsum(
        "kioa,aq,lqi,pqo->klpq", values, waves, incoming, outgoing, precision="highest"
    ) * (2 * np.pi)


@checked
def outgoing_coefficients(
    brdf: BRDF,
    exit_cosines: Float[AnyArray, "bin"],
    band_limit: int,
    rule: HemisphereRule | None = None,
) -> Float[Array, "lobe bin degree order"]:
    """Compute rho_lq(t_o) of an isotropic BRDF at given exit cosines, q = 0 ... F (T 2.56, 2.57).

    rho_lq(t_o) = sqrt(2 pi) int rho^ Y_lq dw_i at azimuth 0 of the exit; for -q, (-1)^q times it.
    Of degree 0: sqrt(2 pi) Lambda_0^-1 times the directional albedo (ERRATA 14).
    Raises as ``isotropic_coefficients``.
    """
    _check_isotropic(brdf)
    rule = HemisphereRule() if rule is None else rule
    _check((band_limit, 0), rule)
    cosines, weights = rule.rows()
    values = _ring_values(brdf, exit_cosines, rule, False)
    factors = _polar_factors(cosines, band_limit, band_limit) * weights
    sign = ((-1.0) ** np.arange(band_limit + 1))[None, :, None]
    incoming = jnp.asarray(sign * factors, values.dtype)
    waves = _waves(rule, band_limit, values)
    found = jnp.einsum("kioa,aq,lqi->kolq", values, waves, incoming, precision="highest")
    return found * float(np.sqrt(2 * np.pi))


def anisotropic_coefficients(
    brdf: BRDF,
    band_limits: tuple[int, int],
    rule: HemisphereRule | None = None,
    reciprocal: bool = False,
) -> Complex[Array, "lobe coefficient outgoing_coefficient"]:
    """Compute rho_{ln,pq} for degrees l and p to the two band limits (T 2.38), any BRDF.

    The work is the square of the rule's number of directions; the default has four rows more than
    the degree, good for smooth BRDFs.
    Raises ``ValueError`` for degrees that the rule cannot tell.
    """
    rule = _coarsest_rule(band_limits) if rule is None else rule
    _check(band_limits, rule)
    directions, weights = rule.directions(), rule.weights()
    pairs = (len(directions), len(directions), 3)
    incoming = np.broadcast_to(directions[:, None, :], pairs)
    outgoing = np.broadcast_to(directions[None, :, :], pairs)
    values = _lobes(brdf, incoming, outgoing, reciprocal)
    weights = jnp.asarray(weights[:, None], values.dtype)
    bases = (complex_basis(jnp.asarray(directions, values.dtype), band) for band in band_limits)
    first, second = (basis * weights.astype(basis.dtype) for basis in bases)
    return jnp.einsum(
        "kio,ia,ob->kab", values.astype(first.dtype), first, second.conj(), precision="highest"
    )


@checked
def anisotropic_outgoing_coefficients(
    brdf: BRDF,
    outgoing: Float[AnyArray, "exit 3"],
    band_limit: int,
    rule: HemisphereRule | None = None,
) -> Complex[Array, "lobe exit coefficient"]:
    """Compute rho_ln(o) = int rho^(i, o) Y_ln(i) dw_i at local exit directions (T 2.44), any BRDF.

    The sum over p, q of rho_{ln,pq} Y_pq(o), without the need to expand the exit.  The default rule
    has four rows more than the degree, and 32 at least.
    Raises ``ValueError`` for degrees that the rule cannot tell.
    """
    if rule is None:
        rows = max(HemisphereRule().polar, band_limit + 4)
        rule = HemisphereRule(rows, 2 * rows)
    _check((band_limit, 0), rule)
    directions, weights = rule.directions(), rule.weights()
    away = jnp.asarray(outgoing)
    pairs = (away.shape[0], len(directions), 3)
    values = _lobes(
        brdf,
        jnp.broadcast_to(jnp.asarray(directions)[None, :, :], pairs),
        jnp.broadcast_to(away[:, None, :], pairs),
        False,
    )
    basis = complex_basis(jnp.asarray(directions, values.dtype), band_limit)
    basis = basis * jnp.asarray(weights[:, None], values.dtype).astype(basis.dtype)
    return jnp.einsum("koi,ia->koa", values.astype(basis.dtype), basis, precision="highest")


@checked
def sum_lobes(
    coefficients: Inexact[AnyArray, "lobe *rest"], amplitudes: Float[AnyArray, "lobe channel"]
) -> Inexact[Array, "*rest channel"]:
    """Weigh the lobes' coefficients by ``brdf.amplitudes``: the whole BRDF's, a colour each.

    Coefficients come with one lobe a row, as the functions above return them; the forms of
    ``reflection.convolution`` want them summed.
    """
    values = jnp.asarray(coefficients)
    weights = jnp.asarray(amplitudes).astype(values.dtype)
    return jnp.einsum("k...,kc->...c", values, weights, precision="highest")


def _check_isotropic(brdf: BRDF) -> None:
    if not brdf.isotropic:
        raise ValueError(
            f"{type(brdf).__name__} is anisotropic: its orders mix; use anisotropic_coefficients"
        )


def _coarsest_rule(band_limits: tuple[int, int]) -> HemisphereRule:
    rows = max(band_limits) + 4
    return HemisphereRule(rows, 2 * rows)


def _check(band_limits: tuple[int, int], rule: HemisphereRule) -> None:
    for limit in band_limits:
        coefficient_count(limit)
    if max(band_limits) >= min(rule.polar, rule.azimuth // 2):
        raise ValueError(
            f"degree {max(band_limits)} cannot be determined with {rule.polar} rows and "
            f"{rule.azimuth} columns: give a rule with more rows than the degree, and twice as "
            "many columns"
        )


def _ring_values(
    brdf: BRDF, exit_cosines: Float[AnyArray, "exit"], rule: HemisphereRule, reciprocal: bool
) -> Float[Array, "lobe row exit azimuth"]:
    """Evaluate every lobe for the incoming rows, the exits at azimuth 0, and each azimuth."""
    numbers = jnp if isinstance(exit_cosines, Tracer) else np
    cosines = rule.rows().cosines
    shape = (len(cosines), len(exit_cosines), rule.azimuth)
    cos_i = np.broadcast_to(cosines[:, None, None], shape)
    cos_o = numbers.broadcast_to(exit_cosines[None, :, None], shape)
    azimuth = np.broadcast_to(rule.azimuths()[None, None, :], shape)
    sin_i, sin_o = np.sqrt(1 - cos_i**2), numbers.sqrt(numbers.maximum(1 - cos_o**2, 0))
    incoming = np.stack([sin_i * np.cos(azimuth), sin_i * np.sin(azimuth), cos_i], axis=-1)
    outgoing = numbers.stack([sin_o, numbers.zeros_like(sin_o), cos_o], axis=-1)
    return _lobes(brdf, incoming, outgoing, reciprocal)


@eqx.filter_jit
def _lobes(
    brdf: BRDF,
    incoming: Float[AnyArray, "*batch 3"],
    outgoing: Float[AnyArray, "*batch 3"],
    reciprocal: bool,
) -> Float[Array, "lobe *batch"]:
    """Evaluate rho^ of every lobe, or rho~ (T 2.58), in the precision of the BRDF."""
    dtype = jnp.asarray(brdf.amplitudes).dtype
    towards, away = (
        Components.of(jnp.asarray(directions, dtype)) for directions in (incoming, outgoing)
    )
    values = jnp.stack(brdf.transfer(towards, away))
    return values * away.z[None] if reciprocal else values


def _polar_factors(
    cosines: Float[np.ndarray, "row"], band_limit: int, order_limit: int
) -> Float[np.ndarray, "degree order row"]:
    """Tabulate |Y_lq| at azimuth 0: N_lq P_lq without the Condon-Shortley sign."""
    table = associated(cosines, np.sqrt(1 - cosines**2), band_limit)[:, : order_limit + 1]
    # The real harmonics of q > 0 carry a factor sqrt(2) that the complex ones do not.
    return table * np.where(np.arange(table.shape[1]) > 0, np.sqrt(0.5), 1.0)[None, :, None]


def _waves(rule: HemisphereRule, order_limit: int, like: Array) -> Float[Array, "azimuth order"]:
    orders = np.arange(order_limit + 1)
    step = 2 * np.pi / rule.azimuth
    return jnp.asarray(step * np.cos(rule.azimuths()[:, None] * orders[None, :]), like.dtype)
