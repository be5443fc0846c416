"""Complete the dual model by what it leaves out of the exact integral."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import band_limit_of, evaluate
from jaxrender.inverse.factorization.response import Guess, MirrorResponse, specular_share
from jaxrender.inverse.factorization.sight import Sight, hidden_nodes
from jaxrender.inverse.factorization.state import Lacking, State, Task
from jaxrender.lighting import LightNodes
from jaxrender.programs import stored
from jaxrender.reflection import integral_columns, slow_light_columns
from jaxrender.shapes import AnyArray, Array, Float, as_jax


def corrected(task: Task, state: State) -> State:
    """Give the response what the exact integral has and the dual model lacks, at the guess.

    The sources are exact already.  Of slow light the dual model has the azimuthal mean alone.  An
    ``IntegralResponse`` is exact and stays as it is.
    """
    response, guess = task.response, state.guess
    at = (float(guess.sigma), float(guess.mu))
    if not isinstance(response, MirrorResponse):
        return state
    if state.lacking is not None and state.lacking.lobe == at:
        return state
    lobe = response.lobe(guess)
    assert isinstance(lobe, Glossy)
    exact = slow_light_columns(lobe, response.samples, band_limit_of(response.slow_count))
    if task.sight is not None:
        units = np.eye(response.slow_count)
        exact = exact - hidden_slow_light(response.samples, task.sight, lobe, units)
    columns = as_jax(np.asarray(exact) - np.asarray(_by_degree(response, guess)))
    return state._replace(lacking=Lacking(columns, at))


def change(before: State, after: State) -> float:
    """Say by how much a correction changed what slow light sends (rms, in deviations)."""
    if after.lacking is None or after.lacking is before.lacking:
        return 0.0
    assert after.joint is not None
    slow = np.asarray(after.joint.solved.light)[: after.lacking.columns.shape[1]]
    columns = np.asarray(after.lacking.columns)
    if before.lacking is not None:
        columns = columns - np.asarray(before.lacking.columns)
    changed = np.asarray(specular_share(after.guess)) * (columns @ slow)
    return float(np.sqrt(np.mean((after.weights * changed) ** 2)))


@stored(jax.jit)
def _by_degree(response: MirrorResponse, guess: Guess) -> Float[Array, "sample coefficient"]:
    """Evaluate the dual model."""
    return response.slow_columns(response.passed(guess))


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
