"""Light, texture and gloss of a glossy object, all unknown (T 6.1.1, class 7).

    B_i(x) = K_d(x) E(n) + K_s(x) sum_lm h_l(sigma, mu, t_o) L_lm V(R) Y_lm(R)

The first term of a site is the same in every photograph, whatever its texture.  Taking each site's
weighted mean over the photographs off both sides therefore leaves only what moves with the view,
which is linear in the light and in K_s(x).  These two and sigma and mu are found together
(:mod:`jaxrender.inverse.texture.view_search`), from where one K_s for all sites and then light and
K_s in turn have led.  With the light known, E(n) is, and the texture is that of a known light.

Only the product of K_s and the light shows, so the mean K_s is a choice (``mean_ks``).  What moves
little with the view is hardly told: degree 0 of the light through the Fresnel ratio and the horizon
alone, which takes grazing views; its standard error is that of the scale between K_d and K_s.  The
light is cut at a band limit: sources much narrower than the lobe are seen as wide as that.
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
from jaxrender.inverse.solvers import least_squares
from jaxrender.inverse.texture.harmonic_columns import (
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
from jaxrender.inverse.texture.site_systems import (
    SiteMaterial,
    SiteSums,
    SpecularPrior,
    over_sites,
    site_errors,
    site_sums,
    solve_freely,
    solve_sites,
)
from jaxrender.inverse.texture.specular_prior import spread_of
from jaxrender.inverse.texture.view_dependent import off_site_mean, solve_view_dependent
from jaxrender.inverse.texture.view_search import (
    State,
    ViewDependentFit,
    search_view_dependent,
)
from jaxrender.inverse.unknowns import MicrofacetUnknowns
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int

_CHUNK = 2**12
# Light and K_s(x) in turn, to begin with.
_TURNS = 4


class GlossyProblem(NamedTuple):
    """Observations by site, the lobe's kind (its numbers are ignored), and how to go about it.

    ``noise`` is its relative and its absolute part.  Of more than ``samples`` observations whole
    sites are drawn to find the light by, and of more than ``search_samples`` for sigma and mu.
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
    """Light, texture and gloss.

    ``kd_error`` knows that the light is uncertain, too; ``ks_error`` knows the noise alone.
    """

    light: GlossyLight
    kd: Float[np.ndarray, "site channel"]
    ks: Float[np.ndarray, "site"]
    kd_error: Float[np.ndarray, "site channel"]
    ks_error: Float[np.ndarray, "site"]


class _ColumnsAt(eqx.Module):
    """Both lobes' columns as a function of the search point."""

    diffuse: Float[Array, "sample coefficient"]
    samples: SurfaceSamples
    variant: Microfacet
    unknowns: MicrofacetUnknowns
    how: tuple[int, bool] = eqx.field(static=True)

    def __call__(
        self, point: Float[Array, "unknown"]
    ) -> tuple[Float[Array, "sample coefficient"], Float[Array, "sample coefficient"]]:
        """Evaluate them."""
        lobe = _lobe_at(self.variant, self.unknowns, point)
        return self.diffuse, harmonic_columns(self.samples, lobe, self.how)


def recover_glossy(
    problem: GlossyProblem, unknowns: MicrofacetUnknowns, mean_ks: float = 1.0
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
        point = _with_one_ks(problem, unknowns, point)
    some = whole_sites(problem.measured, problem.samples, 0)
    data, samples = _weighted(some, problem.noise), _samples(problem, some)
    basis = diffuse_basis(samples, problem.band_limit)
    how = (problem.band_limit, problem.exact)
    columns_at = _ColumnsAt(basis, samples, problem.variant, unknowns, how)
    start, kd = _in_turn(data, columns_at(jnp.asarray(point)), point)
    fit = search_view_dependent(columns_at, data, kd, start)
    end, kd, mean = _site_guess(data, columns_at(jnp.asarray(fit.state.point)), fit.state)
    # K_d counts where the surface turns within a site: once more with what it is by now.
    fit = search_view_dependent(columns_at, data, kd, end, fit)
    _, _, mean = _site_guess(data, columns_at(jnp.asarray(fit.state.point)), fit.state)
    # The light goes down as K_s and K_d go up.
    recovered = _recovered(unknowns, fit, mean / mean_ks)
    brdf = problem.variant.with_roughness(recovered.sigma, recovered.mu)
    material, error = _texture(problem, brdf, recovered)
    parts = (np.asarray(part) for part in (*material, *error))
    return GlossyTexture(recovered, *parts)


def _in_turn(
    data: SiteData, columns: tuple[Array, Array], point: Float[np.ndarray, "unknown"]
) -> tuple[State, Float[np.ndarray, "site channel"]]:
    """Find light and texture in turn at one sigma and mu: where to begin; and K_d."""
    kd, ks = np.zeros((data.count, data.radiance.shape[1])), np.ones(data.count)
    for _ in range(_TURNS):
        light, _ = solve_view_dependent(columns, data, SiteMaterial(kd, ks))
        state, kd, _ = _site_guess(data, columns, State(point, light, ks))
        ks = state.ks
    return state, kd


def _site_guess(
    data: SiteData, columns: tuple[Array, Array], state: State
) -> tuple[State, Float[np.ndarray, "site channel"], float]:
    """Solve the sites under a light: K_s and K_d in units of the mean K_s, and that mean."""
    light = jnp.asarray(state.light)
    lit = diffuse_under(columns[0], light), columns[1] @ light
    found, _, prior = _solved([site_sums(data, Columns(*lit))])
    mean = _mean_of(prior)
    ks = np.where(found.ks > 0, found.ks / mean, 1)
    return State(state.point, state.light * mean, ks), np.asarray(found.kd) / mean, mean


def _recovered(unknowns: MicrofacetUnknowns, fit: ViewDependentFit, scale: float) -> GlossyLight:
    """Put the end of a search into its units, with standard errors."""
    state, count = fit.state, len(fit.state.point)
    size, channels = state.light.shape
    blocks = fit.covariance[count:, count:].reshape(channels, size, channels, size)
    physical = unknowns.unpack(jnp.asarray(state.point))
    slopes = jax.jacfwd(unknowns.unpack)(jnp.asarray(state.point))

    def error_of(slope: Float[Array, "unknown"]) -> float:
        row = np.asarray(slope)
        return float(np.sqrt(row @ fit.covariance[:count, :count] @ row))

    mu = None if physical.mu is None else float(physical.mu)
    return GlossyLight(
        state.light * scale,
        np.stack([blocks[c, :, c] for c in range(channels)]) * scale**2,
        float(physical.sigma),
        mu,
        error_of(slopes.sigma),
        None if mu is None else error_of(slopes.mu),
        fit.converged,
    )


def _lobe_at(
    variant: Microfacet, unknowns: MicrofacetUnknowns, point: Float[Array, "unknown"]
) -> Microfacet:
    physical = unknowns.unpack(point)
    return variant.with_roughness(physical.sigma, None if variant.mu is None else physical.mu)


def _with_one_ks(
    problem: GlossyProblem, unknowns: MicrofacetUnknowns, start: Float[np.ndarray, "unknown"]
) -> Float[np.ndarray, "unknown"]:
    """Search sigma and mu with light and diffuse constants eliminated, one K_s for all sites.

    K_s varies, so that this is but where to begin.
    """
    some = whole_sites(problem.measured, problem.search_samples, 0)
    data, samples = _weighted(some, problem.noise), _samples(problem, some)
    how = (problem.band_limit, problem.exact)
    columns_at = _ColumnsAt(diffuse_basis(samples, how[0]), samples, problem.variant, unknowns, how)
    return np.asarray(_descend_with_one_ks(columns_at, data, start))


@eqx.filter_jit
def _descend_with_one_ks(
    columns_at: _ColumnsAt, data: SiteData, start: Float[AnyArray, "unknown"]
) -> Float[Array, "unknown"]:
    degree = jnp.asarray(degrees(columns_at.how[0]), jnp.asarray(data.radiance).dtype)

    def residuals(point: Float[Array, "unknown"], data: SiteData) -> Float[Array, "residual"]:
        columns = columns_at(point)[1]
        weights, radiance = jnp.asarray(data.weights), jnp.asarray(data.radiance)

        def of_channel(inputs: tuple) -> Float[Array, "sample"]:
            weight, values = inputs
            matrix = weight[:, None] * off_site_mean(columns, weight, data)
            right = weight * off_site_mean(values[:, None], weight, data)[:, 0]
            gram = matrix.T @ matrix
            ridge = 1e-7 * jnp.trace(gram) / gram.shape[0] * jnp.diag(degree**2 + 1e-3)
            light = jax.scipy.linalg.solve(gram + ridge, matrix.T @ right, assume_a="pos")
            return right - matrix @ light

        left = jax.lax.map(of_channel, (weights.T, radiance.T)).ravel()
        return left / jnp.sqrt(jnp.sum((weights * radiance) ** 2))

    with jax.default_matmul_precision("highest"):
        return least_squares(residuals, jnp.asarray(start), data).point


def _texture(
    problem: GlossyProblem, brdf: Microfacet, found: GlossyLight
) -> tuple[SiteMaterial, SiteMaterial]:
    """Solve every site under the light found, a chunk at a time."""
    measured, light = problem.measured, jnp.asarray(found.coefficients)
    sites, sums, variances = [], [], []
    how = (problem.band_limit, problem.exact)
    for chunk in in_chunks(measured, _CHUNK):
        data = _weighted(chunk.measured, problem.noise, chunk.filled)
        samples = _samples(problem, chunk.measured)
        columns = diffuse_basis(samples, problem.band_limit), harmonic_columns(samples, brdf, how)
        lit = Columns(diffuse_under(columns[0], light), jnp.matmul(columns[1], light))
        part = site_sums(data, lit)
        count = len(chunk.sites)
        sites.append(chunk.sites)
        sums.append(SiteSums(*(a[:count] for a in part)))
        free, _ = solve_freely(part)
        spread = _variance_by_light(data, (columns, lit.diffuse), free, found.covariance)
        variances.append(spread[:count])
    material, errors, _ = _solved(sums)
    index = np.concatenate(sites)
    errors = SiteMaterial(np.sqrt(errors.kd**2 + np.concatenate(variances)), errors.ks)
    return _spread_out(material, index, measured.count, np.nan), _spread_out(
        errors, index, measured.count, np.inf
    )


@eqx.filter_jit
def _variance_by_light(
    data: SiteData,
    lit: tuple[tuple[Array, Array], Float[Array, "sample channel"]],
    material: SiteMaterial,
    covariance: Float[AnyArray, "channel coefficient coefficient"],
) -> Float[Array, "site channel"]:
    """Compute the variance of K_d that is due to the light's: of K_d E + K_s S, over E."""
    (basis, columns), diffuse = lit
    site = jnp.asarray(data.site)
    ks = jnp.maximum(jnp.asarray(material.ks), 0)[site][:, None]
    squares = jnp.asarray(data.weights) ** 2

    def of_channel(inputs: tuple) -> Float[Array, "site"]:
        square, kd, irradiance, block = inputs
        rows = jnp.maximum(kd, 0)[site][:, None] * basis + ks * columns
        total = over_sites(square * irradiance, data)
        mean = over_sites(square[:, None] * rows, data)
        mean = mean / jnp.where(total > 0, total, jnp.inf)[:, None]
        return jnp.sum((mean @ block) * mean, axis=1)

    inputs = (squares.T, jnp.asarray(material.kd).T, diffuse.T, jnp.asarray(covariance))
    with jax.default_matmul_precision("highest"):
        return jax.lax.map(of_channel, inputs).T


def _solved(parts: list[SiteSums]) -> tuple[SiteMaterial, SiteMaterial, SpecularPrior]:
    """Solve sites, their K_s held together by the spread that they show; with standard errors."""
    sums = SiteSums(*(jnp.concatenate(each) for each in zip(*parts)))
    free, precision = solve_freely(sums)
    prior = spread_of(np.asarray(free.ks), np.asarray(precision))
    material, errors = solve_sites(sums, prior), site_errors(sums, prior)
    return SiteMaterial(*map(np.asarray, material)), SiteMaterial(*map(np.asarray, errors)), prior


def _mean_of(prior: SpecularPrior) -> float:
    """Look the mean K_s over the sites up; ``ValueError`` where there is no gloss."""
    if not (prior.precision > 0 and prior.mean > 0):
        raise ValueError(
            "no site's radiance changes with the view as gloss would: the object is matte, or its "
            "photographs are from one side; treat it as diffuse"
        )
    return float(prior.mean)


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
