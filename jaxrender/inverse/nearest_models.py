"""Which model is nearest to a BRDF: a table, a tree, or values at scattered pairs of directions.

A candidate, sum of amplitude times lobe, is fitted to values at pairs of directions: the
measurements themselves, or cells of Nusselt's square, over which the plain mean is the integral in
both projected solid angles (L 4.1).  What is minimised is a metric of ``brdf.tables.measurements``:

``plain``       by variable projection (``elimination``): amplitudes enter linearly
the others      over amplitudes and numbers together (``nearest_search``)

Plain squares let the few brightest values decide, which of a glossy paint are those at grazing.  So
the cube root is the usual metric.  Of measurements a part is held out in turn, and the order is by
the error there: a model of more numbers is not better for having them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxrender.brdf import BRDF, PARAMETRIC, Parametric, lobe_named
from jaxrender.brdf.tables.measurements import METRICS, Measurements, errors_of, metric_named
from jaxrender.geometry import NUSSELT
from jaxrender.inverse.nearest_search import Objective, Spread, minimised, spread_of, started
from jaxrender.shapes import Float, checked

CANDIDATES = ("microfacet", "ggx", "ward", "phong", "blinn-phong", "torrance-sparrow")
KNOWN = tuple(PARAMETRIC)

_STARTS = 4
_FOLDS = 5
# Fewer pairs say too little of a model's few numbers to hold some of them out.
_FEWEST = 40
_evaluate = eqx.filter_jit(BRDF.evaluate)


class Candidate(NamedTuple):
    """A fitted model, what it misses, and how well its numbers are known.

    ``errors`` are relative and by metric, at the pairs it was fitted to; ``relative_rms`` is the
    plain one.  ``held_out`` is that of the chosen metric at pairs that were left out in turn, NaN
    where none were.  ``standard_errors`` and ``intervals`` (95 %) go with ``parameters``; they
    count what the model misses as noise, and are infinite where the pairs do not tell.
    """

    name: str
    brdf: Parametric
    relative_rms: float
    parameters: dict[str, float | list[float]]
    converged: bool
    errors: dict[str, float]
    held_out: float
    standard_errors: dict[str, float | list[float]]
    intervals: dict[str, list[float] | list[list[float]]]


@checked
def best_models(
    source: BRDF | Measurements,
    candidates: Sequence[str] = CANDIDATES,
    size: int = 32,
    most_pairs: int = 2**13,
    metric: str = "cube-root",
    folds: int | None = None,
) -> list[Candidate]:
    """Fit each candidate to a BRDF, or to measurements, and rank them, the least error first.

    ``size`` is that of the squares whose cells' centres the pairs of a BRDF are, best a tree's or a
    table's own: a Haar tree is a table's value there, and differs between.  Of more than
    ``most_pairs`` so many are taken.  ``folds`` is how many parts are held out in turn: 5 of
    measurements, none (0) of a BRDF, which has no noise.  The order is by the error held out, or
    else at the pairs.  The first fit of a candidate compiles for some seconds.

    Raises ``ValueError`` for a candidate or a metric that there is none of, a size below 2, one
    fold, fewer than 40 measurements, and values that are zero throughout or, of a BRDF, not finite.
    """
    metric_named(metric)
    unknown = [name for name in candidates if name not in KNOWN]
    if unknown or not candidates:
        raise ValueError(f"candidates={tuple(candidates)}: choose some of {', '.join(KNOWN)}")
    if size < 2 or most_pairs < 1:
        raise ValueError(f"size={size}, most_pairs={most_pairs}: give at least 2 and 1")
    scattered = isinstance(source, Measurements)
    folds = (_FOLDS if scattered else 0) if folds is None else folds
    if folds < 0 or folds == 1:
        raise ValueError(f"folds={folds}: give 0 to hold nothing out, or at least 2")
    measured = _checked(source) if scattered else pairs_of(source, size, most_pairs)
    found = [_fitted(name, measured, metric, folds) for name in candidates]
    return sorted(found, key=lambda one: one.held_out if folds else one.errors[metric])


def _fitted(name: str, measured: Measurements, metric: str, folds: int) -> Candidate:
    objective = Objective.of(lobe_named(name, measured.values.shape[1]), measured, METRICS[metric])
    start = started(objective, _STARTS)
    found = minimised(objective, start)
    held_out = float("nan")
    if folds:
        fold = np.random.default_rng(0).permutation(len(measured.values)) % folds
        predicted = np.empty_like(measured.values)
        for number in range(folds):
            kept = minimised(objective.weighted(fold != number), found)
            predicted[fold == number] = objective.predicted(kept.point)[fold == number]
        held_out = METRICS[metric].error(predicted, measured)
    numbers, amplitudes = objective.physical(found.point)
    brdf = objective.variant.with_numbers(numbers).with_amplitudes(*amplitudes)
    parameters = _named(objective, amplitudes, numbers)
    errors = errors_of(objective.predicted(found.point), measured)
    spread: Spread = spread_of(objective, found.point)
    return Candidate(
        name,
        brdf,
        errors["plain"],
        parameters,
        found.converged,
        errors,
        held_out,
        _named(objective, spread.amplitudes, spread.numbers),
        _named(objective, spread.amplitude_intervals, spread.number_intervals),
    )


def _named(objective: Objective, amplitudes, numbers) -> dict:
    """Put amplitudes, one row a lobe, and numbers under the model's own names."""
    named = zip(objective.variant.amplitude_names, amplitudes, strict=True)
    listed = {name: np.asarray(value).tolist() for name, value in numbers.items()}
    return {name: np.asarray(part).tolist() for name, part in named} | listed


def _checked(measured: Measurements) -> Measurements:
    incoming, outgoing, values = (np.asarray(part, float) for part in measured)
    measured = Measurements(incoming, outgoing, values)
    if not (len(incoming) == len(outgoing) == len(values) and len(values) >= _FEWEST):
        raise ValueError(
            f"{len(incoming)} incoming and {len(outgoing)} outgoing directions with {len(values)} "
            f"values: give as many of each, and at least {_FEWEST}"
        )
    for name, directions in (("incoming", incoming), ("outgoing", outgoing)):
        if not (directions[:, 2] > 0).all():
            row = int(np.argmin(directions[:, 2] > 0))
            raise ValueError(f"{name}[{row}] is {directions[row]}: give directions with z > 0")
    if not np.where(measured.valid, values, 0).any():
        raise ValueError("no value is above zero: there is nothing that a model could be near to")
    return measured


@checked
def pairs_of(brdf: BRDF, size: int = 32, most: int = 2**13) -> Measurements:
    """Evaluate a BRDF at pairs of cells of Nusselt's square; raises as ``best_models`` does."""
    incoming, outgoing = _pairs_of_cells(size, most)
    values = np.asarray(_evaluate(brdf, incoming, outgoing), float)
    if not (np.isfinite(values).all() and values.any()):
        raise ValueError("a BRDF that is zero, or not finite, at some cells; mend its values")
    return Measurements(incoming, outgoing, values)


def _pairs_of_cells(
    size: int, most: int
) -> tuple[Float[np.ndarray, "pair 3"], Float[np.ndarray, "pair 3"]]:
    """List the directions of all pairs of cells, or of so many of them, evenly chosen."""
    cells = NUSSELT.cell_directions((size, size)).reshape(-1, 3)
    cells = cells[np.asarray(NUSSELT.covers(NUSSELT.centres((size, size)))).ravel()]
    count = len(cells) ** 2
    chosen = np.arange(count)
    if count > most:
        chosen = np.sort(np.random.default_rng(0).choice(count, most, replace=False))
    return cells[chosen // len(cells)], cells[chosen % len(cells)]
