"""What would explain what a factorization leaves, where the light is unknown too.

A cause explains only what neither the material nor any light can make.  So each coefficient of
slow light may differ from the one found, as far as its prior expects.  These differences are
integrated out: they are noise that the samples share (``diagnosis.derivatives``).
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.geometry import Shape
from jaxrender.inverse.diagnosis import Suspect
from jaxrender.inverse.diagnosis.derivatives import Derivatives
from jaxrender.inverse.diagnosis.light_parts import LightParts
from jaxrender.inverse.factorization.account import parameter_slopes
from jaxrender.inverse.factorization.blocks import SAMPLES_AT_ONCE
from jaxrender.inverse.factorization.gauges import amplitudes_of
from jaxrender.inverse.factorization.projection import mixed
from jaxrender.inverse.factorization.response import specular_share
from jaxrender.inverse.factorization.slopes import columns_at, lobe_slopes, prediction_slopes
from jaxrender.inverse.factorization.source_nodes import as_points, widths_of
from jaxrender.inverse.factorization.state import State, Task, free_unknowns, measured, response_of
from jaxrender.inverse.observations import Observations
from jaxrender.lighting import DirectionalSources
from jaxrender.shapes import Int

# A fit that finds the light assumes none of these.
_UNKNOWN = ("gain", "environment", "lamps")


class Found(NamedTuple):
    """A material and a light that were found, in one gauge."""

    brdf: Parametric
    light: LightParts
    gauge: str

    @classmethod
    def per_channel(cls, task: Task, state: State) -> "Found":
        """Take both where a search stands, kd + ks = 1 in each channel."""
        assert state.joint is not None
        variant, guess, slow = task.response.variant, state.guess, task.response.slow_count
        share, light = np.asarray(specular_share(guess)), np.asarray(state.joint.solved.light)
        amplitudes = amplitudes_of(variant, 1 - share, share).values()
        brdf = task.response.lobe(guess).with_amplitudes(*amplitudes)
        on = state.active
        sources = DirectionalSources(np.asarray(guess.directions)[on], light[slow:][on])
        widths = widths_of(guess.variance, guess.sigma, len(on))[on]
        sources = as_points(sources, widths)
        return cls(brdf, LightParts.found(light[:slow], sources), "per-channel")


class Photographs(NamedTuple):
    """What was photographed: samples as they were told, all pixels, and the shape if it is known.

    ``freed`` are nuisances by which the samples of a task are corrected.
    """

    told: Observations
    pool: Observations
    shape: Shape | None
    freed: tuple[str, ...] = ()


def suspect_of(task: Task, state: State, found: Found, photographs: Photographs) -> Suspect:
    """Suspect a factorization of where it stands."""
    assert state.joint is not None
    told, pool, shape, freed = photographs
    return Suspect(
        task.observations,
        np.asarray(state.joint.solved.predicted),
        np.ones(task.observations.count),
        found.brdf,
        found.light,
        shape,
        told,
        pool,
        partial(derivatives_of, task, state, found.gauge),
        freed=freed,
        unknown=_UNKNOWN,
    )


def derivatives_of(
    task: Task, state: State, gauge: str, index: Int[np.ndarray, "sample"]
) -> Derivatives:
    """Differentiate the prediction of some samples by the material and by the light."""
    assert state.joint is not None
    data, guess = measured(task, state), state.guess
    solved, free = state.joint.solved, free_unknowns(task, state)
    share, rows = specular_share(guess), []
    # As many at once as a block has: its programs are compiled already.
    for part in _in_full(index, min(SAMPLES_AT_ONCE, task.observations.count)):
        response = response_of(task, state).take(part)
        (lobe,) = lobe_slopes([response], guess)
        both = columns_at(response, guess, lobe.passed)
        moved = prediction_slopes(response, lobe, guess, both, solved.light)
        rows.append([np.moveaxis(np.asarray(a, float), 0, 1) for a in (mixed(both, share), moved)])
    columns, slopes = (np.concatenate(part)[: len(index)] for part in zip(*rows))
    weights = np.asarray(data.weights, float)[index]
    # Of the slow light all but the mean has a prior.
    slow = np.arange(1, response.slow_count)
    others = np.r_[0, response.slow_count + np.flatnonzero(state.active)]
    weighted = weights[:, :, None] * columns
    deviation = 1 / np.sqrt(np.asarray(data.penalty, float)[slow])
    of_light = [
        part[:, :, None] * np.eye(weights.shape[1])[None]
        for part in np.moveaxis(weighted[:, :, others], 2, 0)
    ]
    by_unknown = np.concatenate([weights[:, :, None] * slopes[:, :, free], *of_light], axis=2)
    by_material, by_light = parameter_slopes(task, state, gauge)
    parts = np.moveaxis(by_light[:, :, others], 1, 2).reshape(len(by_light), -1)
    in_prior = (by_light[:, :, slow] * deviation.T).reshape(len(by_light), -1)
    return Derivatives(
        weights * (task.radiance - np.asarray(solved.predicted))[index],
        by_unknown,
        weights,
        tuple(np.moveaxis(weighted[:, :, slow] * deviation.T, 1, 0)),
        np.concatenate([by_material[:, free], parts, in_prior], axis=1),
    )


def _in_full(index: Int[np.ndarray, "sample"], length: int) -> Int[np.ndarray, "part length"]:
    """Cut samples into parts of one length, the last of them repeated to the end."""
    return np.pad(index, (0, -len(index) % length), mode="edge").reshape(-1, length)
