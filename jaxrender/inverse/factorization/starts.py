"""Where the rounds begin: several widths of the lobe are tried, and what explains most is kept.

Slow light under a wide lobe and light with sources under a narrow one look alike.  A search that
begins too wide makes sources of what is slow light, and one that begins too narrow takes sources
for slow light; both stay there.  So the first round is made from several widths, and once from slow
light alone with the width free.  That with the least chi-squared is kept, where each source counts
as its unknowns do (Schwarz).
"""

import numpy as np

from jaxrender.inverse.factorization.correction import corrected
from jaxrender.inverse.factorization.sources import STEPS_PER_ROUND, add_sources, worth_of_source
from jaxrender.inverse.factorization.state import (
    START_SIGMA,
    State,
    Task,
    begin,
    descend,
    measured,
    round_of,
    weigh_evenly,
)
from jaxrender.inverse.observations import as_pixels

# Widths that are tried, beside the one stated.
_WIDTHS = (0.08, START_SIGMA)
# What the dual model lacks is found anew where a logarithm of the lobe moved by more than this.
_NEAR = 0.1
# Standard deviation over the median of magnitudes, of Gaussian noise.
_NORMAL_DEVIATION = 1.4826


def best_start(task: Task, count: int) -> State:
    """Make the first round, with up to ``count`` sources, from each width, and keep the best."""
    slow = [settled(task, begin(task, width), 1) for width in widths(task)]
    if len(slow) == 1:
        return _lit(task, slow[0], count)
    loose = [settled(task, state, 2) for state in slow]
    best = loose[int(np.argmin(_criteria(task, loose)))]
    # Slow light that lacks its sources sharpens a lobe without end: so they are added before, too.
    ends = [best, *(_lit(task, one, count) for one in (best, *slow))]
    return ends[int(np.argmin(_criteria(task, ends)))]


def widths(task: Task) -> list[float]:
    """List the widths to begin with: the one that is known, or those within the bounds."""
    if not task.sigma.free:
        return [task.sigma.first(START_SIGMA)]
    low, high = task.bounds.sigma
    inside = [width for width in _WIDTHS if low < width < high]
    return list(dict.fromkeys([task.sigma.first(START_SIGMA), *inside]))


def settled(task: Task, state: State, most: int = 4) -> State:
    """Fit everything with the sources there are, and note where the round ended.

    What the dual model lacks is found before each fit, and the fit is repeated where the lobe moved
    far: else what it lacks would be explained by sources that are not there.
    """
    for turn in range(most):
        at = corrected(task, state, _NEAR) if task.settings.refine else state
        if turn and at is state:
            break
        state = weigh_evenly(task, descend(task, at, STEPS_PER_ROUND))
    return state._replace(rounds=(*state.rounds, round_of(task, state)))


def _lit(task: Task, state: State, count: int) -> State:
    more = add_sources(task, state, count)
    return settled(task, more) if (more.active & ~state.active).any() else state


def _criteria(task: Task, states: list[State]) -> list[float]:
    """Compute chi-squared of each, in deviations of the best, and what its sources cost."""
    weights, even = begin(task).weights, as_pixels(task.observations)
    left = []
    for state in states:
        assert state.joint is not None
        left.append((weights * (task.radiance - np.asarray(state.joint.solved.predicted)))[even])
    deviation = _NORMAL_DEVIATION * min(float(np.median(np.abs(one))) for one in left)
    # Outliers are the same for all of them.  What is wrong with a width shows at few pixels, too.
    return [
        float(np.sum((one / deviation) ** 2))
        + worth_of_source(measured(task, state)) * float(np.count_nonzero(state.active))
        for state, one in zip(states, left)
    ]
