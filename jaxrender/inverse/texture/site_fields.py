"""What sites near each other have in common: a number as a random field over the surface.

    v(x) = m + f(x) + g,    cov f(x), f(y) = (1 - o) t^2 k(|x - y| / l),    var g = o t^2

f is shared by neighbours, and g is each site's own.  k is Matern's kernel of order 5/2.  The length
l and the share o are learned: with them what others tell of a site is likeliest, the site itself
left out (Rasmussen and Williams 2006, 5.4.2).  Where neighbours are nothing alike o is 1.  Learned,
too, is by what factor the sites contradict each other more than their errors say.

Two things follow by conditioning on the nearest sites (kriging): what to expect of a site before
its own photographs are looked at, and how the number varies within the site.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jaxrender.inverse.texture.specular_prior import normal_spread
from jaxrender.shapes import Float, Int

# Sites that a field is looked up from, and those that it is learned on.
_NEAREST, _LEARNED_ON = 16, 600
# Lengths in distances of neighbours, and shares of the variance that are each site's own.
_LENGTHS = (1.0, 1.5, 2.0, 3.0, 4.5, 7.0, 11.0, 18.0)
_SHARES = (1e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 0.6, 1.0)
# Factors of the errors; and by how much one must be likelier (in logarithms) to be believed.
_SCALES, _BELIEVED = (1.0, 1.25, 1.6, 2.0, 2.5, 3.2), 2.0
# All three are sought one after the other, so many times.
_SWEEPS = 3
# A site that is further off counts no more: some searches end in a wrong minimum.
_FAR = 3.0
# Fewer sites tell nothing of a field.
_FEWEST = 30
# Sites at once, and points.
_AT_ONCE, _POINTS = 2**12, 2**17


class Within(NamedTuple):
    """How a field varies within sites: what to add to its ``mean`` over what was seen of each.

    ``variance`` is that of a point beside the middle of its site, on average.
    """

    more: Float[np.ndarray, "point component"]
    mean: Float[np.ndarray, "site component"]
    variance: Float[np.ndarray, "site"]


class Field(NamedTuple):
    """A number of every site, in one or more components, and what was learned of it.

    ``error`` is infinite where nothing is known.  ``variance`` is t^2, ``length`` l, ``own`` o, and
    ``scale`` by how much errors were found to be larger, as they now are.
    """

    places: Float[np.ndarray, "site 3"]
    value: Float[np.ndarray, "site component"]
    error: Float[np.ndarray, "site"]
    mean: Float[np.ndarray, "component"]
    variance: float
    length: float
    own: float
    scale: float = 1.0

    @classmethod
    def learn(
        cls,
        places: Float[np.ndarray, "site 3"],
        value: Float[np.ndarray, "site component"],
        error: Float[np.ndarray, "site"],
        seed: int,
        mean: Float[np.ndarray, "component"] | None = None,
    ) -> "Field | None":
        """Learn how alike neighbours are; None where too few sites are known.

        ``mean`` is that of the field where it is known.
        """
        known = np.isfinite(error) & np.isfinite(value).all(axis=1)
        if np.count_nonzero(known) < _FEWEST:
            return None
        precision = np.where(known, 1 / np.where(known, error, 1) ** 2, 0.0)
        spreads = [normal_spread(part, precision) for part in value.T]
        middle = np.array([one for one, _ in spreads]) if mean is None else mean
        variance = float(np.mean([one for _, one in spreads]))
        some = np.random.default_rng(seed).permutation(np.flatnonzero(known))[:_LEARNED_ON]
        field = cls(places, value, np.where(known, error, np.inf), middle, variance, 1.0, 0.1)
        near, distance = field._nearest(some)
        lengths = float(np.median(distance[:, 0]) or 1.0) * np.array(_LENGTHS)
        field = field._replace(length=float(np.median(lengths)))
        for _ in range(_SWEEPS):
            before = field.length, field.own, field.scale
            field = _likeliest([field._replace(length=float(x)) for x in lengths], some, near)
            field = _likeliest([field._replace(own=own) for own in _SHARES], some, near)
            field = _likeliest([field._scaled(one) for one in _SCALES], some, near, _BELIEVED)
            if before == (field.length, field.own, field.scale):
                break
        return field

    def _scaled(self, scale: float) -> "Field":
        return self._replace(error=self.error * (scale / self.scale), scale=scale)

    def expected(
        self,
    ) -> tuple[Float[np.ndarray, "site component"], Float[np.ndarray, "site"]]:
        """Say what neighbours make one expect of each site: mean and variance."""
        mean = np.tile(self.mean, (len(self.places), 1))
        variance = np.full(len(self.places), self.variance)
        for sites in _parts(np.flatnonzero(np.isfinite(self.places).all(axis=1))):
            mean[sites], variance[sites] = self._foreseen(sites, self._nearest(sites)[0])
        return mean, variance

    def within(
        self, points: Float[np.ndarray, "point 3"], site: Int[np.ndarray, "point"]
    ) -> "Within":
        """Say how what is shared varies within each site; points come in the order of sites."""
        count, components = len(self.places), self.value.shape[1]
        more, unsure = np.zeros((len(points), components)), np.zeros(len(points))
        present, first = np.unique(site, return_index=True)
        ends = np.append(first, len(site))
        most = max(int(_POINTS * len(present) / max(len(points), 1)), 1)
        for part in _parts(np.arange(len(present)), min(most, _AT_ONCE)):
            rows, sites = slice(ends[part[0]], ends[part[-1] + 1]), present[part]
            near = np.concatenate([sites[:, None], self._nearest(sites)[0]], axis=1)
            inverse = np.linalg.inv(self._matrix(near))
            pull = np.einsum("snm,smc->snc", inverse, self._off(near))
            own = site[rows]
            place, around = np.searchsorted(sites, own), self.places[near]
            across, middle = (
                self._kernel(np.linalg.norm(at[:, None] - around[of], axis=2))
                for at, of in ((points[rows], place), (self.places[sites], np.arange(len(sites))))
            )
            more[rows] = np.einsum("pn,pnc->pc", across, pull[place])
            apart = across - middle[place]
            told = np.einsum("pn,pnm,pm->p", apart, inverse[place], apart)
            far = np.linalg.norm(points[rows] - self.places[own], axis=1)
            unsure[rows] = 2 * (self._kernel(np.zeros(1)) - self._kernel(far)) - told
        seen = np.maximum(np.bincount(site, minlength=count), 1)
        sums = [np.bincount(site, part, minlength=count) for part in (*more.T, unsure)]
        mean = np.stack(sums[:-1], axis=1) / seen[:, None]
        return Within(more - mean[site], self.mean + mean, np.maximum(sums[-1] / seen, 0))

    def _kernel(self, apart: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        scaled = np.sqrt(5) * apart / self.length
        matern = (1 + scaled + scaled**2 / 3) * np.exp(-scaled)
        return (1 - self.own) * self.variance * matern

    def _nearest(
        self, sites: Int[np.ndarray, "some"]
    ) -> tuple[Int[np.ndarray, "some near"], Float[np.ndarray, "some near"]]:
        """Find the nearest known sites beside each."""
        known = np.flatnonzero(np.isfinite(self.error) & np.isfinite(self.places).all(axis=1))
        wanted = min(_NEAREST + 1, len(known))
        apart, near = KDTree(self.places[known]).query(self.places[sites], k=wanted)
        near, apart = known[near], np.array(apart)
        # A site is not its own neighbour: it goes last.
        apart[near == sites[:, None]] = np.inf
        order = np.argsort(apart, axis=1)[:, : wanted - 1]
        near, apart = (np.take_along_axis(part, order, axis=1) for part in (near, apart))
        short = _NEAREST - near.shape[1]
        return (
            np.pad(near, ((0, 0), (0, short)), mode="edge"),
            np.pad(apart, ((0, 0), (0, short)), mode="edge"),
        )

    def _matrix(self, near: Int[np.ndarray, "some near"]) -> Float[np.ndarray, "some near near"]:
        """Return the covariance of what was found of some sites together."""
        at = self.places[near]
        apart = np.linalg.norm(at[:, :, None] - at[:, None, :], axis=3)
        noise = self.own * self.variance + self.error[near] ** 2
        # Nothing is known of some, whose value then does not count.
        noise = np.where(np.isfinite(noise), noise, 1e6 * self.variance)
        return self._kernel(apart) + noise[:, :, None] * np.eye(near.shape[1])

    def _off(self, near: Int[np.ndarray, "some near"]) -> Float[np.ndarray, "some near component"]:
        """Say how far off the mean some sites are; 0 where nothing is known."""
        known = np.isfinite(self.error[near])[..., None]
        return np.nan_to_num(np.where(known, self.value[near] - self.mean, 0))

    def _foreseen(
        self, sites: Int[np.ndarray, "some"], near: Int[np.ndarray, "some near"]
    ) -> tuple[Float[np.ndarray, "some component"], Float[np.ndarray, "some"]]:
        apart = np.linalg.norm(self.places[sites, None] - self.places[near], axis=2)
        across, off = self._kernel(apart), self._off(near)
        both = np.concatenate([off, across[..., None]], axis=2)
        answer = np.linalg.solve(self._matrix(near), both)
        mean = np.einsum("sn,snc->sc", across, answer[..., :-1])
        told = np.einsum("sn,sn->s", across, answer[..., -1])
        return self.mean + mean, np.maximum(self.variance - told, 1e-9 * self.variance)

    def _likelihood(
        self, some: Int[np.ndarray, "some"], near: Int[np.ndarray, "some near"]
    ) -> float:
        """Say how likely sites are by what their neighbours foresee, on a logarithmic scale."""
        mean, variance = self._foreseen(some, near)
        whole = (variance + self.error[some] ** 2)[:, None]
        square = np.minimum((self.value[some] - mean) ** 2 / whole, _FAR**2)
        return -float(np.sum(square + np.log(whole))) / 2


def _likeliest(
    trials: list[Field],
    some: Int[np.ndarray, "some"],
    near: Int[np.ndarray, "some near"],
    believed: float = 0.0,
) -> Field:
    """Choose a field; one that comes later must be likelier by more than ``believed``."""
    best, most = trials[0], -np.inf
    for trial in trials:
        likelihood = trial._likelihood(some, near)
        if likelihood > most + believed:
            best, most = trial, likelihood
    return best


def places_of_sites(
    points: Float[np.ndarray, "sample 3"], site: Int[np.ndarray, "sample"], count: int
) -> Float[np.ndarray, "site 3"]:
    """Average the places of what was seen of every site; NaN where that was nothing."""
    seen = np.bincount(site, minlength=count)
    sums = np.stack([np.bincount(site, axis, minlength=count) for axis in points.T], axis=1)
    with np.errstate(invalid="ignore"):
        return sums / seen[:, None]


def _parts(every: Int[np.ndarray, "any"], most: int = _AT_ONCE) -> "list[Int[np.ndarray, 'some']]":
    return [every[first : first + most] for first in range(0, len(every), most)]
