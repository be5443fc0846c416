"""Which lobes of a bank the photographs ask for: how narrow they may be, and which of them count.

Lobes that are narrower than anything that the photographs show fit what is wrong with a few pixels
about a highlight, such as a bump or a pose that is off by a pixel, and predict other photographs
badly.  So photographs are held out, a fifth of them at a time, and predicted by banks whose
narrowest lobe is wider and wider.  The best is the one to fit.  Of its lobes those are kept that
some of these fits used.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from jaxrender.brdf import Bank
from jaxrender.imaging import estimate_noise
from jaxrender.inverse.leverage import draw, leverage
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.material_task import MaterialTask
from jaxrender.inverse.models import LinearisedModel
from jaxrender.inverse.observations import Observations, as_pixels
from jaxrender.inverse.passes import Begin, Stop, descend
from jaxrender.inverse.weights import deviations, with_misfit
from jaxrender.shapes import Bool, Float, Int

# Parts of the photographs that are held out in turn.
_FOLDS = 5
# The narrowest lobe is never wider than this.
_LEAST_GLOSSY = 0.3
# Pairs of a sample and a direction of light that are no work: sources alone have many samples.
_LITTLE_WORK = 20_000
# Added to the squares of columns of length one: neighbouring lobes are all but the same.
_RIDGE = 1e-10
# A lobe whose squares are this part of the largest is seen nowhere.
_UNSEEN = 1e-30
# Rounds of weights by the noise that is left.
_ROUNDS = 2


class Chosen(NamedTuple):
    """The task with the lobes that are kept, and where a fit of some samples ended."""

    task: MaterialTask
    stop: Stop


def choose_lobes(task: MaterialTask) -> Chosen:
    """Choose the lobes of a bank by some samples, and fit them to these.

    Where exposures are unknown no photograph predicts another: all lobes that fit are kept.
    """
    task = task._replace(settings=task.settings._replace(approximate=True))
    bank = task.variant
    assert isinstance(bank, Bank)
    observations, settings = task.observations, task.settings
    weight = leverage(observations, task.light, task.widths)
    count = max(settings.refine_samples, _LITTLE_WORK // _nodes_a_sample(task))
    some, _ = draw(observations, weight, count, settings.seed)
    model = task.integral(some, task.nodes(task.light, some, float(bank.sigma)))
    near = LinearisedModel.about(model, {})
    columns = np.stack([np.asarray(part, float) for part in near.at], axis=1)
    sums = _Sums.of(task, some, columns)
    used = _used(bank, sums, alone=task.unknowns.free_gains > 0)
    # The others have no room above zero: so banks of the same lobes share their programs.
    black = {lobe.name for lobe, uses in zip(bank.lobes, used) if not uses}
    names = np.repeat(task.unknowns.free_amplitudes, columns.shape[2])
    upper = np.array(task.problem.upper)
    upper[: len(names)][np.isin(names, list(black))] = 0
    problem = dataclasses.replace(task.problem, upper=upper)
    begin = Begin(settings.noise, None, task.unknowns.starts(1))
    stop = descend(problem, near, some, begin, settings)
    return Chosen(task._replace(problem=problem), stop)


class _Sums(NamedTuple):
    """Products of the weighted columns with one another and with the radiance, by photograph."""

    gram: Float[np.ndarray, "frame channel column column"]
    moments: Float[np.ndarray, "frame channel column"]
    squares: Float[np.ndarray, "frame channel"]

    @classmethod
    def of(
        cls,
        task: MaterialTask,
        some: Observations,
        columns: Float[np.ndarray, "sample column channel"],
    ) -> "_Sums":
        """Add up, weighed by the noise that a fit with all lobes leaves; kd as it is stated."""
        radiance, fixed = np.asarray(some.radiance, float), task.unknowns["kd"].fixed
        shares = np.sqrt(some.shares)[:, None]
        scale = float(np.sqrt(np.mean(radiance**2)))
        told = 0.0 if fixed is None else columns[:, 0] * np.asarray(fixed, float)
        if fixed is not None:
            columns = np.concatenate([np.zeros_like(columns[:, :1]), columns[:, 1:]], axis=1)
        weights = shares / scale * np.ones_like(radiance)
        frames = np.asarray(some.frame)
        even = as_pixels(some)
        for _ in range(_ROUNDS):
            found = cls._added(frames, columns, radiance - told, weights)
            predicted = told + np.einsum("skc,ck->sc", columns, _solved(found.total))
            noise = task.settings.noise
            if noise is None:
                left = (radiance - predicted)[even]
                noise = estimate_noise(left, predicted[even], some.rounding)
                noise = with_misfit(noise, predicted[even])
            weights = shares / deviations(noise, predicted, scale)
        return cls._added(frames, columns, radiance - told, weights)

    @classmethod
    def _added(
        cls,
        frames: Int[np.ndarray, "sample"],
        columns: Float[np.ndarray, "sample column channel"],
        radiance: Float[np.ndarray, "sample channel"],
        weights: Float[np.ndarray, "sample channel"],
    ) -> "_Sums":
        parts = []
        for frame in np.unique(frames):
            rows = frames == frame
            weighted = np.moveaxis(columns[rows] * weights[rows][:, None], 2, 0)
            measured = (radiance[rows] * weights[rows]).T
            parts.append(
                (
                    np.swapaxes(weighted, 1, 2) @ weighted,
                    np.einsum("csk,cs->ck", weighted, measured),
                    np.sum(measured**2, axis=1),
                )
            )
        return cls(*(np.stack(part) for part in zip(*parts)))

    @property
    def total(self) -> "_Sums":
        """Those of all photographs, as one."""
        return _Sums(*(np.sum(part, axis=0, keepdims=True) for part in self))

    def without(self, rows: Int[np.ndarray, "held"]) -> "_Sums":
        """Those of all photographs but some, as one."""
        return _Sums(
            *(np.sum(np.delete(part, rows, axis=0), axis=0, keepdims=True) for part in self)
        )


def _used(bank: Bank, sums: _Sums, *, alone: bool) -> Bool[np.ndarray, "lobe"]:
    """Mark the lobes that are used, of those that are wide enough, by any of the fits."""
    facets = np.array([lobe.width if lobe.about_mirror else np.inf for lobe in bank.lobes])
    tried = np.unique(facets[facets <= max(_LEAST_GLOSSY, facets.min())])
    photographs = len(sums.squares)
    if alone or photographs < 2:
        return np.any(_solved(sums.total)[:, 1:] > 0, axis=0)
    folds = [np.arange(photographs)[start::_FOLDS] for start in range(min(_FOLDS, photographs))]
    left, used = np.zeros(len(tried)), np.zeros((len(tried), len(facets)), bool)
    for at, width in enumerate(tried):
        kept = np.concatenate([[True], facets >= width])
        for fold in folds:
            weights = _solved(sums.without(fold), kept)
            left[at] += sum(_left(sums, int(row), weights) for row in fold)
            used[at] |= np.any(weights[:, 1:] > 0, axis=0)
        used[at] |= np.any(_solved(sums.total, kept)[:, 1:] > 0, axis=0)
    return used[int(np.argmin(left))]


def _solved(
    sums: _Sums, kept: Bool[np.ndarray, "column"] | None = None
) -> Float[np.ndarray, "channel column"]:
    """Find the weights of one set of sums by non-negative least squares, channel by channel."""
    (gram,), (moments,), _ = sums
    found = np.zeros_like(moments)
    for channel, (square, moment) in enumerate(zip(gram, moments)):
        size = np.diag(square)
        there = size > _UNSEEN * np.max(size)
        places = np.nonzero(there if kept is None else there & kept)[0]
        scale = 1 / np.sqrt(size[places])
        scaled = square[np.ix_(places, places)] * np.outer(scale, scale)
        root = np.linalg.cholesky(scaled + _RIDGE * np.eye(len(places)))
        target = np.linalg.solve(root, moment[places] * scale)
        found[channel, places] = nnls(root.T, target, maxiter=50 * len(places))[0] * scale
    return found


def _left(sums: _Sums, row: int, weights: Float[np.ndarray, "channel column"]) -> float:
    """What weights leave of one photograph: weighted squares."""
    gram, moments, squares = (part[row] for part in sums)
    explained = np.einsum("ck,ckl,cl->", weights, gram, weights)
    return float(explained - 2 * np.sum(weights * moments) + np.sum(squares))


def _nodes_a_sample(task: MaterialTask) -> int:
    """Count the directions from which light comes to a sample."""
    nodes = exact_nodes(task.light, None, float(task.variant.sigma))
    return sum(part.directions.shape[-2] for part in nodes)
