"""Where a factorization stands, and the fit of everything that each of its rounds makes.

The photographs and what is known of the material make a ``Task``; guess, sources in use and weights
make a ``State``.  Weights start as radiance^-.7, so that highlights do not outweigh the rest while
the light is still crude.  They end as those of the noise found in the residuals.  Outliers count
less from the start (Huber's loss): else pixels on shadows' edges would add sources of their own.
"""

from functools import partial
from typing import Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.special import logit

from jaxrender.brdf import WIDTH_BOUNDS
from jaxrender.harmonics import band_limit_of, degrees
from jaxrender.imaging import NoiseModel, estimate_noise
from jaxrender.inverse.factorization.blocks import Measured
from jaxrender.inverse.factorization.joint import (
    DAMPING,
    Bounds,
    Descent,
    Joint,
    descend_jointly,
)
from jaxrender.inverse.factorization.projection import Solved
from jaxrender.inverse.factorization.response import (
    Guess,
    Response,
    specular_share,
)
from jaxrender.inverse.factorization.sight import Sight
from jaxrender.inverse.observations import Observations, as_pixels
from jaxrender.inverse.stated import Unknown
from jaxrender.inverse.weights import deviations, robust_weights
from jaxrender.shapes import Array, Bool, Float, Int, as_jax

# Where the search begins when nothing is known: both lobes of the same albedo, a wide lobe.
START_SIGMA, _START_MU = 0.25, 1.5
# The first weights are radiance to this power, of no less than this part of the mean radiance.
_COMPRESSION, _DARK = -0.7, 1e-3
# The relative residual that slow light alone is expected to leave.
_FIRST_MISFIT = 0.1
# Standard deviation over the median of magnitudes, of Gaussian noise.
_NORMAL_DEVIATION = 1.4826
# Coefficients of degree l are expected within this part of the mean light over sqrt(l (l + 1)).
_LEAST_LIGHT = 0.2


class FactorSettings(NamedTuple):
    """How a factorization is done; the defaults are those of the command line.

    ``band_limit`` is the degree to which slow light is followed.  None: 10, and farther where the
    photographs hold more than the model and it pays.  ``diagnose`` asks what would explain what is
    left beyond noise, where all pixels are given.  ``free`` names nuisances of the capture that are
    found along with material and light; ``auto`` frees what the diagnosis names.
    """

    band_limit: int | None = None
    most_sources: int = 48
    smoothness: float = 1.0
    refine: bool = True
    noise: NoiseModel | None = None
    loss: str = "huber"
    diagnose: bool = True
    free: tuple[str, ...] | Literal["auto"] = ()


class Known(NamedTuple):
    """What is known of the material beforehand.

    ``share`` is ks / (kd + ks) of each channel.  It is 0 or 1 where the material has one lobe.
    The width ``sigma`` and the index ``mu`` are fixed, or free within bounds.  None: free within
    the model's bounds.
    """

    share: tuple[float, ...] | None = None
    sigma: Unknown | None = None
    mu: Unknown | None = None


DEFAULTS = FactorSettings()
NOTHING_KNOWN = Known()


class Round(NamedTuple):
    """Where one round ended."""

    band_limit: int
    sources: int
    share: Float[np.ndarray, "channel"]
    sigma: float
    mu: float
    relative_rms: float


class Task(NamedTuple):
    """The fixed part of a factorization: photographs, response of the samples, what is known.

    ``sight`` tells which directions each sample sees; None where nothing is hidden.
    """

    observations: Observations
    response: Response
    sight: Sight | None = None
    known: Known = NOTHING_KNOWN
    settings: FactorSettings = DEFAULTS

    def take(self, index: Int[np.ndarray, "kept"]) -> "Task":
        """Keep the samples of the given indices."""
        return self._replace(
            observations=self.observations.take(index),
            response=self.response.take(index),
            sight=None if self.sight is None else self.sight.take(index),
        )

    @property
    def radiance(self) -> Float[np.ndarray, "sample channel"]:
        """What was measured."""
        return np.asarray(self.observations.radiance, float)

    @property
    def band_limit(self) -> int:
        """The degree to which slow light is followed."""
        return band_limit_of(self.response.slow_count)

    @property
    def sigma(self) -> Unknown:
        """What is known of the width."""
        return self.known.sigma or Unknown(None, *WIDTH_BOUNDS)

    @property
    def mu(self) -> Unknown:
        """What is known of the index."""
        index = self.response.variant.index
        own = index.searched
        bounds = [index.index_of(bound) for bound in (own.lowest, own.highest)]
        return self.known.mu or Unknown(None, bounds[0], bounds[1])

    @property
    def bounds(self) -> Bounds:
        """The bounds of both in the search."""
        return Bounds(_between(self.sigma), _between(self.mu))


class Lacking(NamedTuple):
    """What the dual model leaves out of every sample's response to slow light, near a lobe.

    ``columns`` are a constant, and derivatives by log sigma and log(mu - 1), which are ``lobe``.
    """

    columns: Float[Array, "sample 3 coefficient"]
    lobe: tuple[float, float]


class State(NamedTuple):
    """Where a factorization stands.

    ``weights`` are those of a sample that stands for one pixel.  ``level`` is the mean radiance of
    the light in each channel, ``lacking`` what the dual model leaves out, where that is known.
    ``settled`` says whether the last steps moved nothing any more.
    """

    guess: Guess
    active: Bool[np.ndarray, "source"]
    weights: Float[np.ndarray, "sample channel"]
    level: Float[np.ndarray, "channel"]
    lacking: Lacking | None = None
    joint: Joint | None = None
    rounds: tuple[Round, ...] = ()
    settled: bool = False


class Deviations(NamedTuple):
    """Residuals in standard deviations of the noise, these deviations, and the noise."""

    left: Float[np.ndarray, "sample channel"]
    deviation: Float[np.ndarray, "sample channel"]
    noise: NoiseModel


def begin(task: Task, sigma: float | None = None, misfit: float = _FIRST_MISFIT) -> State:
    """Start without sources, both lobes of the same albedo, at a stated width or the usual one.

    ``misfit`` is the relative error with which the photographs count as known.
    """
    known, radiance = task.known, task.radiance
    channels, sources = radiance.shape[1], task.settings.most_sources
    sigma = task.sigma.first(START_SIGMA) if sigma is None else sigma
    mu = task.mu.first(_START_MU)
    variant = task.response.variant
    energy = float(variant.with_roughness(sigma, None if variant.mu is None else mu).energy)
    even = np.full(channels, 1 / (1 + energy))
    share = even if known.share is None else np.asarray(known.share)
    guess = Guess(
        jnp.asarray(logit(share)),
        jnp.asarray(np.log(sigma)),
        jnp.asarray(np.log(mu - 1)),
        jnp.asarray(np.tile([0.0, 0.0, 1.0], (sources, 1))),
    )
    mean = np.average(radiance, axis=0, weights=task.observations.pixels)
    weights = np.maximum(radiance, _DARK * mean) ** _COMPRESSION
    weights = weights / (misfit * _rms(task, weights * radiance))
    return State(guess, np.zeros(sources, bool), weights, mean)


def _between(unknown: Unknown) -> tuple[float, float]:
    """Return the bounds of an unknown; those of a fixed one are its value."""
    if unknown.fixed is not None:
        return unknown.fixed[0], unknown.fixed[0]
    return unknown.lower, unknown.upper


def measured(task: Task, state: State) -> Measured:
    """Put target, weights and the light's penalty together; pixels count alike."""
    degree = degrees(task.band_limit)
    expected = task.settings.smoothness * np.sqrt(4 * np.pi) * state.level
    slow = (degree * (degree + 1))[:, None] / expected**2
    sources = np.zeros((len(state.active), slow.shape[1]))
    weights = state.weights * np.sqrt(task.observations.shares)[:, None]
    return Measured(task.radiance, weights, np.concatenate([slow, sources]))


def response_of(task: Task, state: State) -> Response:
    """Switch on the sources in use, where they are seen, and add what the dual model lacks."""
    lit = lit_of(task, state.active, state.guess)
    response = eqx.tree_at(lambda r: r.lit, task.response, lit)
    if state.lacking is None:
        return response
    return eqx.tree_at(lambda r: r.lacking, response, state.lacking.columns)


def lit_of(
    task: Task, active: Bool[np.ndarray, "source"], guess: Guess
) -> Float[Array, "sample source"]:
    """Say which samples the sources in use reach, past the object itself."""
    seen = np.ones((len(task.radiance), 1))
    if task.sight is not None:
        seen = np.asarray(task.sight.of(guess.directions), float)
    return as_jax(seen * active[None, :])


def free_unknowns(task: Task, state: State) -> Bool[np.ndarray, "unknown"]:
    """Mark the nonlinear unknowns that are searched for.

    Slow light alone hardly distinguishes a sharp lobe from a sharper one.  So roughness waits for
    the first sources.
    """
    known, channels = task.known, task.radiance.shape[1]
    seen_sharply = bool(state.active.any()) or bool(state.rounds)
    material = [known.share is None] * channels + [task.sigma.free and seen_sharply]
    material.append(task.mu.free and task.response.variant.mu is not None)
    own = 2 if state.guess.variance is None else 3
    return np.concatenate([np.array(material), np.tile(state.active, own)])


def descend(
    task: Task,
    state: State,
    steps: int,
    tolerance: float = 1e-4,
    damping: float = DAMPING,
    *,
    retraced: bool = False,
) -> State:
    """Fit everything with the sources in use, and switch off those that come out dark.

    Which samples the sources reach is traced once; with ``retraced`` it is traced for each step.
    """
    while True:
        response = response_of(task, state)
        joint = descend_jointly(
            response,
            state.guess,
            measured(task, state),
            free_unknowns(task, state),
            Descent(task.bounds, steps, tolerance, damping),
            partial(lit_of, task, state.active) if task.sight is not None and retraced else None,
        )
        light = np.asarray(joint.solved.light)
        state = state._replace(guess=joint.guess, joint=joint)
        dark = state.active & (light[response.slow_count :].sum(axis=1) <= 0)
        if not dark.any():
            break
        state = state._replace(active=state.active & ~dark)
    mean = np.abs(light[0]) / np.sqrt(4 * np.pi)
    return state._replace(level=np.maximum(mean, _LEAST_LIGHT * state.level))


def weigh_evenly(task: Task, state: State) -> State:
    """Scale the first weights so that chi-squared is one for each measurement.

    Under a robust loss outliers count less, and the scale is that of the rest.
    """
    assert state.joint is not None
    weights, loss = begin(task).weights, task.settings.loss
    left = weights * (task.radiance - np.asarray(state.joint.solved.predicted))
    if loss == "squares":
        return state._replace(weights=weights / _rms(task, left))
    deviation = _NORMAL_DEVIATION * np.median(np.abs(left[as_pixels(task.observations)]))
    return state._replace(weights=weights / deviation * robust_weights(left / deviation, loss))


def weigh_by_noise(task: Task, state: State) -> State:
    """Weigh by the noise given, or by that found in the residuals, and by the loss."""
    found = in_deviations(task, state)
    weights = robust_weights(found.left, task.settings.loss) / found.deviation
    return state._replace(weights=weights)


def in_deviations(task: Task, state: State, solved: Solved | None = None) -> Deviations:
    """Express residuals in standard deviations of the noise given, or else found in them.

    They are those of ``solved``, or of where the search stands.
    """
    if solved is None:
        assert state.joint is not None
        solved = state.joint.solved
    predicted = np.asarray(solved.predicted)
    left, even = task.radiance - predicted, as_pixels(task.observations)
    noise = task.settings.noise
    if noise is None:
        noise = estimate_noise(left[even], predicted[even], task.observations.rounding)
    deviation = deviations(noise, predicted, _rms(task, task.radiance))
    return Deviations(left / deviation, deviation, noise)


def round_of(task: Task, state: State) -> Round:
    """Sum up where a round ended."""
    assert state.joint is not None
    left = task.radiance - np.asarray(state.joint.solved.predicted)
    guess = state.guess
    metal = task.response.variant.mu is None
    return Round(
        task.band_limit,
        int(np.count_nonzero(state.active)),
        np.asarray(specular_share(guess)),
        float(jnp.exp(guess.sigma)),
        float("nan") if metal else 1 + float(jnp.exp(guess.mu)),
        _rms(task, left) / _rms(task, task.radiance),
    )


def _rms(task: Task, values: Float[np.ndarray, "sample channel"]) -> float:
    """The root of the mean square over the pixels that the samples stand for."""
    squares = np.mean(values**2, axis=1)
    return float(np.sqrt(np.average(squares, weights=task.observations.pixels)))
