"""Several models fitted to the same pixels, and judged by pixels that none of them has seen.

A model with more freedom always explains better what it was fitted to.  Its predictions of other
pixels show whether it is closer to the truth.  So a part of the samples is held out and every model
is fitted to the rest.  Each is scored by the exact integral on what was held out:

chi^2 = mean ((B - predicted) / deviation)^2

Under known light the pixels of each photograph are predicted by the fit to the other photographs
(``left_out``): what is wrong with one photograph alone is nothing that a model may learn from it.
The mean is over pixels; a sample of a draw counts for all pixels that it stands for.  The deviation
is the same for all models, that of the noise left by the best.  So no model can take what it leaves
unexplained for noise.  Large residuals count as in the fit's own loss: if it is robust, a few
pixels in a highlight do not outweigh the others.  Under unknown light each model predicts by the
light that it has found.  Differences from the best come with their standard errors, over whole
photographs where there are enough.  The simplest model within one of them is kept; what is less
than a few of them is no difference.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.geometry import Shape
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.brdf import BRDFFit, fit_brdf
from jaxrender.inverse.factorization import (
    Factorization,
    FactorSettings,
    Known,
    Round,
    factorize,
    predict,
)
from jaxrender.inverse.factorization.state import NOTHING_KNOWN
from jaxrender.inverse.forecast import weights_of
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.left_out import FEWEST_PHOTOGRAPHS, predicted_left_out
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.material_task import SHADOWED_ANGLE_PER_SIGMA
from jaxrender.inverse.models import ExactModel
from jaxrender.inverse.observations import Observations, random_subset
from jaxrender.inverse.passes import FitSettings
from jaxrender.inverse.shadowing import concave, nodes_seen
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.inverse.weights import robust_weights
from jaxrender.shapes import Float, Int

# The exact integral of so many samples shows a difference of a per cent in chi-squared.
_MOST_HELD_OUT = 2000
# A model is worse than the best when it is this many standard errors behind.
_TOLD_APART = 3.0


class Candidate(NamedTuple):
    """A model to be fitted: its name, the lobe (its numbers do not matter), what is unknown."""

    name: str
    variant: Parametric
    unknowns: Unknowns


class Asked(NamedTuple):
    """A model for a factorization: its name, the lobe, and what is known of its material."""

    name: str
    variant: Parametric
    known: Known = NOTHING_KNOWN


class Score(NamedTuple):
    """How well one model predicts what was held out.

    ``behind`` is its chi-squared less the lowest, with its standard error.
    """

    name: str
    fit: BRDFFit | Factorization
    chi_squared: float
    relative_rms: float
    behind: float
    behind_error: float

    @property
    def told_apart(self) -> bool:
        """Whether the held-out samples show that the best model is better."""
        return self.behind > _TOLD_APART * self.behind_error


class Comparison(NamedTuple):
    """The model that is kept, then all others by what they predict; how many samples were held out.

    Kept is the simplest of those that are within one standard error of the one that predicts best.
    """

    scores: tuple[Score, ...]
    held_out: int

    @property
    def best(self) -> Score:
        """The model that is kept."""
        return self.scores[0]


def compare_models(
    observations: Observations,
    light: KnownLight,
    candidates: tuple[Candidate, ...],
    settings: FitSettings,
    held_out: float = 0.2,
    *,
    ladder: bool = False,
    stage: Callable[[str], AbstractContextManager] = lambda name: nullcontext(),
    shape: Shape | None = None,
) -> Comparison:
    """Fit every candidate to the same samples and rank them by those that were held out.

    ``ladder`` says that the candidates go from simple to rich, and that the next is not tried
    where the last has gained nothing.

    Raises ``ValueError`` for less than two candidates, a part outside (0, 1), and what ``fit_brdf``
    refuses.
    """
    _check_several(candidates)
    training, rest = divided(observations, held_out, settings.seed)
    judged: list[_Judged] = []
    for candidate in candidates:
        fit = fit_brdf(
            training, light, candidate.unknowns, candidate.variant, settings, stage, shape=shape
        )
        with stage("compare"):
            predicted = _predicted(fit, candidate.variant, rest, light, shape)
            noise = settings.noise or fit.final.noise
            judged.append(_Judged(candidate.name, fit, predicted, noise, _size(fit)))
            ranked = _ranked(judged, rest, settings.loss)
        if ladder and ranked.best.name != candidate.name:
            break
    return ranked


def compare_factorizations(
    observations: Observations,
    candidates: tuple[Asked, ...],
    settings: FactorSettings,
    held_out: float = 0.2,
    seed: int = 0,
    *,
    gauge: str = "per-channel",
    shape: Shape | None = None,
    pool: Observations | None = None,
    stage: Callable[[str], AbstractContextManager] = lambda name: nullcontext(),
    watch: Callable[[Round], None] = lambda round_: None,
) -> Comparison:
    """Compare models under unknown light; raises the same, and what ``factorize`` refuses.

    ``pool`` are all pixels: they tell every fit its noise, and are not fitted to.
    """
    _check_several(candidates)
    training, rest = divided(observations, held_out, seed)
    fits = [
        factorize(
            training,
            c.variant,
            settings,
            c.known,
            gauge=gauge,
            shape=shape,
            pool=pool,
            stage=stage,
            watch=watch,
        )
        for c in candidates
    ]
    with stage("compare"):
        judged = [
            _Judged(
                candidate.name,
                fit,
                predict(fit.brdf, fit.scene, rest, shape),
                fit.noise,
                _size(fit),
            )
            for candidate, fit in zip(candidates, fits)
        ]
        return _ranked(judged, rest, settings.loss)


def _check_several(candidates: Sequence[Candidate] | Sequence[Asked]) -> None:
    if len(candidates) < 2:
        raise ValueError("a comparison needs two models or more")


class _Judged(NamedTuple):
    """A fitted model, what it predicts of the samples held out, and the noise that it left.

    ``size`` is how many numbers it has found.
    """

    name: str
    fit: BRDFFit | Factorization
    predicted: Float[np.ndarray, "sample channel"]
    noise: NoiseModel
    size: int = 0


def _size(fit: BRDFFit | Factorization) -> int:
    """Count the numbers of the material that were found and have an error."""
    errors = fit.parameters.standard_error
    parts = (*errors.amplitudes.values(), *errors.numbers.values())
    return sum(int(np.count_nonzero(np.asarray(part) > 0)) for part in parts)


def _ranked(judged: Sequence[_Judged], rest: Observations, loss: str) -> Comparison:
    """Rank fits by their predictions, all weighed by the noise of the nearest.

    Each sample counts as often as it stands for pixels.
    """
    measured, pixels = np.asarray(rest.radiance), rest.pixels
    squares = [_energy(measured - one.predicted, pixels) for one in judged]
    nearest = judged[int(np.argmin(squares))]
    weights = weights_of(nearest.noise, nearest.predicted)
    deviations = [(measured - one.predicted) * weights for one in judged]
    left = [np.mean((robust_weights(r, loss) * r) ** 2, axis=1) for r in deviations]
    chi_squared = [float(np.average(one, weights=pixels)) for one in left]
    order = sorted(range(len(judged)), key=chi_squared.__getitem__)
    behind = [_mean_and_error(one - left[order[0]], pixels, np.asarray(rest.frame)) for one in left]
    near = [k for k in order if behind[k][0] <= behind[k][1]]
    kept = min(near, key=lambda k: judged[k].size)
    order = [kept, *(k for k in order if k != kept)]
    scores = tuple(
        Score(
            judged[k].name,
            judged[k].fit,
            chi_squared[k],
            float(np.sqrt(squares[k] / _energy(measured, pixels))),
            *behind[k],
        )
        for k in order
    )
    return Comparison(scores, rest.count)


class Divided(NamedTuple):
    """Samples to fit models to, and samples to judge them by."""

    training: Observations
    held_out: Observations


def divided(observations: Observations, held_out: float, seed: int) -> Divided:
    """Draw at random what is held out; ``ValueError`` for a part that leaves nothing on a side."""
    count = round(observations.count * held_out) if 0 < held_out < 1 else 0
    if not 0 < count < observations.count:
        raise ValueError(
            f"held_out={held_out} of {observations.count} samples: give a part between 0 and 1 "
            "that leaves samples on both sides"
        )
    order = np.random.default_rng(seed).permutation(observations.count)
    training, rest = (observations.take(np.sort(p)) for p in (order[count:], order[:count]))
    return Divided(training, random_subset(rest, _MOST_HELD_OUT, seed))


def _predicted(
    fit: BRDFFit,
    variant: Parametric,
    rest: Observations,
    light: KnownLight,
    shape: Shape | None,
) -> Float[np.ndarray, "sample channel"]:
    """Predict samples by the exact integral, those of a photograph by the fit to the others."""
    shape = concave(shape)
    cells = None if shape is None else SHADOWED_ANGLE_PER_SIGMA
    nodes = exact_nodes(light, rest, float(fit.brdf.width), cells)
    seen = nodes_seen(shape, rest, nodes)
    return predicted_left_out(fit.final, ExactModel(variant, rest.samples, nodes, seen), rest)


def _energy(
    values: Float[np.ndarray, "sample channel"], pixels: Float[np.ndarray, "sample"]
) -> float:
    """Sum the squares over the pixels that the samples stand for."""
    return float(np.sum(pixels[:, None] * values**2))


def _mean_and_error(
    values: Float[np.ndarray, "sample"],
    pixels: Float[np.ndarray, "sample"],
    frame: Int[np.ndarray, "sample"],
) -> tuple[float, float]:
    """Average over pixels; samples of one photograph may err together.

    Each sample was measured only once, however many it stands for.
    """
    mean = float(np.average(values, weights=pixels))
    off = pixels * (values - mean)
    photographs, place = np.unique(frame, return_inverse=True)
    count = len(photographs)
    if count >= FEWEST_PHOTOGRAPHS:
        off = np.sqrt(count / (count - 1)) * np.bincount(place, off)
    return mean, float(np.linalg.norm(off) / np.sum(pixels))
