"""Where to begin with a material that the frequency view does not know: the integral, coarsely.

Reflection by fibres, brushed metal or rough diffuse paint is no convolution about the reflected
direction, so that their fits have the exact integral alone.  Few samples under light condensed to
coarse cells tell well enough which of many starts is the best, and where it leads.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.elimination import Data, cost_at
from jaxrender.inverse.leverage import draw, leverage
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.material_task import MaterialTask
from jaxrender.inverse.models import ExactModel
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.passes import Begin, Stop, descend
from jaxrender.inverse.shadowing import nodes_seen
from jaxrender.shapes import Float

# Samples of the coarse fit.
_SAMPLES = 500
# The light's cells, radians: at first, and then as wide as a part of the lobe that was found.
_WIDEST_CELL, _NARROWEST_CELL, _CELL_PER_SIGMA = 0.12, 0.03, 0.5
# The fit is made again where the cells should have been narrower by this factor.
_MUCH_NARROWER, _ROUNDS = 0.7, 3
# The fine fit chooses among so many times the samples that it takes.
_CHOICE = 3


class Coarse(NamedTuple):
    """Where a coarse fit ended, and what it predicts of samples for a fine one to choose from."""

    stop: Stop
    observations: Observations
    predicted: Float[np.ndarray, "sample channel"]


def fit_coarsely(task: MaterialTask) -> Coarse:
    """Fit few samples by the integral over a condensed light."""
    observations, settings = task.observations, task.settings
    weight = leverage(observations, task.light, task.widths)
    some, _ = draw(observations, weight, _SAMPLES, settings.seed)
    cell, stop = _WIDEST_CELL, None
    for _ in range(_ROUNDS):
        stop = _fit(task, some, cell, stop)
        wanted = _CELL_PER_SIGMA * task.width(stop)
        wanted = float(np.clip(wanted, _NARROWEST_CELL, _WIDEST_CELL))
        if wanted > _MUCH_NARROWER * cell:
            break
        cell = wanted
    assert stop is not None
    choice, _ = draw(observations, weight, _CHOICE * settings.refine_samples, settings.seed)
    return Coarse(stop, choice, _predicted(task, stop, choice))


def _fit(task: MaterialTask, some: Observations, cell: float, before: Stop | None) -> Stop:
    """Descend from the best of many starts, or from where a coarser fit ended."""
    problem, settings = task.problem, task.settings
    model = _model(task, some, cell)
    if before is not None:
        predicted = np.asarray(before.fit.predicted)
        return descend(problem, model, some, before.onward(predicted), settings)
    radiance = np.asarray(some.radiance)
    even = np.full_like(radiance, 1 / np.sqrt(np.mean(radiance**2)))
    even *= np.sqrt(some.shares)[:, None].astype(even.dtype)
    data = Data(radiance, even, np.asarray(some.frame))
    # So many along each of the numbers that are searched for.
    shapes = len(problem.unknowns.free_numbers)
    starts = problem.unknowns.starts(settings.starts * max(shapes, 1))
    alone = problem.without_priors
    costs = [float(cost_at(alone, model, data, jnp.asarray(point))) for point in starts]
    best = starts[int(np.nanargmin(costs))][None]
    return descend(problem, model, some, Begin(settings.noise, None, best), settings)


def _model(task: MaterialTask, observations: Observations, cell: float) -> ExactModel:
    nodes = exact_nodes(task.light, observations, cell, 1.0)
    seen = nodes_seen(task.shape, observations, nodes)
    return ExactModel(task.variant, observations.samples, nodes, seen)


def _predicted(
    task: MaterialTask, stop: Stop, observations: Observations
) -> Float[np.ndarray, "sample channel"]:
    model = _model(task, observations, _WIDEST_CELL)
    radiance = np.asarray(observations.radiance)
    data = Data(radiance, np.ones_like(radiance), np.asarray(observations.frame))
    point = jnp.asarray(stop.fit.solution.point)
    return np.asarray(task.problem.predict(model, data, point, stop.fit.linear))
