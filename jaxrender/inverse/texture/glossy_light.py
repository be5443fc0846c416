"""Light, texture and specular lobe of a glossy object, all unknown (T 6.1.1, class 7).

    B_i(x) = K_d(x) E(n) + K_s(x) sum_lm h_l(sigma, mu, t_o) L_lm V(R) Y_lm(R)

The first term of a site is the same in every photograph, whatever its texture.  So each site's
weighted mean over the photographs is subtracted.  What is left moves with the view, and is linear
in the light and in K_s(x).  :mod:`jaxrender.inverse.texture.view_search` finds these two, sigma and
mu together.  It starts from one K_s for all sites, then from light and K_s found in turn.  A known
light gives E(n), and the texture follows as under a known light.

Only the product of K_s and the light shows, so the mean K_s is a choice (``mean_ks``).  Photographs
hardly tell what moves little with the view.  Degree 0 of the light shows by the Fresnel ratio and
the horizon alone, which takes grazing views.  Its standard error is that of the scale between K_d
and K_s.  The light is cut at a band limit, so narrow sources look as wide as the lobe.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import band_limit_of, degrees
from jaxrender.inverse.models import Columns
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.texture.harmonic_columns import (
    HarmonicColumns,
    LobeColumns,
    diffuse_basis,
    diffuse_under,
    harmonic_columns,
)
from jaxrender.inverse.texture.measurements import (
    SiteData,
    SiteObservations,
    in_chunks,
    whole_sites,
)
from jaxrender.inverse.texture.site_sums import SiteMaterial, SiteSums, over_sites, site_sums
from jaxrender.inverse.texture.site_systems import solve_freely
from jaxrender.inverse.texture.view_search import (
    ViewDependentFit,
    search_view_dependent,
)
from jaxrender.inverse.texture.view_start import (
    guess_sites,
    in_turn,
    solve_with_spread,
    with_one_ks,
)
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int

_CHUNK = 2**12


class GlossyProblem(NamedTuple):
    """Observations by site, the kind of lobe (its numbers are ignored), and settings.

    ``noise`` is its relative and its absolute part.  ``samples`` of whole sites are drawn to find
    the light, and ``search_samples`` to find where sigma and mu begin.
    """

    measured: SiteObservations
    observations: Observations
    variant: Microfacet
    band_limit: int
    noise: tuple[float, float]
    exact: bool = True
    samples: int = 4000
    search_samples: int = 1500


class GlossyLight(NamedTuple):
    """The light found from what moves with the view, in units where the mean K_s is ``mean_ks``.

    ``covariance`` is that of each channel's coefficients, ``sigma_error`` and ``mu_error`` the
    standard errors of sigma and mu (0 where fixed); all others, K_s(x) included, being unknown.
    """

    coefficients: Float[np.ndarray, "coefficient channel"]
    covariance: Float[np.ndarray, "channel coefficient coefficient"]
    sigma: float
    mu: float | None
    sigma_error: float
    mu_error: float | None
    converged: bool

    @property
    def standard_error(self) -> Float[np.ndarray, "coefficient channel"]:
        """Those of the coefficients."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2)).T

    @property
    def relative_error_by_degree(self) -> Float[np.ndarray, "degree"]:
        """The noise of each degree over its size."""
        degree = degrees(band_limit_of(len(self.coefficients)))
        parts = (np.sum(a**2, axis=1) for a in (self.standard_error, self.coefficients))
        noise, size = (np.bincount(degree, part) for part in parts)
        return np.sqrt(noise / np.maximum(size, np.finfo(float).tiny))


class GlossyTexture(NamedTuple):
    """Light, texture and specular lobe.

    ``kd_error`` includes the uncertainty of the light; ``ks_error`` has the noise alone.
    """

    light: GlossyLight
    kd: Float[np.ndarray, "site channel"]
    ks: Float[np.ndarray, "site"]
    kd_error: Float[np.ndarray, "site channel"]
    ks_error: Float[np.ndarray, "site"]


def recover_glossy(
    problem: GlossyProblem, unknowns: Unknowns, mean_ks: float = 1.0
) -> GlossyTexture:
    """Recover the light from what moves with the view, then K_d and K_s of every site.

    Raises ``ValueError`` where no site is seen more than once, or nothing moves with the view.
    """
    if problem.measured.seen.max() < 2:
        raise ValueError(
            "no site is seen more than once: what moves with the view takes two photographs of a "
            "place; give more of them, or larger texels"
        )
    point = unknowns.starts(1)[0]
    if unknowns.names:
        few = whole_sites(problem.measured, problem.search_samples, 0)
        columns_at, data = _columns_at(problem, unknowns, few), _weighted(few, problem.noise)
        point = np.asarray(with_one_ks(columns_at, data, point))
    some = whole_sites(problem.measured, problem.samples, 0)
    data, columns_at = _weighted(some, problem.noise), _columns_at(problem, unknowns, some)
    guess = in_turn(data, columns_at(jnp.asarray(point)), point)
    fit = search_view_dependent(columns_at, data, guess.kd, guess.state)
    guess = guess_sites(data, columns_at(jnp.asarray(fit.state.point)), fit.state)
    # K_d counts where the surface turns within a site: once more with what it is by now.
    fit = search_view_dependent(columns_at, data, guess.kd, guess.state, fit)
    guess = guess_sites(data, columns_at(jnp.asarray(fit.state.point)), fit.state)
    # The light goes down as K_s and K_d go up.
    recovered = _recovered(unknowns, fit, guess.mean / mean_ks)
    brdf = problem.variant.with_roughness(recovered.sigma, recovered.mu)
    material, error = _texture(problem, brdf, recovered)
    parts = (np.asarray(part) for part in (*material, *error))
    return GlossyTexture(recovered, *parts)


def _columns_at(
    problem: GlossyProblem, unknowns: Unknowns, part: SiteObservations
) -> HarmonicColumns:
    samples = _samples(problem, part)
    basis = diffuse_basis(samples, problem.band_limit)
    return HarmonicColumns(
        basis, samples, problem.variant, unknowns, problem.band_limit, problem.exact
    )


def _recovered(unknowns: Unknowns, fit: ViewDependentFit, scale: float) -> GlossyLight:
    """Put the end of a search into its units, with standard errors."""
    state, count = fit.state, len(fit.state.point)
    size, channels = state.light.shape
    blocks = fit.covariance[count:, count:].reshape(channels, size, channels, size)
    physical = unknowns.unpack(jnp.asarray(state.point))
    slopes = jax.jacfwd(unknowns.unpack)(jnp.asarray(state.point))

    def error_of(slope: Float[Array, "unknown"]) -> float:
        row = np.asarray(slope)
        return float(np.sqrt(row @ fit.covariance[:count, :count] @ row))

    mu = float(physical.numbers["mu"]) if "mu" in unknowns else None
    return GlossyLight(
        state.light * scale,
        np.stack([blocks[c, :, c] for c in range(channels)]) * scale**2,
        float(physical.numbers["sigma"]),
        mu,
        error_of(slopes.numbers["sigma"]),
        None if mu is None else error_of(slopes.numbers["mu"]),
        fit.converged,
    )


def _texture(
    problem: GlossyProblem, brdf: Microfacet, found: GlossyLight
) -> tuple[SiteMaterial, SiteMaterial]:
    """Solve every site under the light found, a chunk at a time."""
    measured, light = problem.measured, jnp.asarray(found.coefficients)
    sites, sums, variances = [], [], []
    for chunk in in_chunks(measured, min(_CHUNK, len(measured.site))):
        data = _weighted(chunk.measured, problem.noise, chunk.filled)
        samples = _samples(problem, chunk.measured)
        columns = LobeColumns(
            diffuse_basis(samples, problem.band_limit),
            harmonic_columns(samples, brdf, problem.band_limit, problem.exact),
        )
        diffuse = diffuse_under(columns.diffuse, light)
        lit = Columns(diffuse, jnp.matmul(columns.specular, light))
        part = site_sums(data, lit)
        count = len(chunk.sites)
        sites.append(chunk.sites)
        sums.append(SiteSums(*(a[:count] for a in part)))
        free, _ = solve_freely(part)
        spread = _variance_by_light(data, columns, diffuse, free, found.covariance)
        variances.append(spread[:count])
    solved = solve_with_spread(sums)
    material, errors = solved.material, solved.errors
    index = np.concatenate(sites)
    errors = SiteMaterial(np.sqrt(errors.kd**2 + np.concatenate(variances)), errors.ks)
    return _spread_out(material, index, measured.count, np.nan), _spread_out(
        errors, index, measured.count, np.inf
    )


@eqx.filter_jit
def _variance_by_light(
    data: SiteData,
    columns: LobeColumns,
    diffuse: Float[AnyArray, "sample channel"],
    material: SiteMaterial,
    covariance: Float[AnyArray, "channel coefficient coefficient"],
) -> Float[Array, "site channel"]:
    """Compute the variance of K_d that is due to the light's: of K_d E + K_s S, over E."""
    site = jnp.asarray(data.site)
    ks = jnp.maximum(jnp.asarray(material.ks), 0)[site][:, None]
    squares = jnp.asarray(data.weights) ** 2

    def of_channel(inputs: tuple) -> Float[Array, "site"]:
        square, kd, irradiance, block = inputs
        rows = jnp.maximum(kd, 0)[site][:, None] * columns.diffuse + ks * columns.specular
        total = over_sites(square * irradiance, data)
        mean = over_sites(square[:, None] * rows, data)
        mean = mean / jnp.where(total > 0, total, jnp.inf)[:, None]
        return jnp.sum((mean @ block) * mean, axis=1)

    inputs = (squares.T, jnp.asarray(material.kd).T, diffuse.T, jnp.asarray(covariance))
    with jax.default_matmul_precision("highest"):
        return jax.lax.map(of_channel, inputs).T


def _spread_out(
    values: SiteMaterial, index: Int[np.ndarray, "solved"], count: int, missing: float
) -> SiteMaterial:
    kd = np.full((count, values.kd.shape[1]), missing)
    ks = np.full(count, missing)
    kd[index], ks[index] = values
    return SiteMaterial(kd, ks)


def _samples(problem: GlossyProblem, part: SiteObservations) -> SurfaceSamples:
    return SurfaceSamples(*(jnp.asarray(a)[part.index] for a in problem.observations.samples))


def _weighted(
    part: SiteObservations,
    noise: tuple[float, float],
    filled: Bool[np.ndarray, "sample"] | None = None,
) -> SiteData:
    """Weigh by the noise of the larger of a radiance and its site's mean: never far too much."""
    total = np.bincount(part.site, minlength=part.count)
    mean = np.stack([np.bincount(part.site, c, part.count) for c in part.radiance.T], axis=1)
    level = np.maximum(mean / np.maximum(total, 1)[:, None], 0)[part.site]
    level = np.maximum(level, np.maximum(part.radiance, 0))
    deviation = np.hypot(noise[0] * level, noise[1]) + 1e-12
    share = part.share if filled is None else np.where(filled, 0, part.share)
    return SiteData(part.radiance, np.sqrt(share)[:, None] / deviation, part.site, part.count)
