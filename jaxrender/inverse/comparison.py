"""Several models fitted to the same pixels, and judged by pixels that none of them has seen.

A model with more freedom always explains better what it was fitted to.  Its predictions of other
pixels show whether it is closer to the truth.  So a part of the samples is held out and every model
is fitted to the rest.  Each is scored by the exact integral on what was held out:

chi^2 = mean ((B - predicted) / deviation)^2

The mean is over pixels; a sample of a draw counts for all pixels that it stands for.  The deviation
is the same for all models, that of the noise left by the best.  So no model can take what it leaves
unexplained for noise.  Large residuals count as in the fit's own loss: if it is robust, a few
pixels in a highlight do not outweigh the others.  Under unknown light each model predicts by the
light that it has found.  Differences from the best come with their standard errors; what is less
than a few of them is no difference.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple

import jax.numpy as jnp
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
from jaxrender.inverse.known_light import KnownLight, exact_nodes
from jaxrender.inverse.material_task import SHADOWED_ANGLE_PER_SIGMA
from jaxrender.inverse.models import ExactModel
from jaxrender.inverse.observations import Observations, random_subset
from jaxrender.inverse.passes import FitSettings
from jaxrender.inverse.shadowing import concave, nodes_seen
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.inverse.weights import robust_weights
from jaxrender.shapes import Float

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

    ``behind`` is its chi-squared less that of the best, with its standard error.
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
    """The models in order, the best first, and how many samples were held out."""

    scores: tuple[Score, ...]
    held_out: int

    @property
    def best(self) -> Score:
        """The model that predicts best."""
        return self.scores[0]


def compare_models(
    observations: Observations,
    light: KnownLight,
    candidates: tuple[Candidate, ...],
    settings: FitSettings,
    held_out: float = 0.2,
    *,
    stage: Callable[[str], AbstractContextManager] = lambda name: nullcontext(),
    shape: Shape | None = None,
) -> Comparison:
    """Fit every candidate to the same samples and rank them by those that were held out.

    Raises ``ValueError`` for less than two candidates, a part outside (0, 1), and what ``fit_brdf``
    refuses.
    """
    _check_several(candidates)
    training, rest = divided(observations, held_out, settings.seed)
    fits = [
        fit_brdf(training, light, c.unknowns, c.variant, settings, stage, shape=shape)
        for c in candidates
    ]
    with stage("compare"):
        judged = [
            _Judged(
                candidate.name,
                fit,
                _predicted(fit, rest, light, shape),
                settings.noise or fit.final.noise,
            )
            for candidate, fit in zip(candidates, fits)
        ]
        return _ranked(judged, rest, settings.loss)


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
            _Judged(candidate.name, fit, predict(fit.brdf, fit.scene, rest, shape), fit.noise)
            for candidate, fit in zip(candidates, fits)
        ]
        return _ranked(judged, rest, settings.loss)


def _check_several(candidates: Sequence[Candidate] | Sequence[Asked]) -> None:
    if len(candidates) < 2:
        raise ValueError("a comparison needs two models or more")


class _Judged(NamedTuple):
    """A fitted model, what it predicts of the samples held out, and the noise that it left."""

    name: str
    fit: BRDFFit | Factorization
    predicted: Float[np.ndarray, "sample channel"]
    noise: NoiseModel


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
    scores = tuple(
        Score(
            judged[k].name,
            judged[k].fit,
            chi_squared[k],
            float(np.sqrt(squares[k] / _energy(measured, pixels))),
            *_mean_and_error(left[k] - left[order[0]], pixels),
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
    fit: BRDFFit, rest: Observations, light: KnownLight, shape: Shape | None
) -> Float[np.ndarray, "sample channel"]:
    """Predict samples by the exact integral with what a fit has found, unknown gains included."""
    shape = concave(shape)
    cells = None if shape is None else SHADOWED_ANGLE_PER_SIGMA
    nodes = exact_nodes(light, np.asarray(rest.frame), float(fit.brdf.width), cells)
    seen = nodes_seen(shape, rest, nodes)
    model = ExactModel(fit.brdf, rest.samples, nodes, seen)
    numbers = {name: jnp.asarray(value) for name, value in fit.brdf.numbers.items()}
    found = fit.parameters.value
    gains, frame = np.asarray(found.gains), np.asarray(rest.frame)
    gain = gains[frame, None] if len(gains) > 1 else 1.0
    amplitudes = jnp.asarray(fit.brdf.amplitudes)
    return float(found.scale) * gain * np.asarray(model.columns(numbers).times(amplitudes))


def _energy(
    values: Float[np.ndarray, "sample channel"], pixels: Float[np.ndarray, "sample"]
) -> float:
    """Sum the squares over the pixels that the samples stand for."""
    return float(np.sum(pixels[:, None] * values**2))


def _mean_and_error(
    values: Float[np.ndarray, "sample"], pixels: Float[np.ndarray, "sample"]
) -> tuple[float, float]:
    """Average over pixels; each sample was measured only once, however many it stands for."""
    mean = float(np.average(values, weights=pixels))
    return mean, float(np.linalg.norm(pixels * (values - mean)) / np.sum(pixels))
