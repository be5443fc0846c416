"""Light and material from photographs alone: slow light and lamps that are found one by one.

1. *Rounds*: lamps are added by matching pursuit, a few at first and more each time while they pay,
   and after each addition everything is fitted together: gloss, sigma, mu, the directions of all
   lamps by Gauss-Newton steps, slow light and energies inside each step.
2. *Refinement*: the exact integral says by how much the dual model is off where the fit ended; the
   fit is repeated on what that leaves, until nothing moves.
3. Weights start as radiance^-.7, so that highlights do not drown the rest while the light is still
   crude, and end as those of the noise found in the residuals.  Outliers count less from the start
   (Huber's loss): pixels that shadows' edges cross would otherwise buy lamps of their own.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.geometry import SurfaceSamples, fibonacci_sphere
from jaxrender.harmonics import LatLongGrid, band_limit_of, degrees, synthesise
from jaxrender.imaging import NoiseModel, estimate_noise
from jaxrender.inverse.factorization.joint import (
    Joint,
    Measured,
    Solved,
    descend_jointly,
    solve_light,
)
from jaxrender.inverse.factorization.pursuit import pursue
from jaxrender.inverse.factorization.response import (
    Guess,
    MirrorResponse,
    Response,
    gloss_share,
)
from jaxrender.inverse.factorization.sight import Sight
from jaxrender.inverse.weights import robust_weights
from jaxrender.lighting import LightNodes
from jaxrender.reflection import integral_columns, reflect_slow_light
from jaxrender.shapes import Array, Bool, Float

# Where the search begins when nothing is said: as much gloss, as an albedo, as kd, rather blurred.
_START_SIGMA, _START_MU = 0.25, 1.5
# Lamps added in each round, until there are as many as allowed or they no longer pay.
_ROUNDS = (8, 8, 16, 16, 16, 16, 16, 16)
# A round that found fewer is the last one.
_TOO_FEW = 3
_STEPS_PER_ROUND, _LAST_STEPS = 6, 4
# A direction, and an energy in each channel.
_UNKNOWNS_PER_LAMP = 5
# From this residual on, what the exact integral corrects matters beside what lamps explain.
_NEARLY_THERE = 0.05
# Directions tried, and samples that they are tried on.
_CANDIDATES, _PURSUIT_SAMPLES = 2048, 2000
# Highlights count by radiance to this power while the light is crude, the dark as if it had this
# part of the mean radiance.
_COMPRESSION, _DARK = -0.7, 1e-3
# What slow light alone is expected to leave of the photographs.
_FIRST_MISFIT = 0.1
# Standard deviation over the median of magnitudes, of Gaussian noise.
_NORMAL_DEVIATION = 1.4826
# Coefficients of degree l are expected within this part of the mean light over sqrt(l (l + 1)).
_LEAST_LIGHT = 0.2
_NEIGHBOURS_PER_SIGMA = 1.0
# The last steps end when no logarithm moves by more, nor what they aim at by more of its noise.
_REFINEMENTS, _SETTLED, _SAME_TARGET = 6, 2e-3, 0.02
# The directions by which what a concave object hides from itself is integrated.
_HIDDEN_GRID = LatLongGrid(48, 96)


class FactorSettings(NamedTuple):
    """How a factorization is done; the defaults are those of the command line."""

    band_limit: int = 10
    most_sources: int = 48
    smoothness: float = 1.0
    refine: bool = True
    noise: NoiseModel | None = None
    loss: str = "huber"


class Known(NamedTuple):
    """What is known of the material beforehand: ks / (kd + ks) of each channel, sigma, mu."""

    share: tuple[float, ...] | None = None
    sigma: float | None = None
    mu: float | None = None


DEFAULTS = FactorSettings()
NOTHING_KNOWN = Known()


class Round(NamedTuple):
    """Where one round ended."""

    sources: int
    share: Float[np.ndarray, "channel"]
    sigma: float
    mu: float
    relative_rms: float


class Task(NamedTuple):
    """What does not change: the photographs, how samples respond to light, what is known.

    ``sight`` tells which directions each sample sees; None where nothing is hidden.
    """

    radiance: Float[np.ndarray, "sample channel"]
    response: Response
    sight: Sight | None = None
    known: Known = NOTHING_KNOWN
    settings: FactorSettings = DEFAULTS


class State(NamedTuple):
    """Where a factorization stands.

    ``target`` is the radiance less what the dual model is known to leave out, ``level`` the mean
    radiance of the light in each channel.
    """

    guess: Guess
    active: Bool[np.ndarray, "source"]
    weights: Float[np.ndarray, "sample channel"]
    target: Float[np.ndarray, "sample channel"]
    level: Float[np.ndarray, "channel"]
    joint: Joint | None = None
    rounds: tuple[Round, ...] = ()


def begin(task: Task, misfit: float = _FIRST_MISFIT) -> State:
    """Start without lamps, at half gloss; the photographs count as known within ``misfit``."""
    known, radiance = task.known, task.radiance
    channels, lamps = radiance.shape[1], task.settings.most_sources
    sigma, mu = known.sigma or _START_SIGMA, known.mu or _START_MU
    variant = task.response.variant
    energy = float(variant.with_roughness(sigma, None if variant.mu is None else mu).energy)
    even = np.full(channels, 1 / (1 + energy))
    share = even if known.share is None else np.asarray(known.share)
    guess = Guess(
        jnp.asarray(np.log(share / (1 - share))),
        jnp.asarray(np.log(sigma)),
        jnp.asarray(np.log(mu - 1)),
        jnp.asarray(np.tile([0.0, 0.0, 1.0], (lamps, 1))),
    )
    mean = radiance.mean(axis=0)
    weights = np.maximum(radiance, _DARK * mean) ** _COMPRESSION
    weights = weights / (misfit * np.sqrt(np.mean((weights * radiance) ** 2)))
    return State(guess, np.zeros(lamps, bool), weights, radiance, mean)


def measured(task: Task, state: State) -> Measured:
    """Put target, weights and the light's penalty together."""
    degree = degrees(band_limit_of(task.response.slow_count))
    expected = task.settings.smoothness * np.sqrt(4 * np.pi) * state.level
    slow = (degree * (degree + 1))[:, None] / expected**2
    lamps = np.zeros((len(state.active), slow.shape[1]))
    return Measured(state.target, state.weights, np.concatenate([slow, lamps]))


def response_of(task: Task, state: State) -> Response:
    """Switch on the lamps in use, where they are seen."""
    seen = np.ones((len(task.radiance), 1))
    if task.sight is not None:
        seen = np.asarray(task.sight.of(state.guess.directions), float)
    return eqx.tree_at(lambda r: r.lit, task.response, jnp.asarray(seen * state.active[None, :]))


def free_unknowns(task: Task, state: State) -> Bool[np.ndarray, "unknown"]:
    """Mark the nonlinear unknowns that are searched for.

    Slow light alone tells a sharp lobe from a sharper one by next to nothing: roughness waits for
    the first lamps.
    """
    known, channels = task.known, task.radiance.shape[1]
    seen_sharply = bool(state.active.any()) or bool(state.rounds)
    material = [known.share is None] * channels + [known.sigma is None and seen_sharply]
    material.append(known.mu is None and task.response.variant.mu is not None)
    return np.concatenate([np.array(material), np.tile(state.active, 2)])


def descend(task: Task, state: State, steps: int, tolerance: float = 1e-4) -> State:
    """Fit everything with the lamps in use; those that come out dark are switched off."""
    while True:
        response = response_of(task, state)
        joint = descend_jointly(
            response,
            state.guess,
            measured(task, state),
            free_unknowns(task, state),
            (steps, tolerance),
        )
        light = np.asarray(joint.solved.light)
        state = state._replace(guess=joint.guess, joint=joint)
        dark = state.active & (light[response.slow_count :].sum(axis=1) <= 0)
        if not dark.any():
            break
        state = state._replace(active=state.active & ~dark)
    mean = np.abs(light[0]) / np.sqrt(4 * np.pi)
    return state._replace(level=np.maximum(mean, _LEAST_LIGHT * state.level))


def add_lamps(task: Task, state: State, count: int) -> State:
    """Add up to ``count`` lamps by pursuit, as long as each pays; the same state if none does."""
    count = min(count, int(np.count_nonzero(~state.active)))
    if count == 0:
        return state
    towards = fibonacci_sphere(_CANDIDATES)
    step = max(1, len(task.radiance) // _PURSUIT_SAMPLES)
    radiance, weights, penalty = measured(task, state)
    few = Measured(radiance[::step], weights[::step], np.asarray(penalty) / step)
    seen = None if task.sight is None else task.sight.of_fixed(towards)[::step]
    found = pursue(response_of(task, state).thinned(step), state.guess, few, towards, count, seen)
    pays = step * np.asarray(found.gains) > _worth(measured(task, state))
    chosen = np.asarray(found.chosen)[np.logical_and.accumulate(pays)]
    slots = np.flatnonzero(~state.active)[: len(chosen)]
    directions, active = np.array(state.guess.directions), state.active.copy()
    directions[slots], active[slots] = towards[chosen], True
    return state._replace(
        guess=state.guess._replace(directions=jnp.asarray(directions)), active=active
    )


def weigh_evenly(task: Task, state: State) -> State:
    """Scale the first weights so that chi-squared is one for each measurement.

    Under a robust loss outliers count less, and the scale is that of the rest.
    """
    assert state.joint is not None
    weights, loss = begin(task).weights, task.settings.loss
    left = weights * (state.target - np.asarray(state.joint.solved.predicted))
    if loss == "squares":
        return state._replace(weights=weights / np.sqrt(np.mean(left**2)))
    deviation = _NORMAL_DEVIATION * np.median(np.abs(left))
    return state._replace(weights=weights / deviation * robust_weights(left / deviation, loss))


def weigh_by_noise(task: Task, state: State) -> tuple[State, NoiseModel]:
    """Weigh by the noise given, or by that found in the residuals, and by the loss."""
    assert state.joint is not None
    left, deviation, noise = in_deviations(task, state, state.joint.solved)
    weights = robust_weights(left, task.settings.loss) / deviation
    return state._replace(weights=weights), noise


def in_deviations(
    task: Task, state: State, solved: Solved
) -> tuple[Float[np.ndarray, "sample channel"], Float[np.ndarray, "sample channel"], NoiseModel]:
    """Express residuals in standard deviations of the noise; return these and the noise too."""
    predicted = np.asarray(solved.predicted)
    left = state.target - predicted
    noise = task.settings.noise or estimate_noise(left, predicted)
    deviation = np.asarray(noise.standard_deviation(np.maximum(predicted, 0)))
    deviation = np.hypot(deviation, 1e-6 * np.sqrt(np.mean(task.radiance**2)))
    return left / deviation, deviation, noise


def without_idle_lamps(task: Task, state: State) -> State:
    """Switch off lamps whose energy the noise could have made up; fit the light again."""
    assert state.joint is not None
    solved, slow = state.joint.solved, task.response.slow_count
    inverse = np.linalg.inv(np.asarray(solved.normal)[:, slow:, slow:])
    covariance = np.einsum("crp,crq->cpq", inverse, inverse)
    energies = np.asarray(solved.light)[slow:].T
    idle = _idle_lamps(energies, covariance, state.active, _worth(measured(task, state)))
    if not idle.any():
        return state
    return descend(task, state._replace(active=state.active & ~idle), _STEPS_PER_ROUND)


def _idle_lamps(
    energies: Float[np.ndarray, "channel source"],
    covariance: Float[np.ndarray, "channel source source"],
    active: Bool[np.ndarray, "source"],
    worth: float,
) -> Bool[np.ndarray, "source"]:
    """Mark lamps not worth their unknowns, one after the other, the least first.

    Lamps in a crowd are idle each by itself, as the others would make up for it, but not together:
    once one is gone, energies and covariance of the rest are those given that it is dark.
    """
    idle = np.zeros(len(active), bool)
    while (active & ~idle).any():
        variance = np.einsum("cpp->cp", covariance)
        cost = np.sum(energies**2 / np.where(active & ~idle, variance, 1), axis=0)
        least = int(np.argmin(np.where(active & ~idle, cost, np.inf)))
        if cost[least] >= worth:
            break
        idle[least] = True
        column = covariance[:, :, least]
        slope = column / variance[:, least, None]
        energies = energies - slope * energies[:, least, None]
        covariance = covariance - slope[:, :, None] * column[:, None, :]
    return idle


def with_neighbours_merged(task: Task, state: State) -> State:
    """Make one lamp of those within a lobe's reach of each other, where that costs next to nothing.

    A lamp between two candidates is found twice.
    """
    assert state.joint is not None
    directions = np.asarray(state.guess.directions)
    energies = np.asarray(state.joint.solved.light)[task.response.slow_count :].sum(axis=1)
    reach = np.cos(_NEIGHBOURS_PER_SIGMA * float(jnp.exp(state.guess.sigma)))
    merged, active = np.array(directions), state.active.copy()
    for lamp in np.argsort(-energies):
        if not active[lamp]:
            continue
        near = active & (directions @ directions[lamp] > reach)
        mean = energies[near] @ directions[near]
        merged[lamp] = mean / np.linalg.norm(mean)
        active[near] = False
        active[lamp] = True
    fewer = int(np.count_nonzero(state.active) - np.count_nonzero(active))
    if not fewer:
        return state
    guess = state.guess._replace(directions=jnp.asarray(merged))
    trial = descend(task, state._replace(guess=guess, active=active), _STEPS_PER_ROUND)
    assert trial.joint is not None
    lost = 2 * float(trial.joint.solved.cost - state.joint.solved.cost)
    return trial if lost < fewer * _worth(measured(task, state)) else state


def light_the_scene(task: Task, state: State, watch: Callable[[Round], None]) -> State:
    """Add lamps in rounds while they pay."""
    for lamps in (0, *_ROUNDS):
        more = add_lamps(task, state, lamps) if lamps else state
        added = int(np.count_nonzero(more.active & ~state.active))
        if lamps and not added:
            break
        state = descend(task, more, _STEPS_PER_ROUND)
        state = weigh_evenly(task, state)
        if task.settings.refine and round_of(task, state).relative_rms < _NEARLY_THERE:
            state = corrected(task, state)
        state = state._replace(rounds=(*state.rounds, round_of(task, state)))
        watch(state.rounds[-1])
        if lamps and added < _TOO_FEW:
            break
    return state


def taken_up(task: Task, state: State) -> State:
    """Go on with other samples of the same photographs, from the guess and the light found."""
    fresh = begin(task, state.rounds[-1].relative_rms)._replace(
        guess=state.guess,
        active=state.active,
        level=state.level,
        joint=state.joint,
        rounds=state.rounds,
    )
    if task.settings.refine:
        fresh = corrected(task, fresh)
    solved = solve_light(response_of(task, fresh), fresh.guess, measured(task, fresh))
    return fresh._replace(joint=Joint(fresh.guess, solved, 0, False))


def settle(task: Task, state: State, watch: Callable[[Round], None]) -> State:
    """Take the last steps: with the noise's weights, and with the exact integral's corrections."""
    for turn in range(_REFINEMENTS):
        before, target = _material(state), state.target
        state, _ = weigh_by_noise(task, state)
        if task.settings.refine:
            state = corrected(task, state)
        state = descend(task, state, _LAST_STEPS, 1e-6)
        if turn == 0:
            state = with_neighbours_merged(task, without_idle_lamps(task, state))
        # With a known material only the light moves, and with it what the dual model leaves out.
        shift = np.sqrt(np.mean((state.weights * (state.target - target)) ** 2))
        if np.max(np.abs(_material(state) - before)) < _SETTLED and shift < _SAME_TARGET:
            break
    state = state._replace(rounds=(*state.rounds, round_of(task, state)))
    watch(state.rounds[-1])
    return state


def corrected(task: Task, state: State) -> State:
    """Take off the photographs what the exact integral has and the dual model has not.

    The sources are exact already; of slow light the dual model knows the azimuthal mean.  What has
    been integrated is exact altogether.
    """
    assert state.joint is not None
    response, guess = response_of(task, state), state.guess
    if not isinstance(response, MirrorResponse):
        return state
    slow = jnp.asarray(state.joint.solved.light[: response.slow_count])
    lobe = response.lobe(guess)
    assert isinstance(lobe, Glossy)
    exact = reflect_slow_light(lobe, response.samples, slow)
    if task.sight is not None:
        exact = exact - hidden_slow_light(response.samples, task.sight, lobe, slow)
    dual = jnp.einsum("sl,slc->sc", response.passed(guess), response.mirrored(slow))
    defect = gloss_share(guess)[None, :] * (exact - dual)
    return state._replace(target=task.radiance - np.asarray(defect))


def hidden_slow_light(
    samples: SurfaceSamples,
    sight: Sight,
    lobe: Glossy,
    slow: Float[Array, "coefficient channel"],
) -> Float[Array, "sample channel"]:
    """Sum the slow light that the object keeps from itself: only this rests on a grid."""
    image = np.asarray(synthesise(_HIDDEN_GRID, slow)).reshape(-1, slow.shape[1])
    directions = _HIDDEN_GRID.directions().reshape(-1, 3)
    weights = _HIDDEN_GRID.weights().reshape(-1, 1)
    nodes = LightNodes(directions, weights * image)
    hidden = ~sight.of_fixed(directions)
    return integral_columns(lobe, samples, nodes, hidden)[:, 1]


def round_of(task: Task, state: State) -> Round:
    """Sum up where a round ended."""
    assert state.joint is not None
    left = state.target - np.asarray(state.joint.solved.predicted)
    guess = state.guess
    metal = task.response.variant.mu is None
    return Round(
        int(np.count_nonzero(state.active)),
        np.asarray(gloss_share(guess)),
        float(jnp.exp(guess.sigma)),
        float("nan") if metal else 1 + float(jnp.exp(guess.mu)),
        float(np.sqrt(np.sum(left**2) / np.sum(task.radiance**2))),
    )


def _worth(data: Measured) -> float:
    """What a lamp must take off chi-squared: log N for each of its unknowns (Schwarz)."""
    return _UNKNOWNS_PER_LAMP * float(np.log(np.asarray(data.radiance).size))


def _material(state: State) -> Float[np.ndarray, "unknown"]:
    guess = state.guess
    return np.concatenate([np.asarray(guess.gloss), [float(guess.sigma), float(guess.mu)]])
