"""Light and material from photographs alone: slow light and sources that are found one by one.

1. *Rounds*: matching pursuit adds sources while they pay, a few at first and more each time.  After
   each addition everything is fitted together.  Gauss-Newton steps move specular share, sigma, mu
   and the directions of all sources; slow light and energies are solved for inside each step.
2. *Refinement*: where the fit ended, the exact integral gives what the dual model lacks of the
   samples' response to slow light.  It is added, and the fit is repeated until nothing moves.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

import numpy as np

from jaxrender.inverse.blas import one_blas_thread
from jaxrender.inverse.factorization.blocks import in_blocks
from jaxrender.inverse.factorization.correction import change, corrected
from jaxrender.inverse.factorization.joint import DAMPING, Joint
from jaxrender.inverse.factorization.projection import reduced_system
from jaxrender.inverse.factorization.sources import (
    STEPS_PER_ROUND,
    add_sources,
    with_neighbours_merged,
    without_idle_sources,
)
from jaxrender.inverse.factorization.starts import best_start, settled
from jaxrender.inverse.factorization.state import (
    Round,
    State,
    Task,
    begin,
    descend,
    free_unknowns,
    measured,
    response_of,
    round_of,
    weigh_by_noise,
)
from jaxrender.shapes import Float, Int

# The search for sources, and the fits along with it, use about this many samples; the last steps
# use all.
_ROUND_SAMPLES = 2000
# Sources added in each round, until there are as many as allowed or they no longer pay.  A few come
# first: what a fit leaves that lacks them looks like more sources than there are.
_ROUNDS = (2, 6, 8, 16, 16, 16, 16, 16, 16)
# A round that found fewer is the last one.
_TOO_FEW = 3
# The second turn of the last steps adds sources.  In later turns each step is judged by which
# samples the sources reach after it: else those at the edges of shadows push them to and fro.
_LAST_STEPS, _LAST_SOURCES, _ADDED_IN = 4, 8, 1
# The last steps end when the material moves by less than the second number, in its standard errors,
# and the correction by less than the third, in standard deviations of the noise.
_REFINEMENTS, _STILL, _SAME = 8, 0.1, 0.005
# A correction made no farther away than this, in logarithms, is as good as one made anew.
_NEAR = 0.01
# Where they end earlier, this much is too little for any error bar to show.
_NEARLY_STILL, _NEARLY_SAME = 0.3, 0.02


def find_both(
    task: Task,
    watch: Callable[[Round], None],
    stage: Callable[[str], AbstractContextManager] = lambda name: nullcontext(),
) -> State:
    """Find light and material: by rounds on some samples, and by the last steps on all."""
    few = some_samples(task)
    with stage("light"), one_blas_thread():
        state = light_the_scene(task.take(few), watch)
        if len(few) < task.observations.count:
            state = taken_up(task, state)
    with stage("refine"), one_blas_thread():
        return settle(task, state, watch)


def some_samples(task: Task, least: int = _ROUND_SAMPLES) -> Int[np.ndarray, "kept"]:
    """Choose about so many samples, evenly."""
    return np.arange(0, task.observations.count, max(1, task.observations.count // least))


def light_the_scene(task: Task, watch: Callable[[Round], None]) -> State:
    """Begin where it pays most, and add sources in rounds while they pay."""
    state, enough = best_start(task, _ROUNDS[0]), _ROUNDS[0]
    for done in state.rounds:
        watch(done)
    added = int(np.count_nonzero(state.active))
    for count in _ROUNDS[1:]:
        if added < enough:
            break
        more, enough = add_sources(task, state, count), _TOO_FEW
        added = int(np.count_nonzero(more.active & ~state.active))
        if added:
            state = settled(task, more)
            watch(state.rounds[-1])
    return state


def taken_up(task: Task, state: State) -> State:
    """Go on with other samples of the same photographs, from the guess and the light found."""
    fresh = begin(task, misfit=state.rounds[-1].relative_rms)._replace(
        guess=state.guess,
        active=state.active,
        level=state.level,
        joint=state.joint,
        rounds=state.rounds,
    )
    return relit(task, fresh)


def relit(task: Task, state: State) -> State:
    """Solve for the light of a guess by the response of another task."""
    state = state._replace(lacking=None)
    if task.settings.refine:
        state = corrected(task, state)
    return at_standstill(task, state)


def at_standstill(task: Task, state: State) -> State:
    """Solve for the light alone, of a guess and a response as they are."""
    blocks = in_blocks(response_of(task, state), measured(task, state))
    system = reduced_system(blocks, state.guess)
    return state._replace(joint=Joint(state.guess, system.solved, system.curvature, 0, False))


def settle(task: Task, state: State, watch: Callable[[Round], None]) -> State:
    """Take the last steps, weighed by the noise and corrected by the exact integral."""
    for turn in range(_REFINEMENTS):
        before = state
        state = weigh_by_noise(task, state)
        if task.settings.refine:
            state = corrected(task, state, _NEAR)
        damping = DAMPING if before.joint is None else before.joint.damping
        state = descend(task, state, _LAST_STEPS, 1e-6, damping, retraced=turn > _ADDED_IN)
        if turn == _ADDED_IN:
            state = with_neighbours_merged(task, without_idle_sources(task, state))
            # More samples show more than the rounds did.
            more = add_sources(task, state, _LAST_SOURCES)
            if (more.active & ~state.active).any():
                state = without_idle_sources(task, descend(task, more, STEPS_PER_ROUND))
        # With a known material nothing moves but the light, which is solved for.
        shift = change(before, state)
        moved = _material_moved(task, before, state)
        state = state._replace(settled=moved < _NEARLY_STILL and shift < _NEARLY_SAME)
        if turn and moved < _STILL and shift < _SAME:
            break
    state = state._replace(rounds=(*state.rounds, round_of(task, state)))
    watch(state.rounds[-1])
    return state


def _material_moved(task: Task, before: State, after: State) -> float:
    """Say how far the material moved, in standard errors of all its numbers together."""
    assert after.joint is not None
    free = free_unknowns(task, after)
    curvature = np.asarray(after.joint.curvature, float)[np.ix_(free, free)]
    step = _material_of(after) - _material_of(before)
    own = free[: len(step)]
    covariance = np.linalg.pinv(curvature, hermitian=True)[: own.sum(), : own.sum()]
    return float(np.sqrt(step[own] @ np.linalg.pinv(covariance, hermitian=True) @ step[own]))


def _material_of(state: State) -> Float[np.ndarray, "unknown"]:
    """List the search variables of the material, as numbers that can be subtracted."""
    guess = state.guess
    # A share of 0 or 1 has an infinite logarithm.
    logit = np.nan_to_num(np.asarray(guess.specular_logit))
    return np.concatenate([logit, [float(guess.sigma), float(guess.mu)]])
