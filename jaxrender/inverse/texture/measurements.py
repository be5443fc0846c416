"""Measurements in the order of the sites that they show; sums over a site are sums of rows.

Sites are texels or vertices (:mod:`jaxrender.geometry.texels`), each with a material of its own.
Host side.
"""

from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxrender.inverse.clusters import Clusters
from jaxrender.inverse.observations import Observations
from jaxrender.shapes import AnyArray, Bool, Float, Int


class SiteObservations(NamedTuple):
    """Observations sorted by site, those without one left out.

    ``index`` is each one's place among the observations that they are from; ``share`` the part of
    it that counts for this site (1, unless it was split among several).  ``clusters`` are of
    observations that may err together.  ``rounding`` is the least floor of their noise.
    """

    radiance: Float[np.ndarray, "sample channel"]
    exit_cosines: Float[np.ndarray, "sample"]
    site: Int[np.ndarray, "sample"]
    index: Int[np.ndarray, "sample"]
    share: Float[np.ndarray, "sample"]
    clusters: Clusters
    count: int
    rounding: float = 0.0

    @property
    def seen(self) -> Int[np.ndarray, "site"]:
        """The number of observations of each site."""
        return np.bincount(self.site, minlength=self.count)

    def take(self, chosen: AnyArray) -> "SiteObservations":
        """Keep some observations, given by a mask or by ascending indices."""
        return SiteObservations(
            self.radiance[chosen],
            self.exit_cosines[chosen],
            self.site[chosen],
            self.index[chosen],
            self.share[chosen],
            self.clusters.take(chosen),
            self.count,
            self.rounding,
        )

    def of_sites(self, chosen: Bool[np.ndarray, "site"]) -> "SiteObservations":
        """Keep the observations of some sites; the numbering stays."""
        return self.take(chosen[self.site])


class SiteData(eqx.Module):
    """What the solvers see: radiance, weights (1 / standard deviation) and site, in site order.

    ``count`` is the number of sites, numbered from 0; sums over absent ones are zero.
    """

    radiance: Float[AnyArray, "sample channel"]
    weights: Float[AnyArray, "sample channel"]
    site: Int[AnyArray, "sample"]
    count: int = eqx.field(static=True)


def by_site(
    observations: Observations,
    site: Int[np.ndarray, "sample"],
    count: int,
) -> SiteObservations:
    """Sort observations by the site that each shows; -1 leaves one out.

    Raises ``ValueError`` for a site beyond ``count``, or where no observation has a site.
    """
    index = np.arange(len(site))
    return _sorted(observations, site, index, np.ones(len(site)), count)


def by_shares(
    observations: Observations,
    sites: Int[np.ndarray, "sample corner"],
    shares: Float[np.ndarray, "sample corner"],
    count: int,
) -> SiteObservations:
    """Sort observations each of which is shared among several sites (a bilinear splat).

    Each site's material is then a local mean, smoother than the texture; since neighbours share
    observations, the errors of their materials go together.
    """
    index = np.broadcast_to(np.arange(len(sites))[:, None], sites.shape)
    kept = shares > 0
    return _sorted(observations, sites[kept], index[kept], shares[kept], count)


def _sorted(
    observations: Observations,
    site: Int[np.ndarray, "part"],
    index: Int[np.ndarray, "part"],
    share: Float[np.ndarray, "part"],
    count: int,
) -> SiteObservations:
    if site.size and site.max() >= count:
        raise ValueError(f"site {site.max()} of {count} sites, numbered from 0: raise the count")
    used = site >= 0
    if not used.any():
        raise ValueError("no observation has a site: do the cameras see the textured surface?")
    order = np.flatnonzero(used)[np.argsort(site[used], kind="stable")]
    index = index[order]
    radiance = np.asarray(observations.radiance)[index]
    if not np.isfinite(radiance).all():
        raise ValueError("the radiance is not finite somewhere: leave such pixels out (site -1)")
    cosines = np.asarray(observations.samples.exit_cosines)[index]
    clusters = Clusters.of(observations).take(index)
    return SiteObservations(
        radiance,
        cosines,
        site[order],
        index,
        share[order],
        clusters,
        count,
        observations.rounding,
    )


def whole_sites(measured: SiteObservations, most: int, seed: int) -> SiteObservations:
    """Draw sites at random until they have ``most`` observations, and number them anew.

    Sites seen only once say nothing of the lobe and are left out, unless there are no others.
    """
    seen = measured.seen
    useful = np.flatnonzero(seen >= min(2, seen.max()))
    drawn = np.random.default_rng(seed).permutation(useful)
    # One site at least, and all where they fit.
    kept = drawn[: max(1, int(np.searchsorted(np.cumsum(seen[drawn]), most, side="right")))]
    chosen = np.zeros(measured.count, bool)
    chosen[kept] = True
    some = measured.of_sites(chosen)
    number = np.cumsum(chosen) - 1
    return some._replace(site=number[some.site], count=len(kept))


class Chunk(NamedTuple):
    """Observations of consecutive sites, filled up to a fixed length by some without weight."""

    measured: SiteObservations
    sites: Int[np.ndarray, "site"]
    filled: Bool[np.ndarray, "sample"]


def in_chunks(measured: SiteObservations, length: int) -> Iterator[Chunk]:
    """Cut sorted observations between sites, so that each chunk is solved by itself.

    Every chunk has the same length and number of sites, so one compiled program serves them all.
    No site has more observations than the longest chunk: ``length`` grows to that.
    """
    seen = measured.seen
    present = np.flatnonzero(seen)
    ends = np.cumsum(seen[present])
    length = max(length, int(seen.max()))
    first, start = 0, 0
    while first < len(present):
        last = int(np.searchsorted(ends, start + length, side="right"))
        rows = np.arange(start, ends[last - 1])
        filled = np.arange(length) >= len(rows)
        rows = np.concatenate([rows, np.full(length - len(rows), rows[-1])])
        sites = present[first:last]
        part = measured.take(rows)
        number = np.searchsorted(sites, part.site)
        yield Chunk(part._replace(site=number, count=length), sites, filled)
        first, start = last, int(ends[last - 1])
