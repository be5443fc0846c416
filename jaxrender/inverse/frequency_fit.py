"""The first two steps of a fit of a glossy material: the dual model, rough and then fine (T 6.4.2).

The light is split at a small roughness, and the dual model fitted from many starts.  Then the light
is split at the roughness found, as finely as the dual model needs it, and the samples fitted again.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.elimination import Few
from jaxrender.inverse.leverage import draw, index_range, leverage
from jaxrender.inverse.material_task import MaterialTask
from jaxrender.inverse.models import TabulatedModel
from jaxrender.inverse.passes import Begin, Stop, fit_in_rounds
from jaxrender.inverse.prepared_light import PreparedLight, prepare_light
from jaxrender.inverse.search import MANY, THINNING
from jaxrender.inverse.shadowing import shadows_of, with_transfer
from jaxrender.reflection import DualLight, RoughnessTable, roughness_table

# The roughness that the light is split at in the rough first pass.
_ROUGH_SIGMA = 0.06
# The table of the second pass reaches this factor beyond the roughness found by the first.
_TABLE_REACH = 1.8
# The light is split anew when the fit ends this far (in log sigma) from where it was split.
_SPLIT_AGAIN = 0.25
_SPLITS = 3


class FrequencyFit(NamedTuple):
    """Where the frequency view ended, and the light that it was made for."""

    stop: Stop
    light: PreparedLight


def fit_by_frequency(task: MaterialTask) -> FrequencyFit:
    """Split the light and fit the dual model, again until both are made for one roughness."""
    settings, variant = task.settings, task.glossy
    if task.shape is not None:
        with task.stage("shadows"):
            degrees = task.light.diffuse_degrees
            observations = with_transfer(task.observations, task.shape, degrees)
            task = task._replace(observations=observations)
    few = _few(task)
    found, prepared = _rough_fit(task, few), None
    for _ in range(_SPLITS):
        at = _sigma(task, found)
        with task.stage("split"):
            prepared = prepare_light(
                task.light,
                task.observations,
                variant.with_roughness(at, None).as_metal(),
                settings.split,
                settings.band_limit,
                transfer=settings.split_transfer,
            )
        table = _tabulated(task, prepared.dual, _table_range(task, at), "table")
        with task.stage("solve"):
            begin = Begin(settings.noise, None, np.asarray(found.fit.solution.point)[None])
            model = TabulatedModel(variant, table)
            found = fit_in_rounds(task.problem, model, task.observations, begin, settings, few)
        if abs(np.log(_sigma(task, found) / at)) < _SPLIT_AGAIN:
            break
    assert prepared is not None
    return FrequencyFit(found, prepared)


def _rough_fit(task: MaterialTask, few: Few | None) -> Stop:
    """Find the neighbourhood of the answer from many starts."""
    unknowns, variant, settings = task.unknowns, task.glossy, task.settings
    width = unknowns[variant.shape.name]
    if width.free:
        reach = task.widths
        sigma = max(reach[0], min(_ROUGH_SIGMA, reach[1]))
    else:
        sigma = variant.shape.width_of(width.first(0.0))
        reach = (sigma, sigma * 1.01)
    split = "rough" if settings.split == "auto" else settings.split
    brdf = variant.with_roughness(sigma, None)
    with task.stage("rough"):
        light = prepare_light(task.light, task.observations, brdf, split, settings.band_limit).dual
    table = _tabulated(task, light, reach, "rough")
    with task.stage("rough"):
        begin = Begin(settings.noise, None, unknowns.starts(settings.starts))
        model = TabulatedModel(variant, table)
        return fit_in_rounds(task.problem, model, task.observations, begin, settings, few)


def _tabulated(
    task: MaterialTask, light: DualLight, reach: tuple[float, float], stage: str
) -> RoughnessTable:
    """Tabulate the dual model over the widths within reach, shadows included."""
    shadows = None
    if task.shape is not None:
        with task.stage("shadows"):
            shadows = shadows_of(task.shape, task.observations, light)
    with task.stage(stage):
        return roughness_table(
            task.glossy,
            task.observations.samples,
            light,
            reach,
            index_range(task.unknowns, task.variant),
            transfer=task.settings.transfer,
            shadows=shadows,
        )


def _few(task: MaterialTask) -> Few | None:
    """Choose the samples that a search among many begins with."""
    observations = task.observations
    if observations.count < MANY:
        return None
    weight = leverage(observations, task.light, task.widths)
    some, index = draw(observations, weight, observations.count // THINNING, task.settings.seed)
    return Few(index, some.pixels / observations.pixels[index])


def _table_range(task: MaterialTask, sigma: float) -> tuple[float, float]:
    if not task.unknowns[task.variant.shape.name].free:
        return sigma, 1.01 * sigma
    low, high = task.widths
    return max(low, sigma / _TABLE_REACH), min(high, sigma * _TABLE_REACH)


def _sigma(task: MaterialTask, stop: Stop) -> float:
    return float(task.material(stop).sigma)
