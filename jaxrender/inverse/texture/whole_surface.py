"""Every site solved at the sigma and mu that were found, a chunk of observations at a time.

Standard errors combine those of each site's own system with those of sigma and mu.  The former are
wider where a site's photographs contradict each other (:mod:`.clustered`).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.models import Columns, LinearisedModel
from jaxrender.inverse.texture.alternation import Confidence, alternate, confidence
from jaxrender.inverse.texture.clustered import Excess, Groups, excess_of, widening
from jaxrender.inverse.texture.coloured_sites import ColouredPrior, ColouredSpread, KsPrior
from jaxrender.inverse.texture.forward import ModelOf
from jaxrender.inverse.texture.measurements import SiteData, SiteObservations, in_chunks
from jaxrender.inverse.texture.search import predicted
from jaxrender.inverse.texture.site_detail import Detail
from jaxrender.inverse.texture.site_numbers import NormalMap, OwnSigma, SiteNumbers
from jaxrender.inverse.texture.site_sums import SiteMaterial, over_sites, site_sums
from jaxrender.inverse.texture.site_systems import SpecularPrior
from jaxrender.inverse.texture.texture import Texture
from jaxrender.inverse.texture.varying import SigmaField, SigmaMap, VaryingSigma, sigma_map
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int

# Observations solved at once.
_CHUNK = 2**14
_LEAST_NOISE = 1e-6


class Lobe(NamedTuple):
    """sigma and mu as search variables, with their covariance; ``field`` where sigma varies.

    ``exact_covariance`` is what it would be if the model were exact.  ``own`` are the numbers that
    each site has for itself; sigma is then what is typical of the sites.  ``detail`` is how all
    that varies within each site.
    """

    unknowns: Unknowns
    point: Float[np.ndarray, "unknown"]
    covariance: Float[np.ndarray, "unknown unknown"]
    exact_covariance: Float[np.ndarray, "unknown unknown"]
    field: SigmaField | None = None
    own: SiteNumbers | None = None
    detail: Detail | None = None

    def if_exact(self) -> "Lobe":
        """Take the model to be exact."""
        return self._replace(covariance=self.exact_covariance)

    def of_sites(self, site: Int[np.ndarray, "sample"]) -> Unknowns | VaryingSigma | OwnSigma:
        """Return the unknowns of samples that show the given sites."""
        sigma = None if self.own is None else self.own.sigma
        if sigma is not None:
            typical = self.values()[0]
            return OwnSigma(self.unknowns, np.nan_to_num(sigma.sigma, nan=typical)[site])
        return self.unknowns if self.field is None else self.field.unknowns(self.unknowns, site)

    def variation(self) -> SigmaMap | None:
        """Return sigma and its standard error at every site, where it varies."""
        if self.own is not None:
            return self.own.sigma
        if self.field is None:
            return None
        return sigma_map(self.field, self.unknowns, self.point, self.covariance)

    @property
    def normals(self) -> NormalMap | None:
        """The normal of every site, where it is its own."""
        return None if self.own is None else self.own.normals

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


class Surface(NamedTuple):
    """A texture, and what it leaves of each of the observations that it was solved from.

    ``index`` is the place of each among all observations.  ``wider`` is by how much the errors of
    each site's K_d and K_s are larger than noise makes them.
    """

    texture: Texture
    left: Float[np.ndarray, "sample channel"]
    index: Int[np.ndarray, "sample"]
    wider: Float[np.ndarray, "site 2"]


class _Known(NamedTuple):
    """The lobe of a chunk's samples with its covariances, and what to expect of K_s."""

    unknowns: Unknowns | VaryingSigma | OwnSigma
    point: Float[AnyArray, "unknown"]
    covariance: Float[AnyArray, "unknown unknown"]
    exact_covariance: Float[AnyArray, "unknown unknown"]
    prior: KsPrior


class _SeenAs(NamedTuple):
    """How the samples of a chunk are seen: at what angle, and which of them in one photograph."""

    exit_cosines: Float[AnyArray, "sample"]
    groups: Groups


class _Solved(NamedTuple):
    """What is found at each site.

    ``errors`` are of the site's own observations, ``spread`` those of a K_s that has a colour,
    ``carried`` and ``exactly_carried`` those of
    sigma and mu in K_d and K_s, as they are and as they would be if the model were exact.
    """

    material: SiteMaterial
    errors: SiteMaterial
    carried: SiteMaterial
    exactly_carried: SiteMaterial
    excess: Excess
    squares: Float[AnyArray, "site"]
    spread: ColouredSpread | None = None


def solve_surface(
    measured: SiteObservations,
    model_of: ModelOf,
    lobe: Lobe,
    prior: KsPrior,
    noise: NoiseModel,
    method: str,
) -> Surface:
    """Solve every site at the sigma and mu of ``lobe``, as ``TextureSettings.method`` says."""
    channels = measured.radiance.shape[1]
    every = _empty(measured.count, channels, prior.amplitudes(channels))
    left = np.zeros_like(measured.radiance)
    scale = float(np.sqrt(np.mean(measured.radiance**2))) or 1.0
    done = 0
    for chunk in in_chunks(measured, min(_CHUNK, len(measured.site))):
        part, sites = chunk.measured, chunk.sites
        share = np.where(chunk.filled, 0, part.share)
        even = np.broadcast_to(np.sqrt(share)[:, None], part.radiance.shape)
        data = SiteData(part.radiance, even, part.site, part.count)
        variance = np.asarray([noise.relative**2, noise.floor**2 + (_LEAST_NOISE * scale) ** 2])
        unknowns = lobe.of_sites(sites[part.site])
        known = _Known(unknowns, lobe.point, lobe.covariance, lobe.exact_covariance, prior)
        seen_as = _SeenAs(part.exit_cosines, Groups.of(part.site, part.clusters.photograph))
        numbers = unknowns.unpack(jnp.asarray(lobe.point)).numbers
        with jax.default_matmul_precision("highest"):
            near = LinearisedModel.about(model_of(part.index), numbers)
        solved, own = _solve(near, data, seen_as, known, variance, method == "thesis")
        for whole, found in zip(jax.tree.leaves(every), jax.tree.leaves(solved), strict=True):
            whole[sites] = np.asarray(found)[: len(sites)]
        filled = int(np.count_nonzero(~chunk.filled))
        left[done : done + filled] = np.asarray(own)[:filled]
        done += filled
    wider = widening(every.excess) if lobe.own is None else lobe.own.wider
    texture = _texture(measured, every, left, prior, wider, lobe.own)
    return Surface(texture, left, measured.index, wider)


def _empty(count: int, channels: int, of_ks: int) -> "_Solved":
    """Make room for what is found at every site: nothing is known of any."""
    coloured = of_ks > 1

    def room(value: float) -> SiteMaterial:
        own = np.full((count, of_ks), value)
        return SiteMaterial(np.full((count, channels), value), own if coloured else own[:, 0])

    excess = Excess(*(np.zeros((count, 2)) for _ in range(3)))
    spread = ColouredSpread(*np.full((2, count), np.inf)) if coloured else None
    every = room(np.nan), room(np.inf), room(0.0), room(0.0), excess, np.full(count, np.nan)
    return _Solved(*every, spread)


def _texture(
    measured: SiteObservations,
    found: "_Solved",
    left: Float[np.ndarray, "sample channel"],
    prior: KsPrior,
    wider: Float[np.ndarray, "site 2"],
    own: SiteNumbers | None,
) -> Texture:
    """Put errors together, and mark what is not to be trusted."""
    kd, channels = np.asarray(found.material.kd), measured.radiance.shape[1]
    errors, numbers, of_ks = found.errors, 0, prior.amplitudes(channels)
    if own is not None:
        numbers = len(own.names)
        shape = np.shape(errors.ks)
        errors = SiteMaterial(
            np.asarray(errors.kd) * own.inflation[:, :channels],
            np.asarray(errors.ks) * own.inflation[:, channels:].reshape(shape),
        )
    kd_error = np.hypot(errors.kd * wider[:, :1], found.carried.kd)
    ks_wider = wider[:, 1:] if of_ks > 1 else wider[:, 1]
    ks_error = np.hypot(errors.ks * ks_wider, found.carried.ks)
    kd_exact, ks_exact = (
        np.hypot(of_site, of_lobe) for of_site, of_lobe in zip(errors, found.exactly_carried)
    )
    ks_marked, colour_marked = _marked(prior, ks_exact, found, own)
    freedom = np.maximum(measured.seen * channels - channels - of_ks - numbers, 1)
    misfit = np.sqrt(np.asarray(found.squares) / freedom)
    energy = float(np.sum(measured.share[:, None] * measured.radiance**2))
    unexplained = float(np.sum(measured.share[:, None] * left**2))
    return Texture(
        kd,
        np.asarray(found.material.ks),
        kd_error,
        ks_error,
        misfit,
        measured.seen,
        np.ones(measured.count, bool),
        ks_marked,
        kd_exact,
        ks_exact,
        float(np.sqrt(unexplained / energy)) if energy > 0 else 0.0,
        colour_marked,
    ).marked()


def _marked(
    prior: KsPrior,
    exact: Float[np.ndarray, "site *channel"],
    found: "_Solved",
    own: SiteNumbers | None,
) -> tuple[Bool[np.ndarray, "site"], Bool[np.ndarray, "site"] | None]:
    """Say where K_s, and its colour if it has one, are the prior's more than the photographs'."""
    if isinstance(prior, ColouredPrior):
        assert found.spread is not None
        assert own is not None
        channels = exact.shape[1]
        # What the site's numbers and what all sites share add.
        more = np.mean(own.inflation[:, channels:], axis=1) ** 2
        shared = np.mean(np.asarray(found.exactly_carried.ks), axis=1) ** 2
        level, colour = (np.asarray(part) * more for part in found.spread)
        return ColouredSpread(level + shared, colour).marked(prior, channels)
    assert isinstance(prior, SpecularPrior)
    with np.errstate(divide="ignore"):
        told = np.where(exact > 0, 1 / exact**2 - float(prior.precision), 0)
    return ~(told > float(prior.precision)), None


@stored(effort="less")
def _solve(
    near: LinearisedModel,
    data: SiteData,
    seen_as: _SeenAs,
    known: _Known,
    variance: Float[AnyArray, "2"],
    alternating: bool,
) -> tuple[_Solved, Float[AnyArray, "sample channel"]]:
    """Solve a chunk's sites: once to weigh by what is predicted, then with derivatives.

    ``variance`` is that of the noise: relative to the square of the radiance, and absolute.  What
    is left of each sample comes second.
    """
    unknowns, prior = known.unknowns, known.prior
    point, share = jnp.asarray(known.point), jnp.asarray(data.weights)

    def weighted(guess: Float[Array, "sample channel"]) -> SiteData:
        weights = share * jax.lax.rsqrt(variance[0] * jnp.maximum(guess, 0) ** 2 + variance[1])
        return SiteData(data.radiance, weights, data.site, data.count)

    with jax.default_matmul_precision("highest"):
        columns = near.columns(unknowns.unpack(point).numbers)
        data = weighted(jnp.asarray(data.radiance))
        first = prior.solve(site_sums(data, columns))
        data = weighted(predicted(first, columns, data))

        def material_at(moved: Float[Array, "unknown"]) -> SiteMaterial:
            lobe = unknowns.unpack(moved)
            return prior.solve(site_sums(data, near.columns(lobe.numbers)))

        sums = site_sums(data, columns)
        material, (own, spread) = prior.solve(sums), prior.errors(sums)
        through = jax.jacfwd(material_at)(point)
        carried, exactly = (
            SiteMaterial(*(_carried(jnp.asarray(slopes), covariance) for slopes in through))
            for covariance in (known.covariance, known.exact_covariance)
        )
        if alternating:
            assert isinstance(prior, SpecularPrior)
            trust = confidence(columns, seen_as.exit_cosines)
            material = _alternated(data, columns, trust, share, prior)
        left = data.radiance - predicted(material, columns, data)
        excess = excess_of(data, columns, left, seen_as.groups, sums, prior)
    squares = jnp.sum(over_sites((jnp.asarray(data.weights) * left) ** 2, data), axis=1)
    return _Solved(material, own, carried, exactly, excess, squares, spread), left


def _carried(
    by_point: Float[Array, "*site unknown"], covariance: Float[AnyArray, "unknown unknown"]
) -> Float[Array, "*site"]:
    """Carry the errors of sigma and mu to the sites."""
    variance = jnp.einsum("...i,ij,...j->...", by_point, jnp.asarray(covariance), by_point)
    return jnp.sqrt(jnp.maximum(variance, 0))


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
