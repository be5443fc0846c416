"""How well nuisances are known, what of it is in the material's errors, and what is not told."""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.calibration.capture import MOST_SAMPLES, NEAREST
from jaxrender.inverse.calibration.equations import (
    Pull,
    State,
    columns_of,
    deviations_of,
    unit_columns,
)
from jaxrender.inverse.clusters import Clusters, widened
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.material_task import MaterialTask
from jaxrender.inverse.nuisances import Corrections, Told
from jaxrender.inverse.parameters import slopes_of_parameters
from jaxrender.inverse.passes import Stop
from jaxrender.shapes import Float, Int

# Two nuisances are alike where both together leave less than their priors say, of something that
# one alone would tell so many times as well (variances).
_ALIKE = 100.0


class Calibrated(NamedTuple):
    """A material and the corrections that go with it.

    ``stop`` is of corrected samples, under the corrected ``light``; ``told`` is what was corrected.
    ``errors`` are the standard errors of what is ``free``.  ``spread`` is what the material's
    covariance has for their sake.  ``sentences`` say what cannot be told apart or is at a bound.
    ``absorbed`` is the part of chi-squared above the noise that they do away with.
    """

    stop: Stop
    told: Told
    corrections: Corrections
    light: KnownLight
    free: tuple[str, ...]
    errors: dict[str, Float[np.ndarray, "number"]]
    spread: Float[np.ndarray, "parameter parameter"]
    settled: bool
    sentences: tuple[str, ...]
    absorbed: float = 0.0


def account_of(
    task: MaterialTask, told: Told, state: State, free: tuple[str, ...], settled: bool
) -> Calibrated:
    """Say how well the nuisances are known, and what of that goes into the material's errors."""
    stop = state.stop
    index = _some(stop.observations.count, task.settings.seed)
    known, columns, names = columns_of(task, told, state, free, index)
    jacobian = known.jacobian
    # How the material answers to each nuisance, and what of the nuisance the material cannot make.
    answer = np.linalg.lstsq(unit_columns(jacobian), columns, rcond=1e-9)[0]
    own = columns - unit_columns(jacobian) @ answer
    pull = Pull.of(state.corrections, *free)
    covariance = np.linalg.inv(own.T @ own + np.diag(pull.weights))
    left = known.left - own @ (covariance @ (own.T @ known.left))
    channels = known.weights.shape[1]
    scores = np.sum((left[:, None] * own).reshape(-1, channels, len(names)), axis=1)
    clusters = Clusters.of(stop.observations.take(index))
    covariance = widened(covariance, clusters.covariance(scores @ covariance))
    size = np.linalg.norm(jacobian, axis=0)
    answer = answer / np.where(size > 0, size, 1)[:, None]
    end = stop.fit.solution.point, stop.fit.linear.eliminated
    moves = np.asarray(slopes_of_parameters(stop.problem, *end)) @ answer
    errors = np.sqrt(np.diag(covariance))
    by_name = {name: errors[names == name] * deviations_of(name, names) for name in free}
    sentences = [*_alike(columns, own, names), *_at_bound(state.corrections, free)]
    if not settled:
        sentences.append(f"the calibration of {' and '.join(free)} did not settle")
    return Calibrated(
        stop,
        told,
        state.corrections,
        state.light,
        free,
        by_name,
        moves @ covariance @ moves.T,
        settled,
        tuple(sentences),
    )


def _some(count: int, seed: int) -> Int[np.ndarray, "sample"]:
    if count <= MOST_SAMPLES:
        return np.arange(count)
    return np.sort(np.random.default_rng(seed).choice(count, MOST_SAMPLES, replace=False))


def _alike(
    columns: Float[np.ndarray, "value nuisance"],
    own: Float[np.ndarray, "value nuisance"],
    names: np.ndarray,
) -> list[str]:
    """Name what cannot be told apart: pairs of nuisances, and a nuisance and the material."""
    found = []
    free = list(dict.fromkeys(names))
    for at, name in enumerate(free):
        mine = own[:, names == name]
        if _lost(columns[:, names == name], mine):
            found.append(
                f"{name} and the material cannot be told apart by these photographs alone: the "
                f"prior of {name} decides"
            )
        for other in free[at + 1 :]:
            theirs = own[:, names == other]
            basis = np.linalg.svd(theirs, full_matrices=False)[0]
            if _lost(mine, mine - basis @ (basis.T @ mine)):
                found.append(
                    f"{name} and {other} cannot be told apart by these photographs: their priors "
                    "divide what both could be; free one of them, or know one better"
                )
    return found


def _lost(
    alone: Float[np.ndarray, "value nuisance"], together: Float[np.ndarray, "value nuisance"]
) -> bool:
    """Whether something is told well alone, and less than by its prior beside something else."""
    values, vectors = np.linalg.eigh(together.T @ together)
    told = np.sum((alone @ vectors) ** 2, axis=0)
    return bool(np.any((values < 1) & (told > _ALIKE)))


def _at_bound(corrections: Corrections, free: tuple[str, ...]) -> list[str]:
    """Say which sources are as far as they can be, or as near, and whether nothing is blurred."""
    found = []
    if "blur" in free and corrections.blur[0] <= 0:
        found.append("blur is at its bound 0: the photographs are as sharp as the model")
    if "nearness" not in free:
        return found
    for number, near in enumerate(corrections.nearness):
        if near <= 0:
            found.append(f"nearness of source {number + 1} is at its bound 0: it is infinitely far")
        elif near >= NEAREST:
            found.append(f"nearness of source {number + 1} is at its bound {NEAREST}")
    return found
