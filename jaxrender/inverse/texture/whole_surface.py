"""Every site solved at the sigma and mu that were found, a chunk of observations at a time.

Standard errors combine those of each site's own system with those of sigma and mu.  K_d is marked
where its standard error is large, or where the site's observations contradict each other.  K_s is
marked where the prior says more than the photographs.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.models import Columns, LinearisedModel
from jaxrender.inverse.texture.alternation import Confidence, alternate, confidence
from jaxrender.inverse.texture.forward import ModelOf
from jaxrender.inverse.texture.measurements import SiteData, SiteObservations, in_chunks
from jaxrender.inverse.texture.search import predicted
from jaxrender.inverse.texture.site_systems import (
    SiteMaterial,
    SpecularPrior,
    over_sites,
    site_errors,
    site_sums,
    solve_sites,
)
from jaxrender.inverse.texture.varying import SigmaField, SigmaMap, VaryingSigma, sigma_map
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int

# Observations solved at once.
_CHUNK = 2**14
# K_d is marked where its standard error exceeds this part of it ...
TRUSTED_ERROR = 0.05
# ... (of what is dark, this part of the typical K_d counts as well) ...
_DARK = 0.1
# ... or where the residuals are this many times what the noise makes them.
TRUSTED_MISFIT = 3.0
_LEAST_NOISE = 1e-6


class Lobe(NamedTuple):
    """sigma and mu as search variables, with their covariance; ``field`` where sigma varies."""

    unknowns: Unknowns
    point: Float[np.ndarray, "unknown"]
    covariance: Float[np.ndarray, "unknown unknown"]
    field: SigmaField | None = None

    def of_sites(self, site: Int[np.ndarray, "sample"]) -> Unknowns | VaryingSigma:
        """Return the unknowns of samples that show the given sites."""
        return self.unknowns if self.field is None else self.field.unknowns(self.unknowns, site)

    def variation(self) -> SigmaMap | None:
        """Return sigma and its standard error at every site, where it varies."""
        if self.field is None:
            return None
        return sigma_map(self.field, self.unknowns, self.point, self.covariance)

    def errors(self) -> tuple[float, float]:
        """Standard errors of sigma and mu in their own units, 0 for what is not searched."""
        _, jacobian = map(np.asarray, _values(self.unknowns, self.field, self.point))
        variances = np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian)
        sigma, mu = np.sqrt(np.maximum(variances, 0))
        return float(sigma), float(mu)

    def values(self) -> tuple[float, float]:
        """Return sigma (where it varies, the mean of its control points) and mu (NaN: a metal)."""
        sigma, mu = np.asarray(_values(self.unknowns, self.field, self.point)[0]).tolist()
        return sigma, mu if "mu" in self.unknowns else float("nan")


@stored(effort="less")
def _values(
    unknowns: Unknowns, field: SigmaField | None, point: Float[AnyArray, "unknown"]
) -> tuple[Float[Array, "2"], Float[Array, "2 unknown"]]:
    """sigma (where it varies, the mean of its control points) and mu, with their derivatives."""

    def values(point: Float[Array, "unknown"]) -> Float[Array, "2"]:
        if field is None:
            physical = unknowns.unpack(point)
            sigma = physical.numbers["sigma"]
        else:
            varying = field.unknowns(unknowns, np.zeros(1, int))
            physical = varying.unpack(point)
            sigma = jnp.exp(jnp.mean(varying.logs(point)))
        return jnp.stack([sigma, physical.numbers.get("mu", jnp.zeros_like(sigma))])

    return values(jnp.asarray(point)), jax.jacfwd(values)(jnp.asarray(point))


class Texture(NamedTuple):
    """The material of every site with its standard errors; NaN and infinite where unseen.

    ``misfit`` is the root mean square of a site's residuals in units of the noise; ``kd_marked``
    says where K_d is not to be trusted, ``ks_marked`` where K_s is the prior's more than its own.
    ``relative_rms`` is sqrt(sum r^2 / sum B^2) over all observations.
    """

    kd: Float[np.ndarray, "site channel"]
    ks: Float[np.ndarray, "site"]
    kd_error: Float[np.ndarray, "site channel"]
    ks_error: Float[np.ndarray, "site"]
    misfit: Float[np.ndarray, "site"]
    seen: Int[np.ndarray, "site"]
    kd_marked: Bool[np.ndarray, "site"]
    ks_marked: Bool[np.ndarray, "site"]
    relative_rms: float

    @property
    def relative_error(self) -> Float[np.ndarray, "site"]:
        """The largest standard error of a site's K_d beside its value: how bad it may be."""
        return _relative_error(self.kd, self.kd_error)

    def radiance(
        self, columns: Columns, site: Int[np.ndarray, "sample"]
    ) -> Float[np.ndarray, "sample channel"]:
        """Evaluate B = K_d(x) D + K_s(x) S of samples that show the given sites (T 6.13).

        A site that is unknown, or -1, is black.
        """
        kd, ks = (np.nan_to_num(values) for values in (self.kd, self.ks))
        found = kd[site] * columns.diffuse + ks[site][:, None] * columns.specular
        return np.where((site >= 0)[:, None], found, 0)

    def with_sites(self, chosen: Bool[np.ndarray, "site"], other: "Texture") -> "Texture":
        """Replace the chosen sites by those of another texture."""
        changed: dict = {"relative_rms": max(self.relative_rms, other.relative_rms)}
        for name, own, others in zip(self._fields[:-1], self[:-1], other[:-1]):
            mask = chosen[:, None] if np.ndim(own) == 2 else chosen
            changed[name] = np.where(mask, others, own)
        return self._replace(**changed)


class _Known(NamedTuple):
    """The lobe of a chunk's samples with its covariance, and what to expect of K_s."""

    unknowns: Unknowns | VaryingSigma
    point: Float[AnyArray, "unknown"]
    covariance: Float[AnyArray, "unknown unknown"]
    prior: SpecularPrior


class _Solved(NamedTuple):
    """What a chunk gives back, by site of the chunk."""

    material: SiteMaterial
    errors: SiteMaterial
    own_precision: Float[Array, "site"]
    squares: Float[Array, "site"]
    residual: Float[Array, ""]


def solve_surface(
    measured: SiteObservations,
    model_of: ModelOf,
    lobe: Lobe,
    prior: SpecularPrior,
    noise: NoiseModel,
    method: str,
) -> Texture:
    """Solve every site at the sigma and mu of ``lobe``, as ``TextureSettings.method`` says."""
    channels = measured.radiance.shape[1]
    kd = np.full((measured.count, channels), np.nan)
    ks, misfit = np.full(measured.count, np.nan), np.full(measured.count, np.nan)
    kd_error = np.full_like(kd, np.inf)
    ks_error, own = np.full(measured.count, np.inf), np.zeros(measured.count)
    left = 0.0
    scale = float(np.sqrt(np.mean(measured.radiance**2))) or 1.0
    for chunk in in_chunks(measured, _CHUNK):
        part, sites = chunk.measured, chunk.sites
        share = np.where(chunk.filled, 0, part.share)
        even = np.broadcast_to(np.sqrt(share)[:, None], part.radiance.shape)
        data = SiteData(part.radiance, even, part.site, part.count)
        variance = np.asarray([noise.relative**2, noise.floor**2 + (_LEAST_NOISE * scale) ** 2])
        unknowns = lobe.of_sites(sites[part.site])
        known = _Known(unknowns, lobe.point, lobe.covariance, prior)
        alternating, cosines = method == "thesis", part.exit_cosines
        numbers = unknowns.unpack(jnp.asarray(lobe.point)).numbers
        with jax.default_matmul_precision("highest"):
            near = LinearisedModel.about(model_of(part.index), numbers)
        solved = _solve(near, data, cosines, known, variance, alternating)
        count = len(sites)
        kd[sites], ks[sites] = (np.asarray(a)[:count] for a in solved.material)
        kd_error[sites], ks_error[sites] = (np.asarray(a)[:count] for a in solved.errors)
        own[sites] = np.asarray(solved.own_precision)[:count]
        freedom = np.maximum(measured.seen[sites] * channels - channels - 1, 1)
        misfit[sites] = np.sqrt(np.asarray(solved.squares)[:count] / freedom)
        left += float(solved.residual)
    energy = float(np.sum(measured.share[:, None] * measured.radiance**2))
    bad = ~(_relative_error(kd, kd_error) <= TRUSTED_ERROR) | ~(misfit <= TRUSTED_MISFIT)
    return Texture(
        kd,
        ks,
        kd_error,
        ks_error,
        misfit,
        measured.seen,
        bad,
        ~(own > float(prior.precision)),
        float(np.sqrt(left / energy)) if energy > 0 else 0.0,
    )


def _relative_error(kd: AnyArray, kd_error: AnyArray) -> Float[np.ndarray, "site"]:
    seen = np.isfinite(kd_error).all(axis=1)
    if not seen.any():
        return np.full(len(kd), np.inf)
    typical = np.median(kd[seen], axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.max(kd_error / (kd + _DARK * typical), axis=1)
    return np.where(seen, relative, np.inf)


@stored(effort="less")
def _solve(
    near: LinearisedModel,
    data: SiteData,
    exit_cosines: Float[AnyArray, "sample"],
    known: _Known,
    variance: Float[AnyArray, "2"],
    alternating: bool,
) -> _Solved:
    """Solve a chunk's sites: once to weigh by what is predicted, then with derivatives.

    ``variance`` is that of the noise: relative to the square of the radiance, and absolute.
    """
    unknowns, prior = known.unknowns, known.prior
    point, share = jnp.asarray(known.point), jnp.asarray(data.weights)

    def weighted(guess: Float[Array, "sample channel"]) -> SiteData:
        weights = share * jax.lax.rsqrt(variance[0] * jnp.maximum(guess, 0) ** 2 + variance[1])
        return SiteData(data.radiance, weights, data.site, data.count)

    with jax.default_matmul_precision("highest"):
        columns = near.columns(unknowns.unpack(point).numbers)
        data = weighted(jnp.asarray(data.radiance))
        first = solve_sites(site_sums(data, columns), prior)
        data = weighted(predicted(first, columns, data))

        def material_at(moved: Float[Array, "unknown"]) -> SiteMaterial:
            lobe = unknowns.unpack(moved)
            return solve_sites(site_sums(data, near.columns(lobe.numbers)), prior)

        sums = site_sums(data, columns)
        material = solve_sites(sums, prior)
        own = site_errors(sums, prior)
        through = jax.jacfwd(material_at)(point)
        errors = SiteMaterial(
            _with_lobe(jnp.asarray(own.kd), through.kd, known.covariance),
            _with_lobe(jnp.asarray(own.ks), through.ks, known.covariance),
        )
        if alternating:
            trust = confidence(columns, exit_cosines)
            material = _alternated(data, columns, trust, share, prior)
    off = predicted(material, columns, data) - data.radiance
    squares = jnp.sum(over_sites((jnp.asarray(data.weights) * off) ** 2, data), axis=1)
    precision = jnp.where(errors.ks > 0, 1 / errors.ks**2 - prior.precision, 0)
    return _Solved(material, errors, precision, squares, jnp.sum((share * off) ** 2))


def _with_lobe(
    own: Float[Array, "*site"],
    by_point: Float[Array, "*site unknown"],
    covariance: Float[AnyArray, "unknown unknown"],
) -> Float[Array, "*site"]:
    """Add to a site's own standard errors those of sigma and mu."""
    carried = jnp.einsum("...i,ij,...j->...", by_point, jnp.asarray(covariance), by_point)
    return jnp.sqrt(own**2 + carried)


def _alternated(
    data: SiteData,
    columns: Columns,
    trust: Confidence,
    share: Float[Array, "sample channel"],
    prior: SpecularPrior,
) -> SiteMaterial:
    diffuse, specular = (
        site_sums(
            SiteData(data.radiance, share * jnp.sqrt(one)[:, None], data.site, data.count), columns
        )
        for one in trust
    )
    return alternate(diffuse, specular, jnp.asarray(prior.mean)).material
