"""Where to begin with a material that the frequency view does not know: the integral, coarsely.

Reflection by fibres, brushed metal or rough matt paint is no convolution about the reflected
direction, so that their fits have the exact integral alone.  Few samples under light condensed to
coarse cells tell well enough which of many starts is the best, and where it leads.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.geometry import Shape
from jaxrender.inverse.elimination import Data, Problem, cost_at
from jaxrender.inverse.known_light import KnownLight, exact_nodes
from jaxrender.inverse.leverage import draw, leverage, width_range
from jaxrender.inverse.models import ExactModel
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.passes import Begin, FitSettings, Stop, descend, values_of
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


def fit_coarsely(
    observations: Observations,
    light: KnownLight,
    sought: tuple[Problem, Parametric],
    settings: FitSettings,
    shape: Shape | None = None,
) -> Coarse:
    """Fit few samples by the integral over a condensed light; ``shape`` where it is concave."""
    told = leverage(observations, light, width_range(sought[0].unknowns, sought[1]))
    some, _ = draw(observations, told, _SAMPLES, settings.seed)
    cell, stop = _WIDEST_CELL, None
    for _ in range(_ROUNDS):
        stop = _fit(some, light, sought, settings, (cell, shape, stop))
        wanted = _CELL_PER_SIGMA * width_of(stop, sought[1])
        wanted = float(np.clip(wanted, _NARROWEST_CELL, _WIDEST_CELL))
        if wanted > _MUCH_NARROWER * cell:
            break
        cell = wanted
    assert stop is not None
    choice, _ = draw(observations, told, _CHOICE * settings.refine_samples, settings.seed)
    return Coarse(stop, choice, _predicted(stop, light, sought, choice, shape))


def width_of(stop: Stop, variant: Parametric) -> float:
    """How fine a light the lobe asks for at which a pass has ended."""
    return float(material_of(stop, variant).width)


def material_of(stop: Stop, variant: Parametric) -> Parametric:
    """Put what a pass has found into the model; kd and ks as well."""
    found = values_of(stop)
    lobe = variant.with_numbers({name: float(value) for name, value in found.numbers.items()})
    return lobe.with_amplitudes(np.asarray(found.kd), np.asarray(found.ks))


def _fit(
    some: Observations,
    light: KnownLight,
    sought: tuple[Problem, Parametric],
    settings: FitSettings,
    where: tuple[float, Shape | None, Stop | None],
) -> Stop:
    """Descend from the best of many starts, or from where a coarser fit ended."""
    (problem, variant), (cell, shape, before) = sought, where
    model = _model(variant, some, light, (cell, shape))
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
    costs = [float(cost_at(problem, model, data, jnp.asarray(point))) for point in starts]
    best = starts[int(np.nanargmin(costs))][None]
    return descend(problem, model, some, Begin(settings.noise, None, best), settings)


def _model(
    variant: Parametric,
    observations: Observations,
    light: KnownLight,
    where: tuple[float, Shape | None],
) -> ExactModel:
    cell, shape = where
    nodes = exact_nodes(light, np.asarray(observations.frame), cell, 1.0)
    return ExactModel(variant, observations.samples, nodes, nodes_seen(shape, observations, nodes))


def _predicted(
    stop: Stop,
    light: KnownLight,
    sought: tuple[Problem, Parametric],
    observations: Observations,
    shape: Shape | None,
) -> Float[np.ndarray, "sample channel"]:
    problem, variant = sought
    model = _model(variant, observations, light, (_WIDEST_CELL, shape))
    radiance = np.asarray(observations.radiance)
    data = Data(radiance, np.ones_like(radiance), np.asarray(observations.frame))
    point = jnp.asarray(stop.fit.solution.point)
    return np.asarray(problem.predict(model, data, point, stop.fit.linear))
