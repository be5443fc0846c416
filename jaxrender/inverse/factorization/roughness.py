"""Roughness from a directional source in a light that was recovered filtered (T 6.25, fig. 6.6).

Light recovered by F alone (T 6.15) is the true light as the lobe filters it, to degree l* only.  A
source of irradiance E in direction s then shows as E sum_l h_l(sigma) (2l+1)/(4 pi) P_l(w . s).  So
its brightest point L_cen over its total L_tot gives sigma.  T 6.25 takes it for a plane Gaussian,

    L_cen = L_tot / (4 pi sigma^2)

which is low by 4.3, 8.4, 12 % at sigma .1, .2, .3 where exp(-(sigma l)^2) filters, and by .2, .7,
1.5 % where exp(-sigma^2 l(l+1)) does (ERRATA 48).  It leaves l* out.  Here the sum itself is
inverted, for the region at hand; the light around the source is subtracted on both sides.  A sum
over a cap needs the mean over azimuth alone, so that all of this is exact in the coefficients.
Host side.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq
from scipy.special import eval_legendre

from jaxrender.brdf import WIDTH_BOUNDS, Microfacet, normalised_fresnel
from jaxrender.geometry import fibonacci_sphere
from jaxrender.harmonics import band_limit_of, degree_table, evaluate
from jaxrender.shapes import AnyArray, Array, Float
from jaxrender.spectra import exit_cosine_transfer

# Directions tried in the search for a peak: 1.5 degrees apart, a tenth of a lobe at degree 12.
_DIRECTIONS = 16384
# A source's peak is at least this many times as bright as the rim of its region.
_LEAST_CONTRAST = 2.0
# Where no radius is given, a region reaches no farther than this from its peak.
_WIDEST_REGION = 1.2

# The peak is looked for around the brightest direction tried, in ever smaller steps (radians); near
# a maximum rounding hides what lies closer.
_FIRST_STEP, _LAST_STEP = 0.02, 1e-8

Filter = Callable[[float], Float[np.ndarray, "degree"]]


class Region(NamedTuple):
    """Where to look for the source: within ``radius`` (radians) of ``direction``."""

    direction: Float[AnyArray, "3"]
    radius: float


class SourceRoughness(NamedTuple):
    """The roughness by a source: its peak, the radiance there, and the sum over its region.

    ``rim`` is the mean radiance at the region's edge, which stands for the light around the source.
    """

    sigma: float
    direction: Float[np.ndarray, "3"]
    radius: float
    centre: float
    total: float
    rim: float

    @property
    def printed(self) -> float:
        """The roughness by T 6.25 as printed."""
        return float(np.sqrt(self.total / (4 * np.pi * self.centre)))


def diffusion_filter(band_limit: int) -> Filter:
    """exp(-sigma^2 l(l+1)): closest to a microfacet lobe of the closed forms (ERRATA 27)."""
    degree = np.arange(band_limit + 1)
    return lambda sigma: np.exp(-(sigma**2) * degree * (degree + 1))


def gaussian_filter(band_limit: int) -> Filter:
    """exp(-(sigma l)^2), T 6.7."""
    degree = np.arange(band_limit + 1)
    return lambda sigma: np.exp(-((sigma * degree) ** 2))


def lobe_filter(
    variant: Microfacet,
    band_limit: int,
    cosines: Float[AnyArray, "bin"] | None = None,
    counts: Float[AnyArray, "bin"] | None = None,
) -> Filter:
    """Filter as the lobe itself does: h_l at normal exitance, or as least squares averages it.

    Fitting F Y_lm(R) to h_l(t_o) Y_lm(R) of samples at several exit ``cosines``, so many at each,
    leaves sum F h_l / sum F^2.  A lobe is narrower across the plane of incidence the more the view
    grazes, so that sigma by normal exitance is too low.
    """
    at = jnp.ones(1) if cosines is None else jnp.asarray(cosines)
    count = np.ones(len(at)) if counts is None else np.asarray(counts)
    fresnel = np.asarray(normalised_fresnel(variant.mu, at))
    shares = count * fresnel / np.sum(count * fresnel**2)
    mu = None if variant.mu is None else jnp.asarray(variant.mu, at.dtype)

    @jax.jit
    def passed(sigma, mu) -> Float[Array, "bin degree"]:
        return exit_cosine_transfer(variant.with_roughness(sigma, mu), at, band_limit)

    return lambda sigma: shares @ np.asarray(passed(jnp.asarray(sigma, at.dtype), mu))


def roughness_from_source(
    light: Float[AnyArray, "coefficient channel"],
    region: Region | None = None,
    filtered_by: Filter | None = None,
) -> SourceRoughness:
    """Measure sigma by the brightest peak of a recovered light, in a region or anywhere.

    ``filtered_by`` defaults to ``diffusion_filter``.  A region that is found ends where the light
    around the peak ceases to fall.  Raises ``ValueError`` where the region has no peak of its own,
    or none that a source would show.
    """
    grey = np.mean(np.asarray(light, np.float64), axis=1)
    band_limit = band_limit_of(len(grey))
    filtered_by = diffusion_filter(band_limit) if filtered_by is None else filtered_by
    peak = _peak(grey, region)
    by_degree = np.asarray(degree_table(jnp.asarray(grey[:, None]), jnp.asarray(peak[None])))[
        0, :, 0
    ]
    radius = _reach(by_degree) if region is None else float(region.radius)
    cap = _Cap.of(radius, band_limit)
    centre, total, rim = (float(by_degree @ part) for part in (np.ones(band_limit + 1), *cap))
    if not centre > max(_LEAST_CONTRAST * rim, 0):
        raise ValueError(
            f"no directional source: the brightest point, {np.round(peak, 3)}, has radiance "
            f"{centre:.3g}, the light {np.degrees(radius):.0f} degrees around it {rim:.3g}; give "
            "the region of a source"
        )
    sigma = _inverted(by_degree, cap, filtered_by)
    return SourceRoughness(sigma, peak, radius, centre, total, rim)


class _Cap(NamedTuple):
    """Integrals over a cap about a pole, and means along its edge, of every P_l."""

    whole: Float[np.ndarray, "degree"]
    edge: Float[np.ndarray, "degree"]

    @classmethod
    def of(cls, radius: float, last: int) -> "_Cap":
        """2 pi int P_l = 2 pi (P_{l-1} - P_{l+1}) / (2l+1) at the edge."""
        edge = eval_legendre(np.arange(last + 2), np.cos(radius))
        before = np.concatenate([[1.0], edge[:-2]])
        whole = 2 * np.pi * (before - edge[1:]) / (2 * np.arange(last + 1) + 1)
        return cls(whole, edge[:-1])

    def above_rim(self, by_degree: Float[np.ndarray, "degree"]) -> tuple[float, float]:
        """Evaluate the centre and the sum over the cap, less what the edge's mean makes of them."""
        rim = by_degree @ self.edge
        return float(by_degree.sum() - rim), float(by_degree @ self.whole - rim * self.whole[0])


def _inverted(by_degree: Float[np.ndarray, "degree"], cap: _Cap, filtered_by: Filter) -> float:
    """Find the sigma at which a lone filtered source shows the same ratio of centre and sum."""
    centre, total = cap.above_rim(by_degree)
    orders = 2 * np.arange(len(by_degree)) + 1

    def excess(log_sigma: float) -> float:
        source = filtered_by(float(np.exp(log_sigma))) * orders / (4 * np.pi)
        its_centre, its_total = cap.above_rim(source)
        return its_centre * total - centre * its_total

    low, high = np.log(WIDTH_BOUNDS)
    if excess(low) < 0:
        raise ValueError(
            "no directional source: the peak is sharper than a source's of sigma "
            f"{WIDTH_BOUNDS[0]}, cut at the same degree, so it is noise or ringing; give the "
            "region of a source"
        )
    if excess(high) > 0:
        raise ValueError(
            f"no directional source: the peak is wider than a source's of sigma {WIDTH_BOUNDS[1]}; "
            "give the region of a source"
        )
    root = brentq(excess, low, high, xtol=1e-12, full_output=True)[0]
    return float(np.exp(root))


def _peak(grey: Float[np.ndarray, "coefficient"], region: Region | None) -> np.ndarray:
    """Find the brightest point; in a region it has to be a peak and no part of a slope."""
    coefficients = jnp.asarray(grey[:, None])
    directions = fibonacci_sphere(_DIRECTIONS)
    values = np.asarray(evaluate(coefficients, directions))[:, 0]
    peak = directions[np.argmax(values)]
    if region is not None:
        middle = np.asarray(region.direction, float) / np.linalg.norm(region.direction)
        inside = directions @ middle > np.cos(region.radius)
        values = np.where(inside, values, -np.inf)
        peak = directions[np.argmax(values)] if inside.any() else middle
    reach = _FIRST_STEP
    steps = np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * 2), axis=-1).reshape(-1, 2)
    while reach > _LAST_STEP:
        aside = np.linalg.svd(peak[None])[2][1:]
        around = peak + reach * steps @ aside
        around /= np.linalg.norm(around, axis=1, keepdims=True)
        peak = around[np.argmax(np.asarray(evaluate(coefficients, around))[:, 0])]
        reach /= 3
    if region is not None and peak @ middle < np.cos(region.radius):
        raise ValueError(
            f"no directional source within {np.degrees(region.radius):.1f} degrees of "
            f"{np.round(middle, 3)}: the light grows towards the region's edge; give the region of "
            "a source, or a wider one"
        )
    return peak


def _reach(by_degree: Float[np.ndarray, "degree"]) -> float:
    """Find how far from a peak the mean over azimuth falls."""
    angles = np.linspace(0, _WIDEST_REGION, 241)
    degree = np.arange(len(by_degree))
    around = eval_legendre(degree[None, :], np.cos(angles)[:, None]) @ by_degree
    rising = np.flatnonzero(np.diff(around) > 0)
    return float(angles[rising[0]] if rising.size else angles[-1])
