"""Values of a BRDF at scattered pairs of directions, and how far another BRDF is from them.

Metrics, w the weight of a pair, c = cos t_i, v what was measured and f what a model says:

``cosine-l1``   sum w c |f - v| / sum w c v: the share of reflected light that is in the wrong place
``cube-root``   sqrt(sum w (cbrt(c f) - cbrt(c v))^2 / sum w cbrt(c v)^2): four decades count alike,
                about as seen (Fores, Ferwerda and Gu, Toward a Perceptually Based Metric for BRDF
                Modeling, 2012)
``plain``       sqrt(sum w (f - v)^2 / sum w v^2): the brightest few decide

Pairs of a square's cells have equal weights, which makes sums integrals over both projected solid
angles.  Of measurements each counts once, wherever they crowd.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.parameters import refuse_unlisted
from jaxrender.shapes import AnyArray, Array, Bool, Float, checked

# The root of zero has no derivative: values are told apart from zero by this part of their mean.
_NEARLY_ZERO = 1e-6


class Measurements(NamedTuple):
    """Local unit directions away from the surface, +Z the normal; values in 1/sr.

    Values that are negative or not finite were not measured.
    """

    incoming: Float[np.ndarray, "pair 3"]
    outgoing: Float[np.ndarray, "pair 3"]
    values: Float[np.ndarray, "pair channel"]

    @property
    def valid(self) -> Bool[np.ndarray, "pair channel"]:
        """Say which values were measured."""
        return np.isfinite(self.values) & (self.values >= 0)

    @checked
    def rows(self, chosen: Bool[np.ndarray, "pair"]) -> "Measurements":
        """Keep some of the pairs."""
        return Measurements(*(part[chosen] for part in self))


class Metric(NamedTuple):
    """A name, what of a value times the cosine counts, the power of its error, and a sentence."""

    name: str
    of: Callable[[AnyArray, AnyArray, float | AnyArray], Array]
    power: int
    meaning: str

    @checked
    def error(
        self,
        found: Float[AnyArray, "pair channel"],
        measured: Measurements,
        weights: Float[AnyArray, "pair"] | None = None,
    ) -> float:
        """Measure the relative error of values found at the pairs, all channels together."""
        valid = measured.valid
        share = np.ones(len(valid)) if weights is None else np.asarray(weights, float)
        values, cosine = np.where(valid, measured.values, 0), measured.incoming[:, 2:]
        least = nearly_zero(values)
        ours, theirs = (
            np.asarray(self.of(v, cosine, least)) for v in (np.maximum(found, 0), values)
        )
        missed = np.where(valid, np.abs(ours - theirs), 0) ** self.power
        whole = np.where(valid, np.abs(theirs), 0) ** self.power
        total = np.sum(share[:, None] * whole)
        if not total > 0:
            return 0.0
        return float((np.sum(share[:, None] * missed) / total) ** (1 / self.power))


def _plain(values: AnyArray, _: AnyArray, __: float | AnyArray) -> Array:
    return jnp.asarray(values)


def _times_cosine(values: AnyArray, cosine: AnyArray, _: float | AnyArray) -> Array:
    return jnp.asarray(values) * cosine


def _cube_root(values: AnyArray, cosine: AnyArray, least: float | AnyArray) -> Array:
    return jnp.cbrt(jnp.asarray(values) * cosine + least)


METRICS: dict[str, Metric] = {
    metric.name: metric
    for metric in (
        Metric("cube-root", _cube_root, 2, "rms of the cube root, times the cosine"),
        Metric("cosine-l1", _times_cosine, 1, "mean of the absolute error, times the cosine"),
        Metric("plain", _plain, 2, "rms of the value itself"),
    )
}


def metric_named(name: str) -> Metric:
    """Find a metric; ``ValueError`` lists them where there is none of the name."""
    refuse_unlisted("metric", name, tuple(METRICS))
    return METRICS[name]


def nearly_zero(values: Float[np.ndarray, "pair channel"]) -> float:
    """Say what is no more than zero beside these values."""
    return _NEARLY_ZERO * float(np.mean(values)) if values.size else 0.0


@checked
def errors_of(
    found: Float[AnyArray, "pair channel"],
    measured: Measurements,
    weights: Float[AnyArray, "pair"] | None = None,
) -> dict[str, float]:
    """Measure the error in every metric."""
    return {name: metric.error(found, measured, weights) for name, metric in METRICS.items()}
