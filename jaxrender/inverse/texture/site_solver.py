"""The search for the numbers of every site, at what all sites share.

Levenberg and Marquardt's method, every site by itself, all sites of a part at once.  The lobe is
linearised anew at each step.  A site's sigma may be far from that of all others, and its
chi-squared may have several minima: so the search begins at the best of some sigmas, and of both
ends of a share of metal.
"""

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.models import LinearisedModel
from jaxrender.inverse.texture.coloured_sites import KsPrior
from jaxrender.inverse.texture.forward import ModelOf
from jaxrender.inverse.texture.measurements import SiteData, SiteObservations, in_chunks
from jaxrender.inverse.texture.site_detail import Tiltable
from jaxrender.inverse.texture.site_equations import (
    Expected,
    SiteEquations,
    chi_squared,
    equations_of,
)
from jaxrender.inverse.texture.site_numbers import NUMBERS, TiltedModel, tangents_of
from jaxrender.inverse.texture.site_sums import SiteMaterial
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.inverse.weights import deviations
from jaxrender.shapes import Array, Bool, Float, Int, in_precision

# The integrals' own errors are noise as well: without them what is dark would decide on normals.
LEAST_NOISE = 1e-3
# Observations solved at once: few lengths, so that few programs are compiled.
_LENGTHS = (2**9, 2**11, 2**13)
# Where a site's chi-squared is so many times what is usual, or so many standard deviations above
# it, it is tried from other numbers.
_BAD, _NO_CHANCE = 2.5, 5.0
# A search ends where no step would lower a site's chi-squared by more than this.
_GAIN, _STEPS = 0.05, 10
_FIRST_DAMPING, _DAMPED_MORE, _UNDAMPED = 1e-2, 10.0, 1e-3


class Asked(NamedTuple):
    """What is searched for at each site, and what is given.

    ``expected`` is typical of all sites; ``nearby`` is what neighbours of each make one expect.
    """

    names: tuple[str, ...]
    unknowns: Unknowns
    point: Float[np.ndarray, "unknown"]
    prior: KsPrior
    expected: Expected
    noise: NoiseModel
    nearby: Expected | None = None

    def expected_at(self, sites: Int[np.ndarray, "some"], count: int) -> Expected:
        """What is expected of some sites, filled up to a count."""
        if self.nearby is None:
            return Expected(*(np.tile(part, (count, 1)) for part in self.expected))
        rows = np.concatenate([sites, np.repeat(sites[-1:], count - len(sites))])
        return Expected(*(part[rows] for part in self.nearby))

    @property
    def shared(self) -> Int[np.ndarray, "shared"]:
        """Which of the search variables all sites share."""
        own = [name for name in self.unknowns.names if name not in self.names]
        return np.array([self.unknowns.names.index(name) for name in own], int)

    def own(self, measured: SiteObservations) -> int:
        """Count what each site has for itself: K_d, K_s and numbers."""
        channels = measured.radiance.shape[1]
        return channels + self.prior.amplitudes(channels) + len(self.names)

    @property
    def bounds(self) -> tuple[Float[np.ndarray, "number"], Float[np.ndarray, "number"]]:
        """Between what each number lies."""
        low, high = np.full((2, len(self.names)), [[-1.0], [1.0]])
        for at, name in enumerate(self.names):
            if name in self.unknowns:
                ends = self.unknowns.range_of(name)
                low[at], high[at] = np.log(ends) if NUMBERS[name].logarithmic else ends
        return low, high

    def begun(self, again: bool = False) -> "list[Float[np.ndarray, 'number']]":
        """List where a search may begin, or begin ``again``: first of all, at what is expected."""
        low, high = self.bounds
        each = []
        for name, mean, *ends in zip(self.names, self.expected.mean, low, high):
            number = NUMBERS[name]
            values = [mean + beside for beside in (number.again if again else number.trials)]
            if number.logarithmic and not again:
                values = [v for v in values if v == mean or ends[0] <= v <= ends[1]]
            each.append(dict.fromkeys(np.clip(values or [mean], *ends).tolist()))
        return [np.array(values) for values in itertools.product(*each)]

    def numbers(self, value: Float[np.ndarray, "sample number"]) -> dict[str, Float[Array, "..."]]:
        """Name all numbers that the model asks for."""
        every = dict(self.unknowns.unpack(jnp.asarray(self.point)).numbers)
        for name, column in zip(self.names, value.T):
            every[name] = jnp.asarray(np.exp(column) if NUMBERS[name].logarithmic else column)
        return every


class Solved(NamedTuple):
    """The end of the search of sites: their numbers, what is known there, and what is predicted."""

    value: Float[np.ndarray, "site number"]
    local: SiteEquations
    axes: Float[np.ndarray, "site 2 3"]
    predicted: Float[np.ndarray, "sample channel"]

    @classmethod
    def begin(
        cls, measured: SiteObservations, value: Float[np.ndarray, "site number"], prior: KsPrior
    ) -> "Solved":
        """Know nothing yet."""
        count, channels = measured.count, measured.radiance.shape[1]
        of_ks = prior.amplitudes(channels)
        size = channels + of_ks + value.shape[1]
        dark = np.zeros((count, of_ks) if of_ks > 1 else count)
        local = SiteEquations(
            np.full(count, np.inf),
            np.zeros((count, size)),
            np.tile(np.eye(size), (count, 1, 1)),
            SiteMaterial(np.zeros((count, channels)), dark),
        )
        nowhere = np.tile(np.eye(3)[:2], (count, 1, 1))
        return cls(value.copy(), local, nowhere, np.zeros_like(measured.radiance))

    def put(self, chosen: Bool[np.ndarray, "site"], other: "Solved") -> None:
        """Replace what is known of the chosen sites."""
        for place, part in zip(jax.tree.leaves(self[:3]), jax.tree.leaves(other[:3])):
            place[chosen] = part[chosen]


def solve_numbers_of(
    measured: SiteObservations,
    model_of: ModelOf,
    asked: Asked,
    start: Float[np.ndarray, "site number"] | None,
) -> Solved:
    """Search every site, and from other numbers again those that are not yet explained."""
    found = solve_at(measured, model_of, asked, start)
    if not any(NUMBERS[name].again for name in asked.names):
        return found
    seen, values = measured.seen > 0, np.maximum(measured.seen, 1) * measured.radiance.shape[1]
    # Where the model is wrong everywhere, other numbers are of no help.
    usual = max(float(np.median((found.local.cost / values)[seen])), 1.0)
    most = usual * values * np.minimum(_BAD, 1 + _NO_CHANCE * np.sqrt(2 / values))
    for begun in asked.begun(again=True):
        bad = seen & (found.local.cost > most)
        if not bad.any():
            break
        other = np.tile(begun, (measured.count, 1))
        rows = np.flatnonzero(bad[measured.site])
        trial = solve_at(measured.take(rows), model_of, asked, other)
        better = bad & (trial.local.cost < found.local.cost)
        found.put(better, trial)
        of_better = better[measured.site[rows]]
        found.predicted[rows[of_better]] = trial.predicted[of_better]
    return found


def solve_at(
    measured: SiteObservations,
    model_of: ModelOf,
    asked: Asked,
    start: Float[np.ndarray, "site number"] | None = None,
) -> Solved:
    """Search the numbers of every site; those that have settled are not evaluated again."""
    first = _first(measured, model_of, asked, start)
    solved = Solved.begin(measured, first.value, asked.prior)
    trial, damping = solved.value.copy(), np.zeros(measured.count)
    largest, (low, high) = np.array([NUMBERS[name].step for name in asked.names]), asked.bounds
    active = measured.seen > 0
    for _ in range(_STEPS):
        rows = np.flatnonzero(active[measured.site])
        weigh = first.predicted[rows]
        for part in parts_of(measured.take(rows), model_of, asked, trial, weigh, asked.names):
            found, foreseen = equations_of(
                part.near, part.data, asked.prior, part.expected, part.value, asked.names
            )
            better = np.asarray(found.cost)[: len(part.sites)] <= solved.local.cost[part.sites]
            sites = part.sites[better]
            for place, new in zip(jax.tree.leaves(solved.local), jax.tree.leaves(found)):
                place[sites] = np.asarray(new)[: len(part.sites)][better]
            solved.value[sites], solved.axes[part.sites] = trial[sites], part.axes
            own = better[part.data.site[: part.kept]]
            solved.predicted[rows[part.rows][own]] = np.asarray(foreseen)[: part.kept][own]
            harder = np.maximum(damping[part.sites], _FIRST_DAMPING) * _DAMPED_MORE
            damping[part.sites] = np.where(better, damping[part.sites] / _DAMPED_MORE, harder)
        damping[damping < _UNDAMPED] = 0
        at = np.flatnonzero(active)
        matrix, gradient = (np.asarray(part)[at] for part in solved.local[2:0:-1])
        slopes = gradient[:, gradient.shape[1] - len(largest) :]
        ended = solved.value[at] >= high, solved.value[at] <= low
        stays = (ended[0] & (slopes > 0)) | (ended[1] & (slopes < 0))
        step = _step(matrix, gradient, damping[at], stays)
        trial[at] = np.clip(solved.value[at] + np.clip(step, -largest, largest), low, high)
        gain = (trial[at] - solved.value[at]) * slopes
        active[at] = np.sum(gain, axis=1) > _GAIN
        if not active.any():
            break
    return solved


class _First(NamedTuple):
    """Where sites begin, and what is predicted there, by which observations are weighed."""

    value: Float[np.ndarray, "site number"]
    predicted: Float[np.ndarray, "sample channel"]


def _first(
    measured: SiteObservations,
    model_of: ModelOf,
    asked: Asked,
    start: Float[np.ndarray, "site number"] | None,
) -> _First:
    """Take the start that is given, or the best of some, with the normals of the shape."""
    begun = asked.begun() if start is None else []
    trials = [np.tile(one, (measured.count, 1)) for one in begun] if start is None else [start]
    value, foreseen = trials[0].copy(), np.zeros_like(measured.radiance)
    least = np.full(measured.count, np.inf)
    for trial in trials:
        for part in parts_of(measured, model_of, asked, trial, measured.radiance, ()):
            found = chi_squared(part.near, part.data, asked.prior, part.expected, part.value)
            cost, image = (np.asarray(one) for one in found)
            better = cost[: len(part.sites)] < least[part.sites]
            sites, own = part.sites[better], better[part.data.site[: part.kept]]
            least[sites], value[sites] = cost[: len(part.sites)][better], trial[sites]
            foreseen[part.rows][own] = image[: part.kept][own]
    return _First(value, foreseen)


class Part(NamedTuple):
    """Some sites and their observations: those of ``rows``, and then some of no weight.

    ``near`` is their model about the numbers ``value`` of these sites.
    """

    sites: Int[np.ndarray, "site"]
    rows: slice
    kept: int
    near: LinearisedModel
    data: SiteData
    value: Float[np.ndarray, "padded number"]
    axes: Float[np.ndarray, "site 2 3"]
    expected: Expected


def parts_of(
    measured: SiteObservations,
    model_of: ModelOf,
    asked: Asked,
    value: Float[np.ndarray, "site number"],
    weigh: Float[np.ndarray, "sample channel"],
    by: tuple[str, ...],
    dtype: type[np.floating] = np.float32,
) -> Iterator[Part]:
    """Go through a surface, and linearise ``by`` some numbers about the ``value`` of each site.

    Observations have the weights of the radiance ``weigh``.  The model is evaluated in single
    precision: what that rounds is far below noise, and its programs run nearly twice as fast.
    """
    scale, done = float(np.sqrt(np.mean(measured.radiance**2))) or 1.0, 0
    enough = [length for length in _LENGTHS if length >= len(measured.site)]
    for chunk in in_chunks(measured, (enough or _LENGTHS[-1:])[0]):
        part, kept = chunk.measured, int(np.count_nonzero(~chunk.filled))
        rows, done = slice(done, done + kept), done + kept
        radiance = part.radiance.copy()
        radiance[:kept] = weigh[rows]
        share = np.where(chunk.filled, 0, part.share)
        deviation = np.hypot(deviations(asked.noise, radiance, scale), LEAST_NOISE * scale)
        weights = np.sqrt(share)[:, None] / deviation
        model, axes = model_of(part.index), np.zeros((len(chunk.sites), 2, 3))
        if "tilt_x" in asked.names:
            assert isinstance(model, Tiltable)
            normals = np.asarray(model.samples.normals, float)[:kept]
            # Of as many sites in every chunk, so that one program does for all.
            axes = tangents_of(normals, part.site[:kept], part.count)[: len(chunk.sites)]
            model = TiltedModel(model, axes[part.site])
        more = np.repeat(value[chunk.sites[-1:]], part.count - len(chunk.sites), axis=0)
        own = np.concatenate([value[chunk.sites], more])
        given = in_precision(dtype, (model, asked.numbers(own[part.site])))
        with jax.default_matmul_precision("highest"):
            near = in_precision(own.dtype, LinearisedModel.about(*given, by))
        data = SiteData(part.radiance, weights, part.site, part.count)
        expected = asked.expected_at(chunk.sites, part.count)
        yield Part(chunk.sites, rows, kept, near, data, own, axes, expected)


def _step(
    matrix: Float[np.ndarray, "site n n"],
    gradient: Float[np.ndarray, "site n"],
    damping: Float[np.ndarray, "site"],
    stays: Bool[np.ndarray, "site number"],
) -> Float[np.ndarray, "site number"]:
    """Solve for how far the numbers go, K_d and K_s following; those at a bound may stay there."""
    numbers = stays.shape[1]
    held = np.zeros(gradient.shape, bool)
    held[:, gradient.shape[1] - numbers :] = stays
    damped = np.asarray(matrix, float)
    damped = np.where(held[:, :, None] | held[:, None, :], np.eye(gradient.shape[1]), damped)
    gradient = np.where(held, 0, gradient)
    for at in range(1, numbers + 1):
        damped[:, -at, -at] *= 1 + damping
    first = gradient.shape[1] - numbers
    return np.linalg.solve(damped, gradient[..., None])[:, first:, 0]
