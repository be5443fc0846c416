"""Correct the photographs, by the exact integral, for what the dual model leaves out."""

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import band_limit_of, evaluate
from jaxrender.inverse.factorization.response import (
    MirrorResponse,
    specular_share,
)
from jaxrender.inverse.factorization.sight import Sight, hidden_nodes
from jaxrender.inverse.factorization.state import State, Task, response_of
from jaxrender.lighting import LightNodes
from jaxrender.programs import stored
from jaxrender.reflection import integral_columns, reflect_slow_light
from jaxrender.shapes import Array, Float
from jaxrender.spectra import transfer_of_samples


def corrected(task: Task, state: State) -> State:
    """Subtract from the photographs what the exact integral has and the dual model lacks.

    The sources are exact already.  Of slow light the dual model has the azimuthal mean alone.  An
    ``IntegralResponse`` is exact and stays as it is.
    """
    assert state.joint is not None
    response, guess = response_of(task, state), state.guess
    if not isinstance(response, MirrorResponse):
        return state
    slow = jnp.asarray(state.joint.solved.light[: response.slow_count])
    lobe = response.lobe(guess)
    assert isinstance(lobe, Glossy)
    exact = reflect_slow_light(lobe, response.samples, slow)
    if task.sight is not None:
        exact = exact - hidden_slow_light(response.samples, task.sight, lobe, slow)
    defect = np.asarray(exact) - np.asarray(_by_degree(response, lobe, slow))
    return state._replace(target=task.radiance - np.asarray(specular_share(guess)) * defect)


@stored(older_emitters=True)
def _by_degree(
    response: MirrorResponse, lobe: Glossy, slow: Float[Array, "coefficient channel"]
) -> Float[Array, "sample channel"]:
    """Evaluate slow light by the dual model."""
    band_limit = band_limit_of(response.slow_count)
    passed = transfer_of_samples(lobe, response.samples.exit_cosines, band_limit)
    return response.slow_columns(passed) @ slow


def hidden_slow_light(
    samples: SurfaceSamples,
    sight: Sight,
    lobe: Glossy,
    slow: Float[Array, "coefficient channel"],
) -> Float[Array, "sample channel"]:
    """Sum the slow light that the object hides from itself, over a grid."""
    directions, solid_angle = hidden_nodes()
    light = evaluate(slow, directions)
    nodes = LightNodes(directions, jnp.asarray(solid_angle, light.dtype)[:, None] * light)
    return integral_columns(lobe, samples, nodes, sight.hidden())[:, 1]
