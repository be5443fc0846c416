"""A BRDF's tree over half and difference angles: transformed, thresholded, judged.

The tree is judged at pairs of directions: at the measured ones where there are scattered
measurements, at random ones about the mirror directions (``judged_pairs``) of any other BRDF.  An
error to meet is the cosine-weighted absolute one there, and is met with the fewest coefficients.

Samples are values at the nodes between which the tree is interpolated.  Its albedo is measured at
``energy.DEGREES``, and the BRDF dimmed where that is too high.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.compression.energy import (
    DEGREES,
    MENDINGS,
    Dimmed,
    Energy,
    dimmed_further,
    excess,
    isotropic_albedo,
)
from jaxrender.brdf.compression.judged_pairs import Estimate, judged, pairs_about_mirrors
from jaxrender.brdf.half_difference_tree import (
    TRANSFORMS,
    HalfDifferenceTree,
    coordinates_of,
    half_difference_samples,
    interpolated,
)
from jaxrender.brdf.tables.isotropic import half_difference
from jaxrender.brdf.tables.measurements import Measurements
from jaxrender.geometry import Components
from jaxrender.shapes import Float
from jaxrender.wavelets import (
    CoefficientTree,
    Wavelet,
    analyse_nonstandard,
    is_stepwise,
    keep_largest,
    synthesise_nonstandard,
)

# What an error to meet is measured in.
GOAL_METRIC = "cosine-l1"
_evaluate = eqx.filter_jit(BRDF.evaluate)
_UNKNOWN = Energy(0.0, 0.0, 0.0, 1.0, 0.0)


class Judge(NamedTuple):
    """Values at pairs of directions; weights of random ones."""

    truth: Measurements
    weights: Float[np.ndarray, "pair"] | None

    @property
    def where(self) -> str:
        """Say of what, and at which pairs."""
        if self.weights is None:
            return f"the measurements, at all {len(self.truth.values)} pairs"
        return f"the BRDF itself, at {len(self.weights)} random pairs"

    @classmethod
    def of(cls, brdf: BRDF, measured: Measurements | None = None, seed: int = 1) -> "Judge":
        """Take the measurements, or else the BRDF's values at random pairs."""
        if measured is not None:
            return cls(measured, None)
        pairs = pairs_about_mirrors(seed=seed)
        values = np.asarray(_evaluate(brdf, pairs.incoming, pairs.outgoing), float)
        return cls(Measurements(pairs.incoming, pairs.outgoing, values), pairs.weights)

    def errors(self, brdf: BRDF) -> dict[str, Estimate]:
        """Measure a BRDF by every metric."""
        found = np.asarray(_evaluate(brdf, self.truth.incoming, self.truth.outgoing), float)
        return judged(found, self.truth, self.weights)


class Isotropic(NamedTuple):
    """A tree, and what it misses at the pairs; of how many coefficients in its table."""

    brdf: HalfDifferenceTree
    tree: CoefficientTree
    non_zero: int
    relative_rms: float
    errors: dict[str, Estimate]
    met: bool
    energy: Energy
    where: str = ""
    said: tuple[str, ...] = ()


def compress_isotropic(
    brdf: BRDF,
    judge: Judge,
    wavelet: Wavelet,
    size: int = 32,
    transform: str = "cube-root",
    count: int | None = None,
    error: float | None = None,
    limit: float | None = None,
) -> Isotropic:
    """Keep ``count`` coefficients, or as few as leave an error of ``error``, of an isotropic BRDF.

    With a ``limit`` no albedo is above it.  Raises ``ValueError`` as ``half_difference_samples``
    does.
    """
    table, weights = isotropic_albedo(brdf), _shares(np.radians(DEGREES))
    near, cosines = np.ones(len(DEGREES), bool), np.cos(np.radians(DEGREES))[::-1]
    factors, left, first = np.ones(len(DEGREES)), 1.0, 1.0
    for step in range(MENDINGS + 2):
        dimmed = Dimmed(brdf, cosines, factors[::-1]) if step else brdf
        values = half_difference_samples(dimmed, size, "none") / left
        samples = np.asarray(TRANSFORMS[transform].apply(values))
        found = _thresholded(samples, judge, wavelet, transform, count, error)
        albedo = isotropic_albedo(found.brdf)
        above = excess(albedo, table, near, limit)
        first = first if step else float(above.max())
        if above.max() <= 1:
            break
        if step < MENDINGS:
            factors = dimmed_further(factors, above)
        else:
            left *= float(above.max()) * (1 + 1e-3)
    energy = Energy.of(albedo, table, weights, near, first)
    return found._replace(energy=energy, errors=judge.errors(found.brdf))


def _thresholded(
    samples: Float[np.ndarray, "root_theta_h theta_d phi_d channel"],
    judge: Judge,
    wavelet: Wavelet,
    transform: str,
    count: int | None,
    error: float | None,
) -> Isotropic:
    coefficients = np.array(analyse_nonstandard(wavelet, samples))
    least = np.finfo(coefficients.dtype).eps * np.abs(coefficients).max()
    coefficients[np.abs(coefficients) <= least] = 0
    non_zero = int(np.count_nonzero(np.any(coefficients != 0, axis=-1)))
    pair = Components.of(judge.truth.incoming), Components.of(judge.truth.outgoing)
    points, undo = coordinates_of(half_difference(*pair)), TRANSFORMS[transform].undo

    def kept(number: int) -> np.ndarray:
        return np.asarray(keep_largest(coefficients, number, joint=True).coefficients)

    def missed(number: int) -> float:
        found = interpolated(
            synthesise_nonstandard(wavelet, kept(number)), points, is_stepwise(wavelet)
        )
        values = np.asarray(undo(jnp.maximum(found, 0)))
        return judged(values, judge.truth, judge.weights)[GOAL_METRIC].value

    met = True
    if error is not None:
        met = missed(non_zero) <= error
        count = _fewest(missed, error, non_zero) if met else non_zero
    chosen = kept(min(count or non_zero, non_zero))
    tree = CoefficientTree.of_coefficients(wavelet, chosen)
    ours = np.asarray(synthesise_nonstandard(wavelet, chosen))
    rms = float(np.sqrt(np.sum((ours - samples) ** 2) / np.sum(samples**2)))
    found = HalfDifferenceTree.of(tree, transform)
    return Isotropic(found, tree, non_zero, rms, {}, met, _UNKNOWN, judge.where)


def _shares(angles: Float[np.ndarray, "angle"]) -> Float[np.ndarray, "angle"]:
    """Weigh angles by the projected solid angle of what lies between them."""
    edges = np.concatenate([[0], (angles[1:] + angles[:-1]) / 2, [np.pi / 2]])
    return np.diff(np.sin(edges) ** 2)


def _fewest(missed: Callable[[int], float], error: float, most: int) -> int:
    """Halve between a number that misses too much and one that does not, to 1 in 64."""
    low, high = 1, most
    while high - low > max(1, high // 64):
        middle = int(np.sqrt(low * high)) if high > 4 * low else (low + high) // 2
        middle = min(max(middle, low + 1), high - 1)
        if missed(middle) <= error:
            high = middle
        else:
            low = middle
    return high
