"""Which sources have a width, and whether it pays.

Sources are found as points.  Whether a width would explain more is asked of the derivatives at none
(``diagnosis.scores``).  A search with widths needs programs of its own, and is made where the
answer is yes.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.diagnosis.scores import Leftover
from jaxrender.inverse.factorization.blocks import in_blocks
from jaxrender.inverse.factorization.crowds import crowded
from jaxrender.inverse.factorization.projection import lobes_of, mixed
from jaxrender.inverse.factorization.response import specular_share
from jaxrender.inverse.factorization.slopes import columns_at
from jaxrender.inverse.factorization.source_nodes import (
    POINTS,
    SHARES,
    filled_up,
    nodes_of,
    range_of,
    widths_of,
)
from jaxrender.inverse.factorization.state import State, Task, measured, response_of
from jaxrender.inverse.factorization.suspicion import derivatives_of
from jaxrender.shapes import Float

# The variance at which derivatives are taken, in parts of the lobe's.
_LITTLE = 0.01


def with_widths(state: State) -> State:
    """Keep the sources in use, and let each have a width: hardly any, to begin with."""
    kept = np.argsort(~state.active, kind="stable")[: filled_up(np.count_nonzero(state.active))]
    least, _ = range_of(state.guess.sigma)
    guess = state.guess._replace(
        directions=jnp.asarray(np.asarray(state.guess.directions)[kept]),
        variance=jnp.full(len(kept), least),
    )
    return state._replace(guess=guess, active=state.active[kept])


def may_be_wide(task: Task, state: State) -> bool:
    """Say whether sources may have a width: some are a crowd, or one would explain more with it.

    What is asked of a single source is what the photographs leave, tested as causes are.
    """
    if not state.active.any():
        return False
    if crowded(state).any():
        return True
    known = derivatives_of(task, state, "per-channel", np.arange(task.observations.count))
    leftover = Leftover(known.left, known.jacobian)
    columns = known.weighted(_by_variance(task, state)).T
    # None is narrower than a point.
    wider = [column for column in columns if column @ leftover.left > 0]
    return any(leftover.score(column[:, None]).gain > 0 for column in wider)


def pays(task: Task, before: State, after: State) -> bool:
    """Say whether widths explain more than as many numbers would of noise (Schwarz)."""
    data = measured(task, after)
    assert before.joint is not None
    assert after.joint is not None
    gained = [
        float(np.sum((data.weights * (task.radiance - np.asarray(joint.solved.predicted))) ** 2))
        for joint in (before.joint, after.joint)
    ]
    guess = after.guess
    wide = widths_of(guess.variance, guess.sigma, len(after.active)) > 0
    each = np.log(np.asarray(data.radiance).size)
    return bool(gained[0] - gained[1] > each * np.count_nonzero(wide & after.active))


def _by_variance(task: Task, state: State) -> Float[np.ndarray, "sample channel source"]:
    """Differentiate the prediction by the variance of each source in use, at none.

    The points of wide sources stand in for sources, as many at once as the programs have.
    """
    assert state.joint is not None
    guess, blocks = state.guess, in_blocks(response_of(task, state), measured(task, state))
    found, sources = np.flatnonzero(state.active), len(state.active)
    variance = _LITTLE * float(jnp.exp(2 * guess.sigma))
    nodes = np.asarray(nodes_of(np.asarray(guess.directions)[found], np.full(len(found), variance)))
    more = -len(nodes) % sources
    owner = np.pad(np.repeat(found, POINTS), (0, more), mode="edge").reshape(-1, sources)
    nodes = np.pad(nodes, ((0, more), (0, 0)), mode="edge").reshape(-1, sources, 3)
    slow, share, parts = task.response.slow_count, specular_share(guess), []
    for block, lobe in zip(blocks.blocks, lobes_of(blocks, guess), strict=True):
        each = []
        for towards, own in zip(nodes, owner, strict=True):
            lit = jnp.asarray(np.asarray(block.response.lit)[:, own])
            response = eqx.tree_at(lambda r: r.lit, block.response, lit)
            columns = columns_at(response, guess._replace(directions=towards), lobe.passed)
            each.append(np.asarray(mixed(columns, share))[:, :, slow:])
        every = np.concatenate(each, axis=2)[:, :, : POINTS * len(found)]
        by_point = every.reshape(*every.shape[:2], -1, POINTS)
        parts.append(np.moveaxis((by_point @ SHARES - by_point[..., 0]) / variance, 0, 1))
    energies = np.asarray(state.joint.solved.light)[slow + found]
    return blocks.joined(parts) * energies.T
