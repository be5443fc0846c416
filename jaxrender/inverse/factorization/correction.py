"""Complete the dual model by what it leaves out of the exact integral."""

from functools import partial

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import band_limit_of, evaluate
from jaxrender.inverse.factorization.blocks import by_rows
from jaxrender.inverse.factorization.response import (
    Guess,
    MirrorResponse,
    by_degree,
    lobe_of,
    specular_share,
)
from jaxrender.inverse.factorization.sight import Sight, hidden_nodes
from jaxrender.inverse.factorization.state import Lacking, State, Task
from jaxrender.lighting import LightNodes
from jaxrender.programs import stored
from jaxrender.reflection import integral_columns, slow_light_columns
from jaxrender.shapes import AnyArray, Array, Float, as_jax
from jaxrender.spectra import transfer_of_samples

# A step of log sigma and of log(mu - 1), to differentiate by.
_STEP = 1e-3


def corrected(task: Task, state: State, near: float = 0.0) -> State:
    """Give the response what the exact integral has and the dual model lacks, at the guess.

    The sources are exact already.  Of slow light the dual model has the azimuthal mean alone.  An
    ``IntegralResponse`` is exact and stays as it is, and so does a response that was completed no
    farther away than ``near``, in log sigma and log(mu - 1).
    """
    response, guess = task.response, state.guess
    at = (float(guess.sigma), float(guess.mu))
    if not isinstance(response, MirrorResponse):
        return state
    if state.lacking is not None and np.abs(np.subtract(state.lacking.lobe, at)).max() <= near:
        return state
    sight = task.sight
    here = _lacking(response, guess, sight)
    aside = guess._replace(sigma=guess.sigma + _STEP)
    by_sigma = (_lacking(response, aside, sight) - here) / _STEP
    by_mu = np.zeros_like(here)
    if response.variant.mu is not None:
        aside = guess._replace(mu=guess.mu + _STEP)
        by_mu = (_lacking(response, aside, sight) - here) / _STEP
    constant = here - at[0] * by_sigma - at[1] * by_mu
    columns = as_jax(np.stack([constant, by_sigma, by_mu], axis=1))
    return state._replace(lacking=Lacking(columns, at))


def change(before: State, after: State) -> float:
    """Say by how much a correction changed what slow light sends (rms, in deviations)."""
    if after.lacking is None or after.lacking is before.lacking:
        return 0.0
    assert after.joint is not None
    guess = after.guess
    columns = np.asarray(after.lacking.columns)
    if before.lacking is not None:
        columns = columns - np.asarray(before.lacking.columns)
    columns = np.tensordot(columns, [1, float(guess.sigma), float(guess.mu)], axes=(1, 0))
    slow = np.asarray(after.joint.solved.light)[: columns.shape[1]]
    changed = np.asarray(specular_share(guess)) * (columns @ slow)
    return float(np.sqrt(np.mean((after.weights * changed) ** 2)))


def _lacking(
    response: MirrorResponse, guess: Guess, sight: Sight | None
) -> Float[np.ndarray, "sample coefficient"]:
    """Compute what the dual model leaves out at a guess, less what the object hides from itself."""
    # The sources stay outside: another number of them would be another program.
    sigma, mu = jnp.asarray(guess.sigma), jnp.asarray(guess.mu)
    left_out = partial(_left_out, response.variant, sigma, mu)
    whole = by_rows(left_out, response.samples, response.mirror_basis)
    if sight is None:
        return whole
    units, lobe = np.eye(response.slow_count), response.lobe(guess)
    assert isinstance(lobe, Glossy)
    return whole - np.asarray(hidden_slow_light(response.samples, sight, lobe, units))


@stored(effort="less")
def _left_out(
    variant: Glossy,
    sigma: Float[Array, ""],
    mu: Float[Array, ""],
    samples: SurfaceSamples,
    mirror_basis: Float[AnyArray, "sample coefficient"],
) -> Float[Array, "sample coefficient"]:
    lobe, band_limit = lobe_of(variant, sigma, mu), band_limit_of(mirror_basis.shape[1])
    assert isinstance(lobe, Glossy)
    exact = slow_light_columns(lobe, samples, band_limit)
    passed = transfer_of_samples(lobe, samples.exit_cosines, band_limit)
    return exact - by_degree(passed, mirror_basis)


def hidden_slow_light(
    samples: SurfaceSamples,
    sight: Sight,
    lobe: Glossy,
    slow: Float[AnyArray, "coefficient channel"],
) -> Float[Array, "sample channel"]:
    """Sum the slow light that the object hides from itself, over a grid."""
    directions, solid_angle = hidden_nodes()
    light = evaluate(jnp.asarray(slow), directions)
    nodes = LightNodes(directions, jnp.asarray(solid_angle, light.dtype)[:, None] * light)
    return integral_columns(lobe, samples, nodes, sight.hidden())[:, 1]
