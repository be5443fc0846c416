"""Light and material at once: Gauss-Newton steps of everything that is not linear.

The light is the linear part and is solved for at every guess (``projection``).  So a step of the
other unknowns in the reduced system is the joint least-squares step of all.  Steps are damped as
Levenberg and Marquardt do.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.factorization.blocks import Measured, in_blocks
from jaxrender.inverse.factorization.projection import (
    Solved,
    reduced_system,
)
from jaxrender.inverse.factorization.response import Guess, Response
from jaxrender.inverse.factorization.slopes import tangent_frames
from jaxrender.inverse.factorization.source_nodes import range_of
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Bool, Float

# Damping relative to the diagonal of H: at the start, and the factors after a good and a bad step.
DAMPING, _RELIEF, _TIGHTENING = 1e-3, 0.2, 8.0
# Bad steps that end a descent.  A lobe without masking does not fade at the horizon, so that the
# cost has a jump wherever a source rises for a sample that is seen at a grazing angle.
_MOST_IN_VAIN = 10
# A step that promises less than this part of the gain that ends the descent is not tried.
_NOTHING = 0.1
# Where ks / kd is beyond e^8 or below e^-8, one of both is as good as 0.
_MOST_LOGIT = 8.0
# A variance within this factor of its bound is at it.
_JUST = 1 + 1e-6
# No step changes a logarithm by more than this, nor a direction by more (radians).
_LONGEST = 0.4


class Bounds(NamedTuple):
    """The bounds of sigma and mu in the search."""

    sigma: tuple[float, float]
    mu: tuple[float, float]


class Descent(NamedTuple):
    """The bounds of a descent, its most steps, and the relative gain of cost that ends it.

    Only good steps count: one that gains nothing is tried again with more damping.  A descent that
    goes on from another begins with that one's damping: numbers that the photographs hardly tell
    apart move by halves under more.
    """

    bounds: Bounds
    steps: int
    tolerance: float
    damping: float = DAMPING


class Joint(NamedTuple):
    """Where a joint fit stopped, and how damped its next step would be.

    ``curvature`` is that of the cost by all unknowns but the light, which answers to them.
    """

    guess: Guess
    solved: Solved
    curvature: Float[AnyArray, "unknown unknown"]
    steps: int
    converged: bool
    damping: float = DAMPING


def descend_jointly(
    response: Response,
    guess: Guess,
    measured: Measured,
    free: Bool[np.ndarray, "unknown"],
    descent: Descent,
    lit_at: Callable[[Guess], Float[AnyArray, "sample source"]] | None = None,
) -> Joint:
    """Minimise the penalised cost over the free nonlinear unknowns; the light is solved for.

    ``lit_at`` says which samples the sources of a guess reach; None: that stays as it is.  It has
    jumps, so that no derivative knows of it.  But every trial step is judged by it.
    """
    damping, step, in_vain, converged = descent.damping, 0, 0, False
    blocks = in_blocks(response, measured)
    system = reduced_system(blocks, guess)
    while step < descent.steps and in_vain < _MOST_IN_VAIN and not converged:
        held = movable(guess, system.slope, free)
        move, expected = _damped(system.curvature, system.slope, held, damping)
        if float(expected) < _NOTHING * descent.tolerance * float(system.solved.cost):
            converged = True
            break
        trial = _moved(guess, move, descent.bounds)
        # Most steps are good: what the next one needs is asked for at once.
        there = reduced_system(blocks if lit_at is None else blocks.lit(lit_at(trial)), trial)
        gain = float(system.solved.cost) - float(there.solved.cost)
        if not gain > 0:
            damping, in_vain = damping * _TIGHTENING, in_vain + 1
            continue
        step += 1
        converged = gain < descent.tolerance * float(there.solved.cost)
        guess, system, damping = trial, there, max(damping * _RELIEF, 1e-9)
    converged = converged or in_vain == _MOST_IN_VAIN
    return Joint(guess, system.solved, system.curvature, step, converged, damping)


def unknown_count(guess: Guess) -> int:
    """Count the nonlinear unknowns: ks / kd of each channel, sigma, mu, a few for each source."""
    own = 2 if guess.variance is None else 3
    return guess.specular_logit.shape[0] + 2 + own * guess.directions.shape[0]


def movable(
    guess: Guess, slope: Float[AnyArray, "unknown"], free: Bool[np.ndarray, "unknown"]
) -> Bool[np.ndarray, "unknown"]:
    """Leave out variances at their bounds that the slope would move beyond."""
    if guess.variance is None:
        return free
    least, most = (float(bound) for bound in range_of(guess.sigma))
    variance, found = np.asarray(guess.variance), np.array(free)
    falls = np.asarray(slope)[-len(variance) :]
    stuck = ((variance <= _JUST * least) & (falls <= 0)) | (
        (variance * _JUST >= most) & (falls >= 0)
    )
    found[-len(variance) :] &= ~stuck
    return found


@stored(jax.jit, effort="least")
def _damped(
    curvature: Float[AnyArray, "unknown unknown"],
    slope: Float[AnyArray, "unknown"],
    free: Bool[AnyArray, "unknown"],
    damping: float | Float[Array, ""],
) -> tuple[Float[Array, "unknown"], Float[Array, ""]]:
    """Find a damped step, and by how much it would lower a cost that is a parabola."""
    curvature, slope = jnp.asarray(curvature), jnp.asarray(slope)
    size = jnp.diag(curvature)
    usable = jnp.asarray(free) & (size > 0)
    scale = jnp.where(usable, jax.lax.rsqrt(jnp.where(usable, size, 1)), 0)
    matrix = curvature * scale[:, None] * scale[None, :]
    matrix = matrix + jnp.diag(jnp.where(usable, damping, 1.0))
    factor = jax.scipy.linalg.cho_factor(matrix, lower=True)
    step = scale * jax.scipy.linalg.cho_solve(factor, scale * slope)
    # A matrix that rounding has made indefinite gives no step; the damping then grows.
    sound = jnp.all(jnp.isfinite(step))
    step = jnp.where(sound, step, 0)
    expected = jnp.where(sound, step @ (slope - curvature @ step / 2), jnp.inf)
    return jnp.clip(step, -_LONGEST, _LONGEST), expected


@stored(partial(jax.jit, static_argnames="bounds"), effort="least")
def _moved(guess: Guess, step: Float[Array, "unknown"], bounds: Bounds) -> Guess:
    channels, sources = guess.specular_logit.shape[0], guess.directions.shape[0]
    cuts = np.cumsum([channels, 2, sources, sources])
    logit, lobe, first, second, wider = jnp.split(step, cuts)
    directions = jnp.asarray(guess.directions)
    frames = tangent_frames(directions)
    moved = directions + first[:, None] * frames[..., 0] + second[:, None] * frames[..., 1]
    moved = moved / jnp.linalg.norm(moved, axis=1, keepdims=True)
    sigma = jnp.clip(guess.sigma + lobe[0], *np.log(bounds.sigma))
    mu = jnp.clip(guess.mu + lobe[1], *np.log(np.subtract(bounds.mu, 1)))
    # A share of 0 or 1 is known beforehand, and stays.
    within = jnp.clip(guess.specular_logit + logit, -_MOST_LOGIT, _MOST_LOGIT)
    logit = jnp.where(jnp.isinf(guess.specular_logit), guess.specular_logit, within)
    variance = guess.variance
    if variance is not None:
        variance = jnp.clip(variance + wider, *range_of(sigma))
    return Guess(logit, sigma, mu, moved, variance)
