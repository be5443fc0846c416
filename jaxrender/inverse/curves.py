"""Curves of a material that several numbers describe together, with their bands.

Beside each stands the nearest one of a named model: of a distribution, GGX's or Beckmann's; of a
Fresnel curve, that of a dielectric or of a metal.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize_scalar

from jaxrender.brdf import Parametric
from jaxrender.brdf.distributions import Beckmann, TrowbridgeReitz
from jaxrender.brdf.fresnel import normalised_fresnel
from jaxrender.brdf.parametric import INDEX_BOUNDS, WIDTH_BOUNDS
from jaxrender.geometry import Components
from jaxrender.inverse.intervals import NORMAL_90, Uncertain
from jaxrender.shapes import Array, Float

# Angles in degrees: dense where a highlight is.
DEGREES = np.concatenate([np.arange(0, 10, 0.5), np.arange(10, 30, 1), np.arange(30, 90, 3)])
# A logarithm is known no better than this when the nearest model is looked for, and beyond this
# factor of uncertainty nothing is known of it.
_LEAST_ERROR, _MOST_ERROR = 0.02, 1.0


class Curve(NamedTuple):
    """A curve over ``DEGREES`` with its 90 % band, and the nearest one of a named model.

    ``nearest`` says which that is, and ``nearest_values`` are its.
    """

    name: str
    values: Float[np.ndarray, "angle"]
    lower: Float[np.ndarray, "angle"]
    upper: Float[np.ndarray, "angle"]
    nearest: str
    nearest_values: Float[np.ndarray, "angle"]


def reach_at_the_peak(curves: tuple[Curve, ...]) -> float:
    """By how much, of itself, the distribution may be off where it is above half its peak.

    It is the half width of the band in its logarithm; 0 where there is no such curve.
    """
    widest = 0.0
    for curve in curves:
        if curve.name == "distribution":
            high = curve.values > 0.5 * curve.values.max()
            widest = float(np.median(np.log(curve.upper / curve.lower)[high])) / 2
    return widest


def curves_of(brdf: Parametric, parameters: Uncertain) -> tuple[Curve, ...]:
    """Evaluate the curves of the numbers that were found; ``brdf`` says of which model.

    Most models have none.
    """
    angles = np.deg2rad(DEGREES)
    if not brdf.curves(angles):
        return ()
    found = parameters.value.numbers
    numbers = {one.name: jnp.asarray(found[one.name], float) for one in brdf.searched}

    def logarithms(numbers: Mapping[str, Array]) -> dict[str, Array]:
        curves = brdf.with_numbers(numbers).curves(angles)
        return {name: jnp.log(values) for name, values in curves.items()}

    at, slopes = logarithms(numbers), jax.jacfwd(logarithms)(numbers)
    labels, covariance = parameters.value.labels, parameters.covariance
    own = [name for name in numbers if name in labels]
    curves = []
    for name, log in at.items():
        error = np.zeros(len(DEGREES))
        if covariance is not None and own:
            moves = np.stack([np.asarray(slopes[name][one]) for one in own], axis=1)
            rows = [labels.index(one) for one in own]
            spread = np.einsum("ai,ij,aj->a", moves, covariance[np.ix_(rows, rows)], moves)
            error = np.sqrt(np.maximum(spread, 0))
        middle, reach = np.asarray(log), NORMAL_90 * error
        nearest, values = _nearest(name, middle, error)
        band = np.exp(middle - reach), np.exp(middle + reach)
        curves.append(Curve(name, np.exp(middle), *band, nearest, values))
    return tuple(curves)


def _nearest(
    name: str, log: Float[np.ndarray, "angle"], error: Float[np.ndarray, "angle"]
) -> tuple[str, Float[np.ndarray, "angle"]]:
    """Find the nearest curve of a named model, where this one is known."""
    weights = np.where(error < _MOST_ERROR, 1 / np.maximum(error, _LEAST_ERROR), 0)
    best: tuple[float, str, np.ndarray] | None = None
    for words, (low, high), curve in _NAMED[name]:

        def off(number: float, curve: Callable = curve) -> float:
            # In single precision a steep tail is 0: here it is but very small.
            values = np.maximum(np.asarray(curve(np.exp(number)), float), 1e-300)
            left = weights * (np.log(values) - log)
            return float(np.sum(left**2))

        found = minimize_scalar(off, bounds=(np.log(low), np.log(high)), method="bounded")
        number, cost = float(np.exp(found.x)), float(found.fun)
        if best is None or cost < best[0]:
            best = cost, words.format(number), np.asarray(curve(number), float)
    assert best is not None
    return best[1], best[2]


def _density(kind: type[TrowbridgeReitz] | type[Beckmann]) -> Callable:
    angles = np.deg2rad(DEGREES)
    tilted = Components(np.sin(angles), np.zeros_like(angles), np.cos(angles))
    return lambda sigma: np.asarray(kind(sigma).density(tilted))


def _fresnel(mu: float | None) -> Float[np.ndarray, "angle"]:
    return np.asarray(normalised_fresnel(mu, jnp.asarray(np.cos(np.deg2rad(DEGREES)))))


_NAMED = {
    "distribution": (
        ("ggx, sigma {:.3g}", WIDTH_BOUNDS, _density(TrowbridgeReitz)),
        ("beckmann, sigma {:.3g}", WIDTH_BOUNDS, _density(Beckmann)),
    ),
    "fresnel": (
        ("dielectric, mu {:.3g}", INDEX_BOUNDS, _fresnel),
        ("metal, the same at all angles", (1.0, 2.0), lambda _: _fresnel(None)),
    ),
}
