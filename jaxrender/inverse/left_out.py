"""What a fit would have said of each photograph, had it not seen that photograph.

At the end of a fit, leaving the samples of photograph p out moves the unknowns to first order by

delta_p = -(J'J - J_p' J_p)^-1 J_p' r_p

with J the derivatives of the weighted predictions and r what they leave.  That is one Newton step
of the fit to all others, and exact where the model is linear in its unknowns.  So every photograph
is held out whole, and no fit is made again.  What ended at a bound stays there.
"""

import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.elimination import Data
from jaxrender.inverse.models import LinearisedModel, Model
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.parameters import weighted_jacobian
from jaxrender.inverse.passes import Stop
from jaxrender.inverse.uncertainty import held_at_bounds
from jaxrender.shapes import Float, Int

# Fewer photographs cannot do without one of them.
FEWEST_PHOTOGRAPHS = 4
# Directions that the other photographs tell so much less of stay where they are.
_TOLD = 1e-9


def predicted_left_out(
    stop: Stop, model: Model, rest: Observations
) -> Float[np.ndarray, "sample channel"]:
    """Predict samples, those of each photograph by the fit to the others.

    ``model`` is that of the samples ``rest``, in the same unknowns.  Where the fit has fewer than
    four photographs, each is predicted by the fit to all.
    """
    problem, end = stop.problem, stop.fit
    point, eliminated = jnp.asarray(end.solution.point), end.linear.eliminated
    physical, free = problem.unknowns.unpack(point), problem.unknowns.free_numbers
    near = LinearisedModel.about(model, physical.numbers, free)
    radiance, frame = np.asarray(rest.radiance), np.asarray(rest.frame)
    data = Data(radiance, np.ones_like(radiance), frame)
    columns = problem.columns(near, data, physical)
    predicted = np.asarray(columns.times(end.linear.amplitudes))
    fitted_to = np.asarray(stop.data.frame)
    if len(np.unique(fitted_to)) < FEWEST_PHOTOGRAPHS:
        return predicted
    moves = _moves(stop, fitted_to)
    slopes = np.asarray(weighted_jacobian(problem, near, data, point, eliminated))
    slopes = slopes.reshape(*radiance.shape, -1)
    for number, move in moves.items():
        own = frame == number
        predicted = predicted + np.where(own[:, None], slopes @ move, 0)
    return predicted


def _moves(stop: Stop, frame: Int[np.ndarray, "sample"]) -> dict[int, Float[np.ndarray, "unknown"]]:
    """Find how far the unknowns move without each photograph."""
    problem, end = stop.problem, stop.fit
    point, eliminated = jnp.asarray(end.solution.point), end.linear.eliminated
    near = stop.model
    if not isinstance(near, LinearisedModel):
        numbers = problem.unknowns.unpack(point).numbers
        near = LinearisedModel.about(near, numbers, problem.unknowns.free_numbers)
    left = np.asarray(stop.data.weights) * (stop.data.radiance - np.asarray(end.predicted))
    slopes = np.array(weighted_jacobian(problem, near, stop.data, point, eliminated), float)
    slopes[:, held_at_bounds(problem, end)] = 0
    size = np.linalg.norm(slopes, axis=0)
    scale = np.where(size > 0, 1 / np.where(size > 0, size, 1), 0)
    slopes = (slopes * scale).reshape(*left.shape, -1)
    whole = np.einsum("sca,scb->ab", slopes, slopes)
    found = {}
    for number in np.unique(frame):
        own = frame == number
        information = whole - np.einsum("sca,scb->ab", slopes[own], slopes[own])
        pull = np.einsum("sca,sc->a", slopes[own], left[own])
        found[int(number)] = -scale * (np.linalg.pinv(information, _TOLD, hermitian=True) @ pull)
    return found
