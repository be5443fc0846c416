"""Light and material at once: variable projection with the light as the linear part.

For a guess of the nonlinear unknowns the light follows from one small linear system a channel.  A
Gauss-Newton step then moves the guess along what the light cannot make up for: with M_c the columns
of channel c and V_c the derivatives of its prediction at fixed light,

H = sum_c V_c' W V_c - (M_c' W V_c)' (M_c' W M_c + Lambda)^-1 (M_c' W V_c),   g = sum_c V_c' W r_c

which is the joint least-squares step of all unknowns with the light eliminated, damped as Levenberg
and Marquardt do.  Lambda is the penalty on the light.  Only dozens of columns meet thousands of
samples, so a step costs a few matrix products whatever the number of parameters.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import world_from_local
from jaxrender.inverse.factorization.response import Columns, Guess, Response, gloss_share
from jaxrender.inverse.unknowns import SIGMA_BOUNDS, index_bounds
from jaxrender.shapes import AnyArray, Array, Bool, Float

# Damping relative to the diagonal of H: at the start, and the factors after a good and a bad step.
_DAMPING, _RELIEF, _TIGHTENING, _GIVE_UP = 1e-3, 0.2, 8.0, 1e6
# Odds of gloss beyond e^8 are all or nothing.
_MOST_GLOSS = 8.0
# No step changes a logarithm by more than this, nor a direction by more (radians).
_LONGEST = 0.4


class Measured(NamedTuple):
    """Radiance, weights (1 / standard deviation), and the light's penalty (1 / variance)."""

    radiance: Float[AnyArray, "sample channel"]
    weights: Float[AnyArray, "sample channel"]
    penalty: Float[AnyArray, "part channel"]


class Solved(NamedTuple):
    """The light that fits a guess best, what it predicts, and the penalised cost."""

    light: Float[Array, "part channel"]
    predicted: Float[Array, "sample channel"]
    cost: Float[Array, ""]
    normal: Float[Array, "channel part part"]


class System(NamedTuple):
    """The reduced normal equations of the nonlinear unknowns, and M' W V: how the light answers."""

    curvature: Float[Array, "unknown unknown"]
    slope: Float[Array, "unknown"]
    across: Float[Array, "channel part unknown"]


class Joint(NamedTuple):
    """Where a joint fit stopped."""

    guess: Guess
    solved: Solved
    steps: int
    converged: bool


@jax.jit
def solve_light(response: Response, guess: Guess, measured: Measured) -> Solved:
    """Solve for the light of every channel."""
    with jax.default_matmul_precision("highest"):
        return solve_columns(mixed(evaluated(response, guess), guess), measured)


@jax.jit
def reduced_system(response: Response, guess: Guess, measured: Measured) -> tuple[Solved, System]:
    """Solve for the light and set up the step of everything else."""
    with jax.default_matmul_precision("highest"):
        each = evaluated(response, guess)
        columns = mixed(each, guess)
        solved = solve_columns(columns, measured)
        tangents = _tangents(response, guess, each, solved.light)
        left = measured.radiance - solved.predicted
        curvature, slope, across = [], [], []
        # One channel after the other: a batch of matrix products is slower than each by itself.
        for k in range(left.shape[1]):
            weights = jnp.asarray(measured.weights)[None, :, k]
            moved = weights * jnp.concatenate([tangents[k].T, left[None, :, k]])
            inner = moved @ moved.T
            across.append((weights * columns[k].T) @ moved[:-1].T)
            projected = jax.scipy.linalg.solve_triangular(solved.normal[k], across[-1], lower=True)
            curvature.append(inner[:-1, :-1] - projected.T @ projected)
            slope.append(inner[:-1, -1])
        total, down = (jnp.sum(jnp.stack(parts), axis=0) for parts in (curvature, slope))
        return solved, System(total, down, jnp.stack(across))


def descend_jointly(
    response: Response,
    guess: Guess,
    measured: Measured,
    free: Bool[np.ndarray, "unknown"],
    settings: tuple[int, float] = (30, 1e-5),
) -> Joint:
    """Minimise the penalised cost over the free nonlinear unknowns, the light following along.

    ``settings`` are the most steps and the relative gain of cost below which it ends.
    """
    steps, tolerance = settings
    damping, step, converged = _DAMPING, 0, False
    solved, system = reduced_system(response, guess, measured)
    while step < steps and damping < _GIVE_UP and not converged:
        step += 1
        trial = _moved(guess, _damped(system, free, damping), index_bounds(response.variant))
        # Most steps are good: what the next one needs is asked for at once.
        there, onward = reduced_system(response, trial, measured)
        gain = float(solved.cost - there.cost)
        if not gain > 0:
            damping *= _TIGHTENING
            continue
        converged = gain < tolerance * float(there.cost)
        guess, damping = trial, max(damping * _RELIEF, 1e-9)
        solved, system = there, onward
    return Joint(guess, solved, step, converged or damping >= _GIVE_UP)


def unknown_count(guess: Guess) -> int:
    """The number of nonlinear unknowns: gloss of each channel, sigma, mu, two a source."""
    return guess.gloss.shape[0] + 2 + 2 * guess.directions.shape[0]


def evaluated(response: Response, guess: Guess) -> Columns:
    """Evaluate both lobes' responses once: the compiler is kept from doing so in every product."""
    return jax.lax.optimization_barrier(response.columns(guess))


def mixed(columns: Columns, guess: Guess) -> Float[Array, "channel sample part"]:
    """Weigh the lobes: what one unit of each part of the light sends to the camera."""
    share = gloss_share(guess)[:, None, None]
    return jax.lax.optimization_barrier(
        (1 - share) * columns.diffuse[None] + share * columns.specular[None]
    )


def solve_columns(columns: Float[Array, "channel sample part"], measured: Measured) -> Solved:
    """Solve every channel's normal equations by Cholesky factorization."""
    radiance, weights = jnp.asarray(measured.radiance), jnp.asarray(measured.weights)
    penalty = jnp.asarray(measured.penalty)
    light, predicted, cost, factors = [], [], [], []
    for k in range(radiance.shape[1]):
        # The measurements as one more column: every sum over the samples is in one product, and
        # with the samples along rows it runs through memory in order.
        both = weights[None, :, k] * jnp.concatenate([columns[k].T, radiance[None, :, k]])
        sums = both @ both.T
        normal, right = sums[:-1, :-1] + jnp.diag(penalty[:, k]), sums[:-1, -1]
        # A source that is switched off has no column: unit diagonal, so that its energy is zero.
        size = jnp.diag(normal)
        normal = normal + jnp.diag(jnp.where(size > 0, 1e-12 * size, 1))
        factors.append(jnp.linalg.cholesky(normal))
        light.append(jax.scipy.linalg.cho_solve((factors[-1], True), right))
        predicted.append(columns[k] @ light[-1])
        left = weights[:, k] * (radiance[:, k] - predicted[-1])
        cost.append((left @ left + light[-1] @ (penalty[:, k] * light[-1])) / 2)
    return Solved(
        jnp.stack(light, axis=1),
        jnp.stack(predicted, axis=1),
        jnp.sum(jnp.stack(cost)),
        jnp.stack(factors),
    )


def _tangents(
    response: Response, guess: Guess, columns: Columns, light: Float[Array, "part channel"]
) -> Float[Array, "channel sample unknown"]:
    """Differentiate every channel's prediction by every nonlinear unknown, at fixed light."""
    share = gloss_share(guess)
    by_share = (columns.specular - columns.diffuse) @ light
    gloss = jnp.eye(share.shape[0], dtype=share.dtype) * (share * (1 - share))[:, None]
    by_gloss = jnp.einsum("sc,cd->csd", by_share, gloss)

    specular_under = response.specular_under(light)

    def specular_light(lobe: Float[Array, "2"]) -> Float[Array, "sample channel"]:
        return specular_under(guess._replace(sigma=lobe[0], mu=lobe[1]))

    at = jnp.stack([jnp.asarray(guess.sigma), jnp.asarray(guess.mu)])
    by_lobe = share[:, None, None] * jnp.swapaxes(jax.jacfwd(specular_light)(at), 0, 1)
    by_direction = _direction_tangents(response, guess, light[response.slow_count :])
    return jax.lax.optimization_barrier(jnp.concatenate([by_gloss, by_lobe, by_direction], axis=-1))


def _direction_tangents(
    response: Response, guess: Guess, energies: Float[Array, "source channel"]
) -> Float[Array, "channel sample twice_source"]:
    """Differentiate by a step of each source along two tangents of the sphere."""
    share = gloss_share(guess)
    directions = jnp.asarray(guess.directions)

    def columns(directions):
        diffuse = response.source_diffuse(directions)
        return diffuse, response.source_specular(guess._replace(directions=directions))

    found = []
    for tangent in jnp.moveaxis(_tangent_frames(directions), -1, 0):
        diffuse, specular = jax.jvp(columns, (directions,), (tangent,))[1]
        of_channel = share[:, None, None]
        mixed = (1 - of_channel) * diffuse[None] + of_channel * specular[None]
        found.append(mixed * energies.T[:, None, :])
    return jnp.concatenate(found, axis=-1)


def _tangent_frames(directions: Float[Array, "source 3"]) -> Float[Array, "source 3 2"]:
    return jax.vmap(world_from_local)(directions)[:, :, :2]


@jax.jit
def _damped(
    system: System, free: Bool[AnyArray, "unknown"], damping: Float[AnyArray, ""]
) -> Float[Array, "unknown"]:
    size = jnp.diag(system.curvature)
    usable = jnp.asarray(free) & (size > 0)
    scale = jnp.where(usable, jax.lax.rsqrt(jnp.where(usable, size, 1)), 0)
    matrix = system.curvature * scale[:, None] * scale[None, :]
    matrix = matrix + jnp.diag(jnp.where(usable, damping, 1.0))
    factor = jax.scipy.linalg.cho_factor(matrix, lower=True)
    step = scale * jax.scipy.linalg.cho_solve(factor, scale * system.slope)
    # A matrix that rounding has made indefinite gives no step; the damping then grows.
    step = jnp.where(jnp.all(jnp.isfinite(step)), step, 0)
    return jnp.clip(step, -_LONGEST, _LONGEST)


@partial(jax.jit, static_argnames="bounds")
def _moved(guess: Guess, step: Float[Array, "unknown"], bounds: tuple[float, float]) -> Guess:
    channels, sources = guess.gloss.shape[0], guess.directions.shape[0]
    gloss, lobe, first, second = jnp.split(step, [channels, channels + 2, channels + 2 + sources])
    directions = jnp.asarray(guess.directions)
    frames = _tangent_frames(directions)
    moved = directions + first[:, None] * frames[..., 0] + second[:, None] * frames[..., 1]
    moved = moved / jnp.linalg.norm(moved, axis=1, keepdims=True)
    sigma = jnp.clip(guess.sigma + lobe[0], *np.log(SIGMA_BOUNDS))
    mu = jnp.clip(guess.mu + lobe[1], *np.log(np.subtract(bounds, 1)))
    # All gloss or none is a material that is known to be so, and stays.
    within = jnp.clip(guess.gloss + gloss, -_MOST_GLOSS, _MOST_GLOSS)
    gloss = jnp.where(jnp.isinf(guess.gloss), guess.gloss, within)
    return Guess(gloss, sigma, mu, moved)
