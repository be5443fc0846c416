"""Light, texture and gloss of a glossy object, all unknown (T 6.1.1, class 7).

    B_i(x) = K_d(x) E(n) + K_s(x) sum_lm h_l(sigma, mu, t_o) L_lm V(R) Y_lm(R)

The first term of a site is the same in every photograph, whatever its texture.  Taking each site's
weighted mean over the photographs off both sides therefore leaves only what moves with the view,
which is linear in the light: least squares, with the sites' diffuse constants eliminated.  With the
light known, E(n) is, and the texture is that of a known light.  K_s(x) may vary as well: it is
found in turn with the light.

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
from jaxrender.harmonics import band_limit_of, coefficient_count, degrees, real_basis
from jaxrender.inverse.models import Columns
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.solvers import least_squares
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
from jaxrender.inverse.unknowns import MicrofacetUnknowns
from jaxrender.reflection import polar_columns
from jaxrender.shapes import Array, Bool, Float, Int
from jaxrender.spectra import lambertian_transfer, transfer_of_samples

_CHUNK = 2**12
# Diffuse light beyond this degree is under .4 % of the whole.
_DIFFUSE_BAND_LIMIT = 8
# Rounds of light and K_s(x) in turn, and of the light's expected size.
_TURNS, _SIZES = 4, 3
# Polar nodes of the exact integral; the lobe meets smooth harmonics.
_POLAR_NODES = 24


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

    ``standard_error`` is that of each coefficient, sigma and mu being right.
    """

    coefficients: Float[np.ndarray, "coefficient channel"]
    standard_error: Float[np.ndarray, "coefficient channel"]
    sigma: float
    mu: float | None

    @property
    def relative_error_by_degree(self) -> Float[np.ndarray, "degree"]:
        """The noise of each degree over its size."""
        degree = degrees(band_limit_of(len(self.coefficients)))
        parts = (np.sum(a**2, axis=1) for a in (self.standard_error, self.coefficients))
        noise, size = (np.bincount(degree, part) for part in parts)
        return np.sqrt(noise / np.maximum(size, np.finfo(float).tiny))


class GlossyTexture(NamedTuple):
    """Light, texture and gloss; errors of the texture are those under the light that was found."""

    light: GlossyLight
    kd: Float[np.ndarray, "site channel"]
    ks: Float[np.ndarray, "site"]
    kd_error: Float[np.ndarray, "site channel"]
    ks_error: Float[np.ndarray, "site"]


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
        point = _search(problem, unknowns, point)
    physical = unknowns.unpack(jnp.asarray(point))
    mu = None if physical.mu is None else float(physical.mu)
    brdf = problem.variant.with_roughness(float(physical.sigma), mu)
    some = whole_sites(problem.measured, problem.samples, 0)
    data, samples = _weighted(some, problem.noise), _samples(problem, some)
    columns = harmonic_columns(samples, brdf, (problem.band_limit, problem.exact))
    basis = _diffuse_basis(samples, problem.band_limit)
    guess = SiteMaterial(np.zeros((some.count, some.radiance.shape[1])), np.ones(some.count))
    for _ in range(_TURNS):
        light, errors = solve_view_dependent((basis, columns), data, guess)
        lit = _diffuse(basis, jnp.asarray(light)), columns @ jnp.asarray(light)
        found, _, prior = _solved([site_sums(data, Columns(*lit))])
        mean = _mean_of(prior)
        ks = np.where(found.ks > 0, found.ks / mean, 1)
        guess = SiteMaterial(found.kd / mean, ks)
    # The light goes down as K_s and K_d go up.
    light, errors = (np.asarray(part * (mean / mean_ks)) for part in (light, errors))
    recovered = GlossyLight(light, errors, float(physical.sigma), mu)
    material, error = _texture(problem, brdf, jnp.asarray(light))
    parts = (np.asarray(part) for part in (*material, *error))
    return GlossyTexture(recovered, *parts)


def solve_view_dependent(
    columns: tuple[Float[Array, "sample coefficient"], Float[Array, "sample coefficient"]],
    data: SiteData,
    guess: SiteMaterial,
) -> tuple[Float[np.ndarray, "coefficient channel"], Float[np.ndarray, "coefficient channel"]]:
    """Solve for K_s L_lm with every site's diffuse constant eliminated; with standard errors.

    ``columns`` are those of the diffuse and the specular lobe under each harmonic; ``guess`` is the
    texture in units of the mean K_s, as far as it is known.  Its K_d counts only where the surface
    turns within a site, so that E(n) is no constant there; zeros do to begin with.
    Coefficients of degree l are expected to be about s / l, where s is learned from the data;
    degree 0 is left free.
    """
    sums = _normal_equations(columns, data, SiteMaterial(*map(jnp.asarray, guess)))
    gram, moment, squares = (np.asarray(a) for a in sums)
    count = gram.shape[1]
    freedom = len(data.site) - len(np.unique(data.site)) - count
    degree = degrees(band_limit_of(count))
    found, errors = [], []
    for channel in range(len(gram)):
        penalty = np.zeros(count)
        for _ in range(_SIZES):
            system = gram[channel] + np.diag(penalty)
            system += 1e-12 * np.trace(system) / count * np.eye(count)
            light = np.linalg.solve(system, moment[channel])
            size = np.mean(((degree * light)[1:]) ** 2)
            penalty = np.where(degree > 0, degree**2 / max(size, 1e-300), 0)
        left = squares[channel] - 2 * light @ moment[channel] + light @ gram[channel] @ light
        scatter = max(left / max(freedom, 1), 1.0)
        found.append(light)
        errors.append(np.sqrt(scatter * np.diag(np.linalg.inv(system))))
    return np.stack(found, axis=1), np.stack(errors, axis=1)


@jax.jit
def _normal_equations(
    columns: tuple[Float[Array, "sample coefficient"], Float[Array, "sample coefficient"]],
    data: SiteData,
    guess: SiteMaterial,
) -> tuple[
    Float[Array, "channel coefficient coefficient"],
    Float[Array, "channel coefficient"],
    Float[Array, "channel"],
]:
    """Add up each channel's equations with the sites' weighted means off."""
    weights, radiance = jnp.asarray(data.weights), jnp.asarray(data.radiance)
    site = jnp.asarray(data.site)
    specular = jnp.asarray(guess.ks)[site][:, None] * columns[1]

    def of_channel(inputs: tuple) -> tuple:
        weight, values, kd = inputs
        mixed = specular + kd[site][:, None] * columns[0]
        matrix = weight[:, None] * _off_site_mean(mixed, weight, data)
        right = weight * _off_site_mean(values[:, None], weight, data)[:, 0]
        with jax.default_matmul_precision("highest"):
            return matrix.T @ matrix, matrix.T @ right, jnp.sum(right**2)

    return jax.lax.map(of_channel, (weights.T, radiance.T, jnp.asarray(guess.kd).T))


def _off_site_mean(
    values: Float[Array, "sample k"], weight: Float[Array, "sample"], data: SiteData
) -> Float[Array, "sample k"]:
    """Project the constants of every site out."""
    square = weight[:, None] ** 2
    total = over_sites(square, data)
    mean = over_sites(square * values, data) / jnp.where(total > 0, total, 1)
    return values - mean[jnp.asarray(data.site)]


@eqx.filter_jit
def harmonic_columns(
    samples: SurfaceSamples, brdf: Microfacet, how: tuple[int, bool]
) -> Float[Array, "sample coefficient"]:
    """Evaluate the lobe's radiance under each harmonic to a band limit.

    ``how`` is the band limit, and whether by the integral itself or as h_l(t_o) Y_lm(R).
    """
    band_limit, exact = how
    if exact:
        columns = polar_columns(brdf, samples, lambda d: real_basis(d, band_limit), _POLAR_NODES)
        return columns[:, 1]
    passed = transfer_of_samples(brdf, samples.exit_cosines, band_limit, "exit-cosine")
    return passed[:, degrees(band_limit)] * real_basis(samples.reflected, band_limit)


@eqx.filter_jit
def _specular_under(
    samples: SurfaceSamples, brdf: Microfacet, light: Float[Array, "coefficient channel"], exact
) -> Float[Array, "sample channel"]:
    """Evaluate the lobe's radiance under light of given coefficients."""
    band_limit = band_limit_of(light.shape[0])
    if not exact:
        columns = harmonic_columns(samples, brdf, (band_limit, False))
        return jnp.matmul(columns, light, precision="highest")

    def radiance_of(directions: Float[Array, "node 3"]) -> Float[Array, "node channel"]:
        return jnp.matmul(real_basis(directions, band_limit), light, precision="highest")

    return polar_columns(brdf, samples, radiance_of, _POLAR_NODES)[:, 1]


def _diffuse_basis(samples: SurfaceSamples, band_limit: int) -> Float[Array, "sample coefficient"]:
    """Evaluate A_l Y_lm(n), zero above the degrees that make up diffuse light."""
    kept = min(band_limit, _DIFFUSE_BAND_LIMIT)
    normals = jnp.asarray(samples.normals)
    each = jnp.asarray(lambertian_transfer(kept)[degrees(kept)], normals.dtype)
    missing = coefficient_count(band_limit) - coefficient_count(kept)
    return jnp.pad(real_basis(normals, kept) * each[None, :], ((0, 0), (0, missing)))


def _diffuse(
    basis: Float[Array, "sample coefficient"], light: Float[Array, "coefficient channel"]
) -> Float[Array, "sample channel"]:
    """Evaluate E(n), kept above zero where ringing would take it below on the dark side."""
    found = jnp.matmul(basis, light, precision="highest")
    return jnp.maximum(found, 1e-3 * jnp.mean(jnp.abs(found)))


def _search(
    problem: GlossyProblem, unknowns: MicrofacetUnknowns, start: Float[np.ndarray, "unknown"]
) -> Float[np.ndarray, "unknown"]:
    """Search sigma and mu with light and diffuse constants eliminated (one K_s)."""
    some = whole_sites(problem.measured, problem.search_samples, 0)
    data = _weighted(some, problem.noise)
    how = (problem.band_limit, problem.exact)
    found = _descend(_samples(problem, some), problem.variant, how, data, unknowns)
    return np.asarray(found(jnp.asarray(start)))


def _descend(samples, variant, how: tuple[int, bool], data: SiteData, unknowns: MicrofacetUnknowns):
    degree = jnp.asarray(degrees(how[0]), jnp.asarray(data.radiance).dtype)

    def residuals(point, data: SiteData):
        physical = unknowns.unpack(point)
        mu = None if variant.mu is None else physical.mu
        columns = harmonic_columns(samples, variant.with_roughness(physical.sigma, mu), how)
        weights, radiance = jnp.asarray(data.weights), jnp.asarray(data.radiance)

        def of_channel(inputs: tuple):
            weight, values = inputs
            matrix = weight[:, None] * _off_site_mean(columns, weight, data)
            right = weight * _off_site_mean(values[:, None], weight, data)[:, 0]
            gram = matrix.T @ matrix
            ridge = 1e-7 * jnp.trace(gram) / gram.shape[0] * jnp.diag(degree**2 + 1e-3)
            light = jax.scipy.linalg.solve(gram + ridge, matrix.T @ right, assume_a="pos")
            return right - matrix @ light

        left = jax.lax.map(of_channel, (weights.T, radiance.T)).ravel()
        return left / jnp.sqrt(jnp.sum((weights * radiance) ** 2))

    @jax.jit
    def descend(start):
        with jax.default_matmul_precision("highest"):
            return least_squares(residuals, start, data).point

    return descend


def _texture(
    problem: GlossyProblem, brdf: Microfacet, light: Float[Array, "coefficient channel"]
) -> tuple[SiteMaterial, SiteMaterial]:
    """Solve every site under the light found, a chunk at a time."""
    measured = problem.measured
    sites, sums = [], []
    for chunk in in_chunks(measured, _CHUNK):
        data = _weighted(chunk.measured, problem.noise, chunk.filled)
        samples = _samples(problem, chunk.measured)
        basis = _diffuse_basis(samples, problem.band_limit)
        specular = _specular_under(samples, brdf, light, problem.exact)
        part = site_sums(data, Columns(_diffuse(basis, light), specular))
        count = len(chunk.sites)
        sites.append(chunk.sites)
        sums.append(SiteSums(*(a[:count] for a in part)))
    material, errors, _ = _solved(sums)
    index = np.concatenate(sites)
    return _spread_out(material, index, measured.count, np.nan), _spread_out(
        errors, index, measured.count, np.inf
    )


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
