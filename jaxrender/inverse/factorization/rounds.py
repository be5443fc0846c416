"""Light and material from photographs alone: slow light and sources that are found one by one.

1. *Rounds*: matching pursuit adds sources while they pay, a few at first and more each time.  After
   each addition everything is fitted together.  Gauss-Newton steps move specular share, sigma, mu
   and the directions of all sources; slow light and energies are solved for inside each step.
2. *Refinement*: where the fit ended, the exact integral gives the error of the dual model.  The
   error is subtracted from the photographs and the fit is repeated, until nothing moves.
"""

from collections.abc import Callable

import numpy as np

from jaxrender.inverse.factorization.correction import corrected
from jaxrender.inverse.factorization.joint import Joint
from jaxrender.inverse.factorization.projection import reduced_system
from jaxrender.inverse.factorization.sources import (
    STEPS_PER_ROUND,
    add_sources,
    with_neighbours_merged,
    without_idle_sources,
)
from jaxrender.inverse.factorization.state import (
    Round,
    State,
    Task,
    begin,
    descend,
    material_of,
    measured,
    response_of,
    round_of,
    weigh_by_noise,
    weigh_evenly,
)

# Sources added in each round, until there are as many as allowed or they no longer pay.
_ROUNDS = (8, 8, 16, 16, 16, 16, 16, 16)
# A round that found fewer is the last one.
_TOO_FEW = 3
_LAST_STEPS = 4
# Below this residual the corrections by the exact integral count beside what sources explain.
_NEARLY_THERE = 0.05
# The last steps end when no logarithm moves by more than the second number, nor the corrected
# photographs by more than the third, in standard deviations.
_REFINEMENTS, _SETTLED, _SAME_TARGET = 8, 2e-3, 0.02
# Where they end earlier, this much of the noise is too little for any error bar to show.
_NEARLY_SAME_TARGET = 0.2


def light_the_scene(task: Task, state: State, watch: Callable[[Round], None]) -> State:
    """Add sources in rounds while they pay."""
    for count in (0, *_ROUNDS):
        more = add_sources(task, state, count) if count else state
        added = int(np.count_nonzero(more.active & ~state.active))
        if count and not added:
            break
        state = descend(task, more, STEPS_PER_ROUND)
        state = weigh_evenly(task, state)
        if task.settings.refine and round_of(task, state).relative_rms < _NEARLY_THERE:
            state = corrected(task, state)
        state = state._replace(rounds=(*state.rounds, round_of(task, state)))
        watch(state.rounds[-1])
        if count and added < _TOO_FEW:
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
    system = reduced_system(response_of(task, fresh), fresh.guess, measured(task, fresh))
    return fresh._replace(joint=Joint(fresh.guess, system.solved, 0, False))


def settle(task: Task, state: State, watch: Callable[[Round], None]) -> State:
    """Take the last steps, weighed by the noise and corrected by the exact integral."""
    for turn in range(_REFINEMENTS):
        before, target = material_of(state), state.target
        state = weigh_by_noise(task, state)
        if task.settings.refine:
            state = corrected(task, state)
        state = descend(task, state, _LAST_STEPS, 1e-6)
        if turn == 0:
            state = with_neighbours_merged(task, without_idle_sources(task, state))
        # With a known material only the light moves, and with it what the dual model leaves out.
        shift = np.sqrt(np.mean((state.weights * (state.target - target)) ** 2))
        moved = float(np.max(np.abs(material_of(state) - before)))
        state = state._replace(settled=moved < _SETTLED and float(shift) < _NEARLY_SAME_TARGET)
        if state.settled and shift < _SAME_TARGET:
            break
    state = state._replace(rounds=(*state.rounds, round_of(task, state)))
    watch(state.rounds[-1])
    return state
