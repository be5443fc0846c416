"""Light, K_s(x), sigma and mu from what moves with the view, all at once, with their errors.

    B_i(x) = constant(x) + K_s(x) sum_lm S_lm(i; sigma, mu) L_lm

The weighted mean of each site takes its constant away.  The rest is bilinear in K_s and the light,
and smooth in sigma and mu.  Levenberg-Marquardt solves for all of them.  A site's K_s meets only
its own observations, so the normal matrix is an arrow.  Elimination of the K_s leaves one system in
light, sigma and mu, whatever the number of sites.  Its inverse is their covariance, and includes
the uncertainty of the K_s.

Where each site is seen a few times only, the noise of thousands of K_s would bias all that they
share.  So the search does not take the best K_s.  It maximises the likelihood of light, sigma and
mu with every K_s integrated out, which adds half the logarithm of its precision.  One K_s for all
sites would make sigma explain what K_s did: 10 % of it, where K_s varied by a third.

The priors are estimated too.  Coefficients of each degree above 0 are expected to have the size
that is found, and K_s the mean 1 and the spread that is found.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics import band_limit_of, degrees
from jaxrender.inverse.texture.harmonic_columns import LobeColumns
from jaxrender.inverse.texture.measurements import SiteData
from jaxrender.inverse.texture.site_sums import over_sites
from jaxrender.inverse.texture.specular_prior import spread_of
from jaxrender.inverse.texture.view_dependent import off_site_mean
from jaxrender.shapes import AnyArray, Array, Float

# Steps at most; in half of them or fewer a search has ended.
_STEPS = 40
# A step that gains less than this of chi-squared / 2 is the last: .04 standard errors.
_LEAST_GAIN = 1e-3
# Rounds of what is expected of light and K_s, and the search with that.
_EXPECTATIONS = 2
# Light is expected within this many times the size of its degree.  At 1 the prior would draw the
# light towards zero, and sigma would be 1 standard error off.
_GENEROSITY = 3.0
# Damping, in parts of the diagonal: at the start, and when to give up.
_FIRST_DAMPING, _MOST_DAMPING = 1e-4, 1e8

# Both lobes' columns at a search point.  A pytree, to be compiled once.
ColumnsAt = Callable[[Float[Array, "unknown"]], LobeColumns]


class State(NamedTuple):
    """Where a search is: sigma and mu as a search point, light, and K_s over its mean."""

    point: Float[np.ndarray, "unknown"]
    light: Float[np.ndarray, "coefficient channel"]
    ks: Float[np.ndarray, "site"]


class ViewDependentFit(NamedTuple):
    """The end of a search.

    ``covariance`` is of the search point and then of the light, one channel after the other, where
    the mean K_s of these sites is 1.
    """

    state: State
    covariance: Float[np.ndarray, "all all"]
    converged: bool

    @property
    def light_variance(self) -> Float[np.ndarray, "coefficient channel"]:
        """The light's own variances."""
        own = np.diag(self.covariance)[len(self.state.point) :]
        return own.reshape(self.state.light.T.shape).T


class _Expected(NamedTuple):
    """1 / variance of each coefficient and of each K_s about 1."""

    light: Float[np.ndarray, "coefficient channel"]
    ks: float


class _Sums(NamedTuple):
    """Inner products of the residual's derivatives, of one channel (stacked over channels).

    ``gram`` and ``moment`` are of the search point and the light; ``arm``, ``hub`` and ``pull`` of
    each site's K_s with these, with itself and with the residual.  ``swell`` is half the derivative
    of ``hub`` by search point and light.
    """

    gram: Float[AnyArray, "channel all all"]
    moment: Float[AnyArray, "channel all"]
    arm: Float[AnyArray, "channel site all"]
    hub: Float[AnyArray, "channel site"]
    pull: Float[AnyArray, "channel site"]
    swell: Float[AnyArray, "channel site all"]
    squares: Float[AnyArray, "channel"]


def search_view_dependent(
    columns_at: ColumnsAt,
    data: SiteData,
    kd: Float[np.ndarray, "site channel"],
    start: State,
    before: ViewDependentFit | None = None,
) -> ViewDependentFit:
    """Search from ``start``; a site's K_d counts only where the surface turns within the site.

    ``before`` is an earlier fit of the same, with another K_d.
    """

    def evaluate(state: State) -> _Sums:
        return _evaluate(columns_at, data, kd, state)

    state, sums = start, evaluate(start)
    variance = np.zeros_like(start.light) if before is None else before.light_variance
    for _ in range(_EXPECTATIONS if before is None else 1):
        state, expected = _expectations(state, sums, variance)
        state, sums, converged = _descend(evaluate, state, expected)
        fit = ViewDependentFit(state, _covariance(state, sums, expected, data), converged)
        variance = fit.light_variance
    return fit


def _descend(
    evaluate: Callable[[State], _Sums], state: State, expected: _Expected
) -> tuple[State, _Sums, bool]:
    sums, damping = evaluate(state), _FIRST_DAMPING
    for _ in range(_STEPS):
        cost = _cost(state, sums, expected)
        step = _step(state, sums, expected, damping)
        tried = State(*(a + b for a, b in zip(state, step)))
        after = evaluate(tried)
        gain = cost - _cost(tried, after, expected)
        if not gain >= 0:
            damping *= 10
            if damping > _MOST_DAMPING:
                break
            continue
        state, sums, damping = tried, after, damping / 10
        if gain < _LEAST_GAIN:
            return state, sums, True
    return state, sums, False


def _evaluate(
    columns_at: ColumnsAt, data: SiteData, kd: Float[np.ndarray, "site channel"], state: State
) -> _Sums:
    return _Sums(*map(np.asarray, _sums(columns_at, data, kd, state)))


@eqx.filter_jit
def _sums(
    columns_at: ColumnsAt, data: SiteData, kd: Float[AnyArray, "site channel"], state: State
) -> _Sums:
    point, light, ks = (jnp.asarray(part) for part in state)
    weights, radiance = jnp.asarray(data.weights), jnp.asarray(data.radiance)
    site = jnp.asarray(data.site)

    def twice(at: Float[Array, "unknown"]) -> tuple[Array, LobeColumns]:
        both = columns_at(at)
        return both.specular, both

    # One pass for the columns and their slopes.
    slopes, both = jax.jacfwd(twice, has_aux=True)(point)

    def of_channel(inputs: tuple) -> _Sums:
        weight, values, own_kd, own_light = inputs

        def left(rows: Float[Array, "sample k"]) -> Float[Array, "sample k"]:
            return weight[:, None] * off_site_mean(rows, weight, data)

        by_point = jnp.einsum("nkp,k->np", slopes, own_light)
        lobe = left(jnp.concatenate([by_point, both.specular], axis=1))
        base = jnp.pad(left(own_kd[site][:, None] * both.diffuse), ((0, 0), (len(point), 0)))
        matrix = ks[site][:, None] * lobe + base
        moving = lobe[:, len(point) :] @ own_light
        residual = left(values[:, None])[:, 0] - matrix[:, len(point) :] @ own_light
        return _Sums(
            matrix.T @ matrix,
            matrix.T @ residual,
            over_sites(moving[:, None] * matrix, data),
            over_sites(moving**2, data),
            over_sites(moving * residual, data),
            over_sites(moving[:, None] * lobe, data),
            jnp.sum(residual**2),
        )

    with jax.default_matmul_precision("highest"):
        return jax.lax.map(of_channel, (weights.T, radiance.T, jnp.asarray(kd).T, light.T))


def _expectations(
    state: State, sums: _Sums, variance: Float[np.ndarray, "coefficient channel"]
) -> tuple[State, _Expected]:
    """Learn what to expect from a state, the variance of its light included; mean K_s becomes 1."""
    precision = np.sum(sums.hub, axis=0)
    free = state.ks + np.sum(sums.pull, axis=0) / np.where(precision > 0, precision, 1)
    prior = spread_of(free, precision)
    mean = float(prior.mean) if prior.mean > 0 else 1.0
    light = state.light * mean
    expected = _Expected(light_precision(light, variance), float(prior.precision) * mean**2)
    return State(state.point, light, state.ks / mean), expected


def light_precision(
    light: Float[np.ndarray, "coefficient channel"],
    variance: Float[np.ndarray, "coefficient channel"],
) -> Float[np.ndarray, "coefficient channel"]:
    """Expect coefficients of each degree above 0 to have the size that is found: 1 / variance.

    ``variance`` is that of the light found; of degree 0 nothing is expected.
    """
    degree = degrees(band_limit_of(len(light)))
    square = np.stack([np.bincount(degree, part) for part in (light**2 + variance).T], axis=1)
    size = square / np.bincount(degree)[:, None]
    wide = _GENEROSITY**2 * np.maximum(size, 1e-300)[degree]
    return np.where(degree[:, None] > 0, 1 / wide, 0.0)


def _cost(state: State, sums: _Sums, expected: _Expected) -> float:
    """Half of chi-squared, what was expected included, and the room that is left to the K_s."""
    light = np.sum(expected.light * state.light**2)
    spread = expected.ks * np.sum((state.ks - 1) ** 2)
    room = np.sum(np.log(_sites(state, sums, expected).hub))
    return float(np.sum(sums.squares) + light + spread + room) / 2


def _step(state: State, sums: _Sums, expected: _Expected, damping: float) -> State:
    """Solve the arrow: the hub of light, sigma and mu first, then every site's K_s."""
    system, moment = _hub_system(state, sums, expected)
    sites = _sites(state, sums, expected)
    scale = np.sqrt(np.maximum(np.diag(system), 1e-300))
    damped = system / np.outer(scale, scale) + damping * np.eye(len(system))
    moved = np.linalg.solve(damped, moment / scale) / scale
    count = len(state.point)
    light = moved[count:].reshape(state.light.T.shape).T
    return State(moved[:count], light, (sites.pull - sites.arms @ moved) / sites.hub)


class _Sites(NamedTuple):
    """Each K_s's own precision, its products with all other unknowns, and its moment."""

    hub: Float[np.ndarray, "site"]
    arms: Float[np.ndarray, "site all"]
    pull: Float[np.ndarray, "site"]


def _sites(state: State, sums: _Sums, expected: _Expected) -> _Sites:
    hub = np.sum(sums.hub, axis=0) + expected.ks
    pull = np.sum(sums.pull, axis=0) - expected.ks * (state.ks - 1)
    return _Sites(np.where(hub > 0, hub, 1), _joined(state, sums.arm), pull)


def _joined(
    state: State, parts: Float[AnyArray, "channel site all"]
) -> Float[np.ndarray, "site everything"]:
    """Put the channels' products with search point and own light side by side."""
    count, (size, channels) = len(state.point), state.light.shape
    rows = np.zeros((parts.shape[1], count + channels * size))
    for channel, part in enumerate(parts):
        rows[:, :count] += part[:, :count]
        rows[:, _own(channel, count, size)] = part[:, count:]
    return rows


def _hub_system(
    state: State, sums: _Sums, expected: _Expected
) -> tuple[Float[np.ndarray, "all all"], Float[np.ndarray, "all"]]:
    """Write the normal equations of search point and light, every K_s taken out."""
    count, (size, channels) = len(state.point), state.light.shape
    total = count + channels * size
    system, moment = np.zeros((total, total)), np.zeros(total)
    for channel, (gram, right) in enumerate(zip(sums.gram, sums.moment)):
        own = np.concatenate([np.arange(count), np.arange(total)[_own(channel, count, size)]])
        system[np.ix_(own, own)] += gram
        moment[own] += right
    precision = np.concatenate([np.zeros(count), expected.light.T.ravel()])
    values = np.concatenate([np.zeros(count), state.light.T.ravel()])
    hub, arms, pull = _sites(state, sums, expected)
    system += np.diag(precision) - arms.T @ (arms / hub[:, None])
    moment -= precision * values + arms.T @ (pull / hub)
    return system, moment - np.sum(_joined(state, sums.swell) / hub[:, None], axis=0)


def _own(channel: int, count: int, size: int) -> slice:
    return slice(count + channel * size, count + (channel + 1) * size)


def _covariance(
    state: State, sums: _Sums, expected: _Expected, data: SiteData
) -> Float[np.ndarray, "all all"]:
    """Invert the system, scaled by what is left where that is more than the noise."""
    system, _ = _hub_system(state, sums, expected)
    scale = np.sqrt(np.maximum(np.diag(system), 1e-300))
    values, vectors = np.linalg.eigh(system / np.outer(scale, scale))
    inverse = vectors / np.maximum(values, np.finfo(float).eps) @ vectors.T
    found = _in_gauge(inverse / np.outer(scale, scale), state, _sites(state, sums, expected))
    channels, sites = state.light.shape[1], len(np.unique(data.site))
    measured = int(np.count_nonzero(np.asarray(data.weights)))
    freedom = measured - sites * (channels + 1) - len(system)
    return max(float(np.sum(sums.squares)) / max(freedom, 1), 1.0) * found


def _in_gauge(
    covariance: Float[np.ndarray, "all all"], state: State, sites: _Sites
) -> Float[np.ndarray, "all all"]:
    """Turn to the light times the mean K_s of the sites: their scale against each other is free."""
    hub, arms = sites.hub, sites.arms
    light = np.concatenate([np.zeros(len(state.point)), state.light.T.ravel()])
    # The mean K_s goes with the other unknowns by the arms, and has some noise of its own.
    turned = np.eye(len(light)) - np.outer(light, np.mean(arms / hub[:, None], axis=0))
    own = np.mean(1 / hub) / len(hub)
    return turned @ covariance @ turned.T + own * np.outer(light, light)
