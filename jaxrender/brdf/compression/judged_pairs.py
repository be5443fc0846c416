"""Pairs of directions by which one BRDF is judged by another, and errors with their own error.

Random pairs spread evenly over the squares hardly ever meet a narrow lobe, so that an error by
them is luck.  Here outgoing directions are cosine-weighted, incoming ones a mixture: of
cosine-weighted, and mirrored by a half vector of GGX's distribution of one of several widths,

    p(w_i | w_o) = s cos t_i / pi + (1 - s) / K sum over k of D_k(h) cos t_h / (4 w_o . h),

which has a width near any lobe's about the mirror direction.  Weighted by 1 / p, sums are integrals
over incoming solid angle and outgoing projected one.  Errors are ratios of sums, and their standard
errors those of ratios.  Scattered measurements judge as they are, each counted once.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.brdf.tables.measurements import METRICS, Measurements, nearly_zero
from jaxrender.brdf.tables.mirror_lobes import WIDTHS, mirror_density
from jaxrender.shapes import Float

COUNT = 1 << 17
_FROM_DISC = 0.3


class Pairs(NamedTuple):
    """Directions [pair, 3], and the inverse of their density."""

    incoming: Float[np.ndarray, "pair 3"]
    outgoing: Float[np.ndarray, "pair 3"]
    weights: Float[np.ndarray, "pair"]


class Estimate(NamedTuple):
    """A relative error, and the standard error of it."""

    value: float
    deviation: float


def pairs_about_mirrors(count: int = COUNT, seed: int = 1) -> Pairs:
    """Draw pairs by the mixture; those that would be below the horizon weigh nothing."""
    rng = np.random.default_rng(seed)
    outgoing = _above(np.sqrt(rng.random(count)), rng.random(count))
    incoming = _above(np.sqrt(rng.random(count)), rng.random(count))
    which = rng.integers(len(WIDTHS), size=count)
    chosen, part = np.array(WIDTHS)[which], rng.random(count)
    # GGX's distribution of the tilt: tan^2 = width^2 u / (1 - u).
    tilt = np.arctan(chosen * np.sqrt(part / (1 - part)))
    half = _above(np.sin(tilt), rng.random(count))
    mirrored = 2 * np.sum(half * outgoing, axis=1)[:, None] * half - outgoing
    from_disc = rng.random(count) < _FROM_DISC
    incoming = np.where(from_disc[:, None], incoming, mirrored)
    density = density_about_mirrors(incoming, outgoing)
    above = (incoming[:, 2] > 0) & (outgoing[:, 2] > 0)
    # Those below stay as pairs that count for nothing: sums are over all that were drawn.
    incoming = np.where(above[:, None], incoming, [0.0, 0.0, 1.0])
    return Pairs(incoming, outgoing, np.where(above, np.pi / np.where(above, density, 1), 0))


def density_about_mirrors(
    incoming: Float[np.ndarray, "pair 3"], outgoing: Float[np.ndarray, "pair 3"]
) -> Float[np.ndarray, "pair"]:
    """Evaluate the density of incoming directions per steradian, given the outgoing ones."""
    disc = np.maximum(incoming[:, 2], 0) / np.pi
    lobes = np.asarray(mirror_density(incoming, outgoing), float)
    return _FROM_DISC * disc + (1 - _FROM_DISC) * lobes


def judged(
    found: Float[np.ndarray, "pair channel"],
    truth: Measurements,
    weights: Float[np.ndarray, "pair"] | None = None,
) -> dict[str, Estimate]:
    """Measure relative errors in every metric of ``measurements``, each with its standard error.

    The plain one weighs pairs by cos t_i besides: it is the rms over both squares.
    """
    share = np.ones(len(found)) if weights is None else weights
    valid, cosine = truth.valid, truth.incoming[:, 2:]
    values = np.where(valid, truth.values, 0)
    least, estimates = nearly_zero(values), {}
    for name, metric in METRICS.items():
        counted = share[:, None] * valid
        if name == "plain" and weights is not None:
            counted = counted * cosine
        ours, theirs = (
            np.asarray(metric.of(v, cosine, least)) for v in (np.maximum(found, 0), values)
        )
        missed = np.sum(counted * np.abs(ours - theirs) ** metric.power, axis=1)
        whole = np.sum(counted * np.abs(theirs) ** metric.power, axis=1)
        total = float(np.sum(whole))
        ratio = float(np.sum(missed)) / total if total > 0 else 0.0
        spread = float(np.sqrt(np.sum((missed - ratio * whole) ** 2))) / total if total > 0 else 0.0
        value = ratio ** (1 / metric.power)
        slope = value / (metric.power * ratio) if ratio > 0 else 0.0
        estimates[name] = Estimate(value, slope * spread)
    return estimates


def _above(
    sine: Float[np.ndarray, "pair"], turn: Float[np.ndarray, "pair"]
) -> Float[np.ndarray, "pair 3"]:
    azimuth = 2 * np.pi * turn
    height = np.sqrt(np.maximum(1 - sine**2, 0))
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), height], axis=1)
