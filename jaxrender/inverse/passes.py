"""One pass of a fit: least squares, noise and robust weights in turn, until they agree.

``fit_in_rounds`` works on a model that is cheap to evaluate; ``descend`` on an expensive one, by
working on its linearisation again and again.
"""

from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.imaging import NoiseModel, estimate_noise
from jaxrender.inverse.elimination import Data, Few, Fit, Problem, cost_at
from jaxrender.inverse.models import LinearisedModel, Model
from jaxrender.inverse.observations import Observations, as_pixels
from jaxrender.inverse.parameters import Parameters, to_parameters
from jaxrender.inverse.search import search
from jaxrender.inverse.weights import deviations, noise_settled, robust_weights, with_misfit
from jaxrender.reflection import ViewFilter
from jaxrender.shapes import Float

# A descent gives up after so many steps.  One that is in vain is halved; from the second on it is
# damped, by this part of the curvature and so many times more or less as it fails or succeeds.
_STEPS, _HALVED = 40, 2
_FIRST_DAMPING, _DAMPED_MORE, _LEAST_DAMPING = 0.3, 5.0, 0.01
# After so many steps weights no longer follow the prediction: far from the truth they may go round.
_FOLLOWED = 12
# A step swings back when it undoes this part of the one before.
_SWINGS = 0.5
# A step that gains less than this of chi-squared / 2 came from within .02 standard errors of the
# end, and has halved that many times over.
_LEAST_GAIN = 2e-4
# Costs are compared up to this.
_ROUNDING = 1e-9
# Reweighting rounds: the noise settles in two or three, a robust loss in a few more.
_ROUNDS = {"squares": 3, "huber": 7, "cauchy": 7}


# The name of the transfer that keeps the azimuthal mean of the lobe about R.
_MEAN = "exit-cosine"


class FitSettings(NamedTuple):
    """How a fit is done; the defaults are those of the command line.

    ``free`` are nuisances that are found with the material, or ``"auto"``.  ``approximate`` says
    that the model is only near the truth, so that what it leaves is not only noise.
    """

    split: str | float = "auto"
    band_limit: int | None = None
    transfer: str = _MEAN
    refine: bool = True
    refine_samples: int = 2000
    method: str = "variable-projection"
    loss: str = "squares"
    noise: NoiseModel | None = None
    starts: int = 8
    seed: int = 0
    interreflection: bool = False
    diagnose: bool = True
    free: tuple[str, ...] | Literal["auto"] = ()
    approximate: bool = False

    @property
    def split_transfer(self) -> str:
        """How a split supposes its slow part to be filtered: never worse than the default.

        The thesis's own transfers are kept as they are to be compared, not made up for by sources.
        """
        return _MEAN if ViewFilter.named(self.transfer) is None else self.transfer


DEFAULTS = FitSettings()


class Stop(NamedTuple):
    """Where one pass ended: the fit, the observations, weights and model it ended with."""

    fit: Fit
    problem: Problem
    model: Model
    data: Data
    observations: Observations
    noise: NoiseModel

    @property
    def relative_rms(self) -> float:
        """sqrt(sum r^2 / sum B^2) over the pixels that the samples stand for, unweighted."""
        radiance, pixels = np.asarray(self.data.radiance), self.observations.pixels[:, None]
        squares = pixels * (radiance - np.asarray(self.fit.predicted)) ** 2
        return float(np.sqrt(np.sum(squares) / np.sum(pixels * radiance**2)))

    def onward(self, predicted: Float[np.ndarray, "sample channel"] | None) -> "Begin":
        """Let another pass begin here; ``predicted`` is the prediction of its samples, if known."""
        return Begin(self.noise, predicted, np.asarray(self.fit.solution.point)[None])


class Begin(NamedTuple):
    """Where a pass begins: the noise and the prediction known so far, and the starting points."""

    noise: NoiseModel | None
    predicted: Float[np.ndarray, "sample channel"] | None
    starts: Float[np.ndarray, "start unknown"]


def fit_in_rounds(
    problem: Problem,
    model: Model,
    observations: Observations,
    begin: Begin,
    settings: FitSettings,
    few: Few | None = None,
) -> Stop:
    """Fit, estimate the noise from what is left, weigh by it (and by the loss), fit again.

    Of many samples the search begins with ``few``.
    """
    radiance = np.asarray(observations.radiance)
    share = np.sqrt(observations.shares)[:, None].astype(radiance.dtype)
    scale = float(np.sqrt(np.mean(radiance**2)))
    noise, predicted = begin.noise, begin.predicted
    starts = problem.unknowns.restarts(begin.starts)
    even = as_pixels(observations)
    settled = settings.noise or NoiseModel(0.0, 0.0)
    weights = np.full_like(radiance, 1 / scale) * share
    # A prior counts beside what is weighed by its noise.
    weighed = problem.without_priors
    for turn in range(_ROUNDS[settings.loss]):
        if noise is not None and predicted is not None:
            weighed, weights = problem, 1 / deviations(noise, predicted, scale)
            weights *= share * robust_weights((radiance - predicted) * weights, settings.loss)
        data = Data(radiance, weights, np.asarray(observations.frame))
        fit = search(weighed, model, data, starts, settings.method, few)
        predicted = np.asarray(fit.predicted)
        starts = np.asarray(fit.solution.point)[None]
        before, settled = noise, settings.noise
        if settled is None:
            left = (radiance - predicted)[even]
            settled = estimate_noise(left, predicted[even], observations.rounding)
            if settings.approximate:
                settled = with_misfit(settled, predicted[even])
        noise = settled
        if turn == 0 or settings.loss != "squares" or before is None:
            continue
        if noise_settled(before, settled, predicted):
            break
    return Stop(fit, problem, model, data, observations, settled)


def descend(
    problem: Problem,
    model: Model,
    observations: Observations,
    begin: Begin,
    settings: FitSettings,
    tolerance: float = 1e-5,
) -> Stop:
    """Minimise over an expensive model: Levenberg-Marquardt on its linearisation, again and again.

    The model and its derivatives are evaluated once a step; everything else, the noise and the
    weights included, is solved to the end on the linearised columns.  A step that makes the true
    residual larger is halved; where that is in vain, too, the next steps are damped.  Ends when no
    search variable moves by more than ``tolerance``, or when a step has gained nothing that noise
    could tell, as where a parameter is at its bound or the data are silent about it.  The first of
    ``begin.starts`` is where it begins.  Weights that follow the prediction for many steps are then
    those of the measured radiance, and stay.
    """
    noise, predicted, point = settings.noise or begin.noise, begin.predicted, begin.starts[0]
    before: _Step | None = None
    in_vain, damping, onward = 0, 0.0, None
    kept: Data | None = None
    for turn in range(_STEPS):
        physical = problem.unknowns.unpack(jnp.asarray(point))
        near = LinearisedModel.about(model, physical.numbers, problem.unknowns.free_numbers)
        gain = np.inf
        if turn == _FOLLOWED and before is not None:
            kept = _by_measured(before.stop, settings)
            before, in_vain, damping, onward = None, 0, 0.0, None
        if before is not None:
            gain = before.cost - _cost(problem, near, before.stop.data, point)
        if before is not None and gain < -_ROUNDING * before.cost:
            in_vain, gain = in_vain + 1, np.inf
            if in_vain < _HALVED:
                point = problem.unknowns.between(point, before.point)
                continue
            # Once more from where the last step began.
            point, near, onward = before.point, before.near, None
            damping = max(_DAMPED_MORE * damping, _FIRST_DAMPING)
        else:
            in_vain, damping = 0, damping / _DAMPED_MORE
            damping = damping if damping > _LEAST_DAMPING else 0.0
        begin = Begin(noise, predicted, point[None])
        stop = _solved(problem, near, observations, begin, settings, damping, kept)
        before = _Step(point, near, stop, _cost(problem, near, stop.data, point))
        noise, predicted = stop.noise, np.asarray(stop.fit.predicted)
        point = np.asarray(stop.fit.solution.point)
        if gain < _LEAST_GAIN or np.all(np.abs(point - before.point) < tolerance):
            return stop
        # Weights follow the prediction: what swings about its end is met half-way.
        onward, step = point - before.point, onward
        if step is not None and onward @ step < -_SWINGS * (step @ step):
            point = problem.unknowns.between(point, before.point)
    assert before is not None
    return _not_converged(before.stop)


def _solved(
    problem: Problem,
    near: LinearisedModel,
    observations: Observations,
    begin: Begin,
    settings: FitSettings,
    damping: float,
    kept: Data | None,
) -> Stop:
    """Solve a linearisation to the end, and where it is damped again, held near its place.

    ``kept`` are data whose weights stay as they are.
    """

    def solved(posed: Problem, begin: Begin) -> Stop:
        if kept is None or begin.noise is None:
            return fit_in_rounds(posed, near, observations, begin, settings)
        fit = search(posed, near, kept, posed.unknowns.restarts(begin.starts), settings.method)
        return Stop(fit, posed, near, kept, observations, begin.noise)

    stop = solved(problem, begin)
    if not damping:
        return stop
    held = problem.damped(near, stop.data, stop.fit.linear, damping)
    again = Begin(stop.noise, np.asarray(stop.fit.predicted), begin.starts)
    return solved(held, again)._replace(problem=problem)


def _by_measured(stop: Stop, settings: FitSettings) -> Data:
    """Weigh the data of a pass by its noise at the measured radiance, and by the loss."""
    radiance = np.asarray(stop.data.radiance)
    scale = float(np.sqrt(np.mean(radiance**2)))
    share = np.sqrt(stop.observations.shares)[:, None].astype(radiance.dtype)
    weights = 1 / deviations(stop.noise, radiance, scale)
    left = (radiance - np.asarray(stop.fit.predicted)) * weights
    return stop.data._replace(weights=weights * share * robust_weights(left, settings.loss))


def in_deviations(stop: Stop) -> Float[np.ndarray, "sample channel"]:
    """What a pass has left unexplained, in standard deviations of its noise."""
    radiance, predicted = np.asarray(stop.data.radiance), np.asarray(stop.fit.predicted)
    scale = float(np.sqrt(np.mean(radiance**2)))
    return (radiance - predicted) / deviations(stop.noise, predicted, scale)


def values_of(stop: Stop) -> Parameters:
    """Put the end of a pass into the material's own units."""
    return to_parameters(stop.problem, stop.fit.solution.point, stop.fit.linear.eliminated)


class _Step(NamedTuple):
    """One linearisation: where, what it led to, and the true cost there."""

    point: Float[np.ndarray, "unknown"]
    near: LinearisedModel
    stop: Stop
    cost: float


def _cost(problem: Problem, model: Model, data: Data, point: Float[np.ndarray, "unknown"]) -> float:
    """Weigh up a model exactly at a point: half of chi-squared."""
    return float(cost_at(problem, model, data, jnp.asarray(point)))


def _not_converged(stop: Stop) -> Stop:
    solution = stop.fit.solution._replace(converged=jnp.zeros((), bool))
    return stop._replace(fit=stop.fit._replace(solution=solution))
