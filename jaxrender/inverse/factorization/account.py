"""What a factorization knows and how well: material and light in a stated gauge, with error bars.

Photographs alone fix the product of light and reflectance in each channel.  The gauges:

``per-channel``
    kd + ks = 1 in each channel (T 6.4.4); light of each channel is scaled to match
``dielectric``
    one ks for all channels, since a dielectric's gloss has no colour; mean kd + ks = 1
``metal``
    the light's mean radiance is the same in all channels; mean kd + ks = 1

The covariance is that of least squares over all unknowns together, (J' W J + Lambda)^-1 times the
mean squared weighted residual and the loss's ``variance_factor``, carried to the parameters in
their own units.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics import band_limit_of, degrees, real_basis
from jaxrender.inverse.factorization.projection import System, reduced_system
from jaxrender.inverse.factorization.response import Guess, gloss_share
from jaxrender.inverse.factorization.state import (
    State,
    Task,
    free_unknowns,
    in_deviations,
    measured,
    response_of,
)
from jaxrender.inverse.uncertainty import Parameters, Uncertain, intervals
from jaxrender.inverse.weights import variance_factor
from jaxrender.lighting import DirectionalSources
from jaxrender.shapes import Array, Float

GAUGES = ("per-channel", "dielectric", "metal")
# The prior variance of an unknown's logarithm: it matters only where the data are silent.
_PRIOR_VARIANCE = 4.0


class RecoveredScene(NamedTuple):
    """The light of a factorization, in the gauge of its material: the slow part and the lamps.

    ``total`` are the coefficients of both together, of the slow part's degrees; ``told`` is the
    share of each degree that the photographs tell, from 0 to 1: the rest is what smooth light is
    expected to have.
    """

    slow: Float[np.ndarray, "coefficient channel"]
    slow_error: Float[np.ndarray, "coefficient channel"]
    sources: DirectionalSources
    energy_error: Float[np.ndarray, "source channel"]
    direction_error: Float[np.ndarray, "source"]
    total: Float[np.ndarray, "coefficient channel"]
    told: Float[np.ndarray, "degree"]


def account_of(task: Task, state: State, gauge: str) -> tuple[Uncertain, RecoveredScene]:
    """Put material and light into a gauge, with their errors.

    Raises ``ValueError`` for a gauge that is not in ``GAUGES``.
    """
    if gauge not in GAUGES:
        raise ValueError(f"gauge={gauge!r}: choose one of {', '.join(GAUGES)}")
    response, data = response_of(task, state), measured(task, state)
    solved, system = reduced_system(response, state.guess, data)
    left = state.weights * (state.target - np.asarray(solved.predicted))
    free = free_unknowns(task, state)
    used = int(np.count_nonzero(free)) + data.radiance.shape[1] * (
        response.slow_count + int(np.count_nonzero(state.active))
    )
    variance = float(np.sum(left**2)) / max(left.size - used, 1)
    variance *= variance_factor(in_deviations(task, state, solved)[0], task.settings.loss)
    covariance = variance * _inverse(system, free)
    light = np.asarray(solved.light)
    factor = gauge_factors(np.asarray(gloss_share(state.guess)), light[0], gauge)
    parameters = _parameters(task, state.guess, covariance, factor)
    errors = _light_errors(
        np.asarray(solved.normal), np.asarray(system.across), covariance, variance
    )
    told = _told(np.asarray(data.penalty)[: response.slow_count], errors, variance)
    return parameters, _scene(state, light, covariance, (errors, told, factor))


def _inverse(system: System, free: np.ndarray) -> Float[np.ndarray, "unknown unknown"]:
    """Invert the reduced curvature over what is free, with a prior so wide that it never shows."""
    curvature = np.asarray(system.curvature)[np.ix_(free, free)]
    found = np.zeros_like(np.asarray(system.curvature))
    found[np.ix_(free, free)] = np.linalg.inv(curvature + np.eye(len(curvature)) / _PRIOR_VARIANCE)
    return found


def gauge_factors(
    share: Float[np.ndarray, "channel"], mean: Float[np.ndarray, "channel"], gauge: str
) -> Float[np.ndarray, "channel"]:
    """What the reflectance of each channel is multiplied by, and its light divided."""
    if gauge == "per-channel":
        return np.ones_like(share)
    wanted = 1 / share if gauge == "dielectric" else np.abs(mean)
    return wanted / wanted.mean()


def _parameters(
    task: Task,
    guess: Guess,
    covariance: Float[np.ndarray, "unknown unknown"],
    factor: Float[np.ndarray, "channel"],
) -> Uncertain:
    channels = len(factor)
    metal = task.response.variant.mu is None

    def material(vector: Float[Array, "some"]) -> Parameters:
        share = jax.nn.sigmoid(vector[:channels])
        scale = jnp.asarray(factor)
        sigma = jnp.exp(vector[channels])
        mu = 1 + jnp.exp(vector[channels + 1])
        one = jnp.ones(())
        return Parameters((1 - share) * scale, share * scale, sigma, mu, one[None], one)

    vector = jnp.concatenate([guess.gloss, jnp.stack([guess.sigma, guess.mu])])
    slopes = jax.jacfwd(material)(vector)
    few = covariance[: channels + 2, : channels + 2]
    error = Parameters(
        *(np.sqrt(np.einsum("...i,ij,...j->...", s, few, s)) for s in map(np.asarray, slopes))
    )
    every = np.concatenate([np.reshape(s, (-1, channels + 2)) for s in slopes])
    if metal:
        every[2 * channels + 1] = 0
    value = Parameters(*(np.asarray(part, float) for part in material(vector)))
    if metal:
        value = value._replace(mu=np.asarray(np.nan))
        error = error._replace(mu=np.asarray(0.0))
    return intervals(value, error, every @ few @ every.T)


def _scene(state: State, light: np.ndarray, covariance: np.ndarray, parts: tuple) -> RecoveredScene:
    errors, told, gauge = parts
    slow = light.shape[0] - len(state.active)
    active = np.flatnonzero(state.active)
    order = active[np.argsort(-light[slow:][active].sum(axis=1))]
    directions = np.asarray(state.guess.directions)[order]
    energies = light[slow:][order] / gauge
    first = covariance.shape[0] - 2 * len(state.active) + order
    steps = np.diag(covariance)[first] + np.diag(covariance)[first + len(state.active)]
    coefficients = light[:slow] / gauge
    basis = np.asarray(real_basis(jnp.asarray(directions), int(np.sqrt(slow)) - 1))
    return RecoveredScene(
        coefficients,
        errors[:slow] / gauge,
        DirectionalSources(directions, energies),
        errors[slow:][order] / gauge,
        np.sqrt(steps),
        coefficients + basis.T @ energies,
        told,
    )


def _told(
    penalty: Float[np.ndarray, "coefficient channel"],
    errors: Float[np.ndarray, "part channel"],
    variance: float,
) -> Float[np.ndarray, "degree"]:
    """One less the variance that is left, in parts of the variance expected (1 / penalty)."""
    left = np.clip(penalty * errors[: len(penalty)] ** 2 / variance, 0, 1).mean(axis=1)
    degree = degrees(band_limit_of(len(left)))
    return 1 - np.bincount(degree, left) / np.bincount(degree)


def _light_errors(
    factors: Float[np.ndarray, "channel part part"],
    across: Float[np.ndarray, "channel part unknown"],
    covariance: Float[np.ndarray, "unknown unknown"],
    variance: float,
) -> Float[np.ndarray, "part channel"]:
    """Add what the light's own equations leave open to what the other unknowns bring in."""
    errors = []
    for factor, mixed in zip(factors, across):
        inverse = np.linalg.inv(factor)
        own = variance * np.einsum("rp,rp->p", inverse, inverse)
        moved = inverse.T @ (inverse @ mixed)
        errors.append(np.sqrt(own + np.einsum("pi,ij,pj->p", moved, covariance, moved)))
    return np.stack(errors, axis=-1)
