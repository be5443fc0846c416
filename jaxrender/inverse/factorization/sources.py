"""Which sources a light needs: they are added by pursuit while they pay, else dropped or merged."""

import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import fibonacci_sphere
from jaxrender.inverse.factorization.blocks import Measured
from jaxrender.inverse.factorization.pursuit import pursue
from jaxrender.inverse.factorization.source_clusters import NEIGHBOURS_PER_SIGMA
from jaxrender.inverse.factorization.state import State, Task, descend, measured, response_of
from jaxrender.shapes import Bool, Float

# Steps of a fit with other sources than before.
STEPS_PER_ROUND = 6
# A direction, and an energy in each channel.
_UNKNOWNS_PER_SOURCE = 5
# Directions tried, and samples that they are tried on.
_CANDIDATES, _PURSUIT_SAMPLES = 2048, 2000
_FEW = 8


def add_sources(task: Task, state: State, count: int) -> State:
    """Add up to ``count`` sources by pursuit, as long as each pays; else return the same state."""
    count = min(count, int(np.count_nonzero(~state.active)))
    if count == 0:
        return state
    towards = fibonacci_sphere(_CANDIDATES)
    step = max(1, len(task.radiance) // _PURSUIT_SAMPLES)
    radiance, weights, penalty = measured(task, state)
    few = Measured(radiance[::step], weights[::step], np.asarray(penalty) / step)
    seen = None if task.sight is None else task.sight.of_fixed(towards)[::step]
    # One program finds any few of them.
    most = max(count, _FEW)
    found = pursue(response_of(task, state).thinned(step), state.guess, few, towards, most, seen)
    pays = step * np.asarray(found.gains) > worth_of_source(measured(task, state))
    chosen = np.asarray(found.chosen)[np.logical_and.accumulate(pays)][:count]
    slots = np.flatnonzero(~state.active)[: len(chosen)]
    directions, active = np.array(state.guess.directions), state.active.copy()
    directions[slots], active[slots] = towards[chosen], True
    return state._replace(
        guess=state.guess._replace(directions=jnp.asarray(directions)), active=active
    )


def without_idle_sources(task: Task, state: State) -> State:
    """Switch off sources whose energy may be noise alone, and fit the light again."""
    assert state.joint is not None
    solved, slow = state.joint.solved, task.response.slow_count
    inverse = np.linalg.inv(np.asarray(solved.normal)[:, slow:, slow:])
    covariance = np.einsum("crp,crq->cpq", inverse, inverse)
    energies = np.asarray(solved.light)[slow:].T
    idle = _idle_sources(energies, covariance, state.active, worth_of_source(measured(task, state)))
    if not idle.any():
        return state
    return descend(task, state._replace(active=state.active & ~idle), STEPS_PER_ROUND)


def _idle_sources(
    energies: Float[np.ndarray, "channel source"],
    covariance: Float[np.ndarray, "channel source source"],
    active: Bool[np.ndarray, "source"],
    worth: float,
) -> Bool[np.ndarray, "source"]:
    """Mark sources not worth their unknowns, one after the other, the least first.

    Each source in a crowd is idle by itself, as the others can replace it, but all together are
    not.  Once a source is dark, energies and covariance of the rest are those without it.
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
    """Make one source of those within a lobe's reach of each other, where chi-squared allows it.

    The pursuit finds a source between two candidates twice.
    """
    assert state.joint is not None
    directions = np.asarray(state.guess.directions)
    energies = np.asarray(state.joint.solved.light)[task.response.slow_count :].sum(axis=1)
    reach = np.cos(NEIGHBOURS_PER_SIGMA * float(jnp.exp(state.guess.sigma)))
    merged, active = np.array(directions), state.active.copy()
    for source in np.argsort(-energies):
        if not active[source]:
            continue
        near = active & (directions @ directions[source] > reach)
        mean = energies[near] @ directions[near]
        merged[source] = mean / np.linalg.norm(mean)
        active[near] = False
        active[source] = True
    fewer = int(np.count_nonzero(state.active) - np.count_nonzero(active))
    if not fewer:
        return state
    guess = state.guess._replace(directions=jnp.asarray(merged))
    trial = descend(task, state._replace(guess=guess, active=active), STEPS_PER_ROUND)
    assert trial.joint is not None
    lost = 2 * float(trial.joint.solved.cost - state.joint.solved.cost)
    return trial if lost < fewer * worth_of_source(measured(task, state)) else state


def worth_of_source(data: Measured) -> float:
    """Compute by how much a source must lower chi-squared: log N for each unknown (Schwarz)."""
    return _UNKNOWNS_PER_SOURCE * float(np.log(np.asarray(data.radiance).size))
