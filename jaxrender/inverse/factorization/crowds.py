"""Crowds of sources: a window, of which no source is a lamp.

A window that is wider than the lobe is found as a crowd of points, one lobe's width apart.  Points
are sharper than any window, so that the lobe comes out too wide, by many standard errors.  So the
sources of a crowd get a width (``widths``), where that pays.

A few sources, wide or not, are not the window.  What a crowd has between its sources the
photographs tell in part.  This *grain* is sources of unknown energy between those found, each
expected to have no more than one of them.  The errors of light and material know of it, and reach
as far as it would move them.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy.linalg
from scipy.sparse.csgraph import connected_components

from jaxrender.inverse.factorization.joint import unknown_count
from jaxrender.inverse.factorization.projection import System
from jaxrender.inverse.factorization.source_nodes import filled_up, nodes_of, range_of
from jaxrender.inverse.factorization.state import State, Task, measured
from jaxrender.shapes import Bool, Float, Int

# Sources of which each has a neighbour within so many widths of the lobe; so many are a crowd.
_NEIGHBOURS, _FEWEST = 2.0, 3
# In widths of the lobe: how far grain lies about each source, and how far apart it is.
_GRAIN, _APART = 1.2, 0.8


class Grain(NamedTuple):
    """A state with grain after its sources, and what is expected of all its light (1 / variance).

    ``count`` is the number of sources without the grain.
    """

    state: State
    penalty: Float[np.ndarray, "part channel"]
    count: int

    def free(self, own: Bool[np.ndarray, "unknown"]) -> Bool[np.ndarray, "every"]:
        """Mark the unknowns that are free: grain stays where it is."""
        found = np.zeros(unknown_count(self.state.guess), bool)
        found[self._unknowns] = own
        return found

    def kept(self, parts: int, channels: int) -> Int[np.ndarray, "kept"]:
        """Number the unknowns, and the parts of each channel's light, that are no grain."""
        every = np.arange(parts - len(self.state.active) + self.count)
        first = unknown_count(self.state.guess)
        light = [first + channel * parts + every for channel in range(channels)]
        return np.concatenate([self._unknowns, *light])

    def moved(
        self,
        system: System,
        inverse: Float[np.ndarray, "unknown unknown"],
        light: Float[np.ndarray, "part channel"],
    ) -> Float[np.ndarray, "number"]:
        """Say how far the likeliest grain moves the nonlinear unknowns, and the light found."""
        step = inverse @ np.asarray(system.slope)
        more = np.pad(light, ((0, len(self.state.active) - self.count), (0, 0)))
        parts = zip(np.asarray(system.solved.normal), np.asarray(system.across))
        answers = [scipy.linalg.cho_solve((factor, True), one @ step) for factor, one in parts]
        changed = (np.asarray(system.solved.light) - more).T - np.stack(answers)
        return np.concatenate([step, changed.ravel()])

    @property
    def _unknowns(self) -> Int[np.ndarray, "kept"]:
        """Number the nonlinear unknowns that are not of the grain."""
        every, sources = unknown_count(self.state.guess), len(self.state.active)
        own = 2 if self.state.guess.variance is None else 3
        first = every - own * sources
        each = [first + k * sources + np.arange(self.count) for k in range(own)]
        return np.concatenate([np.arange(first), *each])


def crowded(state: State) -> Bool[np.ndarray, "source"]:
    """Mark the sources in use that are in a crowd."""
    directions = np.asarray(state.guess.directions)
    reach = np.cos(min(_NEIGHBOURS * float(jnp.exp(state.guess.sigma)), np.pi))
    near = directions @ directions.T > reach
    near &= state.active[:, None] & state.active[None, :]
    _, group = connected_components(near, directed=False)
    return state.active & (np.bincount(group)[group] >= _FEWEST)


def with_grain(task: Task, state: State) -> Grain:
    """Put grain between the sources of crowds; other light has none."""
    guess, penalty = state.guess, np.asarray(measured(task, state).penalty)
    count, within = len(state.active), crowded(state)
    if state.joint is None or not within.any():
        return Grain(state, penalty, count)
    sigma = float(jnp.exp(guess.sigma))
    directions = np.asarray(guess.directions)
    taken = list(directions[state.active])
    first = len(taken)
    about = nodes_of(directions[within], np.full(within.sum(), (_GRAIN * sigma / 2) ** 2))
    for one in np.asarray(about):
        if np.max(np.stack(taken) @ one) < np.cos(_APART * sigma):
            taken.append(one)
    grain = np.stack(taken[first:]) if len(taken) > first else np.zeros((0, 3))
    energies = np.asarray(state.joint.solved.light)[-count:][within]
    expected = np.maximum(np.mean(energies, axis=0), np.finfo(float).tiny)
    unused = filled_up(len(grain)) - len(grain)
    active = np.concatenate([state.active, np.arange(len(grain) + unused) < len(grain)])
    grain = np.concatenate([grain, np.tile([0.0, 0.0, 1.0], (unused, 1))])
    more = guess._replace(directions=jnp.asarray(np.concatenate([directions, grain])))
    if guess.variance is not None:
        least, _ = range_of(guess.sigma)
        points = jnp.full(len(grain), least)
        more = more._replace(variance=jnp.concatenate([jnp.asarray(guess.variance), points]))
    penalty = np.concatenate([penalty, np.tile(1 / expected**2, (len(grain), 1))])
    return Grain(state._replace(guess=more, active=active), penalty, count)
