"""An isotropic BRDF as a tree over half and difference angles: transformed, thresholded, judged.

The tree is judged at pairs of directions: at the measured ones where there are scattered
measurements, at random ones about the mirror directions (``judged_pairs``) of any other BRDF.  An
error to meet is the cosine-weighted absolute one there, and is met with the fewest coefficients.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF, WaveletBRDF, fit_isotropic_table
from jaxrender.brdf.half_difference_tree import (
    TRANSFORMS,
    HalfDifferenceTree,
    coordinates_of,
    half_difference_samples,
    interpolated,
)
from jaxrender.brdf.isotropic_mean import IsotropicMean
from jaxrender.brdf.tables.cell_means import tabulate
from jaxrender.brdf.tables.isotropic import half_difference
from jaxrender.brdf.tables.measurements import Measurements
from jaxrender.errors import InputError
from jaxrender.geometry import Components
from jaxrender.io.tree_layout import HALF_DIFFERENCE, HALF_DIFFERENCE_AXES, TreeAbout
from jaxrender.io.trees import write_tree
from jaxrender.pipelines.brdf_sources import Source
from jaxrender.pipelines.judged_pairs import Estimate, judged, pairs_about_mirrors
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
# Of all samples: 1,000 coefficients of 32^3.
DEFAULT_FRACTION = 0.0305
FOLDS = 5
# Squares of more cells take too long to be tried.
_SQUARES = 32
_evaluate = eqx.filter_jit(BRDF.evaluate)


class Goal(NamedTuple):
    """How much to keep: a fraction of the non-zero coefficients, or enough for an error."""

    fraction: float = 0.01
    error: float | None = None


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
) -> Isotropic:
    """Keep ``count`` coefficients, or as few as leave an error of ``error``, of an isotropic BRDF.

    Raises ``ValueError`` as ``half_difference_samples`` does.
    """
    samples = half_difference_samples(brdf, size, transform)
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
    return Isotropic(found, tree, non_zero, rms, judge.errors(found), met, judge.where)


def chosen_isotropic(
    source: Source,
    wavelets: Mapping[str, Wavelet],
    size: int,
    cell_samples: int,
    goal: Goal | None,
    embedding: str,
    transform: str | None,
) -> Isotropic | None:
    """Make the tree that was asked for; for ``auto`` None where Nusselt's squares are better.

    An anisotropic BRDF is refused, or of ``auto`` left to Nusselt's squares.  Raises
    ``InputError``.
    """
    brdf, wavelet = source.brdf, wavelets["half-difference"]
    fraction, error = (DEFAULT_FRACTION, None) if goal is None else goal
    if not brdf.isotropic and not isinstance(brdf, WaveletBRDF):
        if embedding == "auto":
            return None
        raise InputError(
            f"{source.name}: anisotropic, and half and difference angles hold isotropic BRDFs; "
            "give --embedding nusselt"
        )
    said: tuple[str, ...] = ()
    if isinstance(brdf, WaveletBRDF):
        # A square grid has preferred azimuths even where its BRDF has not.
        brdf = IsotropicMean(brdf)
        said = (f"the mean of the tree over {brdf.turns} turns and mirror images, as isotropic",)
    judge = Judge.of(source.brdf, source.measured)
    count = max(round(fraction * size**3), 1)
    kinds = [transform] if transform is not None else ["cube-root"]
    if embedding == "auto":
        kinds = [transform] if transform is not None else list(TRANSFORMS)
        best, tried = _best_kind(source, brdf, judge, wavelets, size, cell_samples, count, kinds)
        said = (*said, f"auto: {tried}")
        if best is None:
            return None
        kinds = [best]
    found = compress_isotropic(brdf, judge, wavelet, size, kinds[0], count, error)
    if source.measured is not None:
        table = judge.errors(source.brdf)
        said = (*said, f"the table behind the tree is {sentence_of(table, judge.where)}")
    return found._replace(said=said)


def _best_kind(
    source: Source,
    brdf: BRDF,
    judge: Judge,
    wavelets: Mapping[str, Wavelet],
    size: int,
    cell_samples: int,
    count: int,
    kinds: list[str],
) -> tuple[str | None, str]:
    """Try transforms and Nusselt's squares, with as many coefficients, on pairs held out."""
    if source.measured is not None:
        measured = source.measured
        held = np.random.default_rng(0).permutation(len(measured.values)) % FOLDS == 0
        brdf = fit_isotropic_table(*measured.rows(~held)).brdf
        judge = Judge(measured.rows(held), None)
    wavelet = wavelets["half-difference"]
    errors = {}
    for kind in kinds:
        found = compress_isotropic(brdf, judge, wavelet, size, kind, count)
        errors[kind] = found.errors[GOAL_METRIC].value
    table = tabulate(brdf, min(size, _SQUARES), cell_samples=cell_samples).values
    coefficients = np.asarray(analyse_nonstandard(wavelets["nusselt"], table))
    kept = keep_largest(coefficients, count, joint=True).coefficients
    squares = WaveletBRDF(CoefficientTree.of_coefficients(wavelets["nusselt"], np.asarray(kept)))
    plain = judge.errors(squares)[GOAL_METRIC].value
    best = min(errors, key=lambda kind: errors[kind])
    what = "held-out measurements" if judge.weights is None else "random pairs"
    tried = ", ".join(f"half-difference {k} {100 * e:.3g} %" for k, e in errors.items())
    tried += f", nusselt {100 * plain:.3g} %; {GOAL_METRIC} at {what}, {count} coefficients"
    return (best if errors[best] <= plain else None), tried


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


def written(source: Source, found: Isotropic, goal: Goal | None, out: Path) -> tuple[str, ...]:
    """Write the tree, and say what it is."""
    tree, transform = found.tree, found.brdf.transform
    kept = f"{tree.count} of {found.non_zero} coefficients"
    about = TreeAbout(
        source.name,
        HALF_DIFFERENCE,
        HALF_DIFFERENCE_AXES,
        channels=source.channels,
        wavelengths=source.wavelengths,
        relative_rms=found.relative_rms,
        relative_rms_between=found.errors["plain"].value,
        non_zero=found.non_zero,
        comment="; ".join([kept, *source.said, *found.said]),
        value_transform=transform,
    )
    write_tree(out, tree, about)
    said = [*(f"{source.name}: {sentence}" for sentence in source.said), *found.said]
    said.append(
        f"size: {kept} ({100 * tree.count / max(found.non_zero, 1):.3g} %), "
        f"{out.stat().st_size:,} bytes, {tree.size}^3 over half and difference angles, of the "
        f"{transform if transform != 'none' else 'plain value'}, {tree.wavelet.name}"
    )
    said.append(f"error: {100 * found.relative_rms:.3g} % rms of the transformed table's own")
    said.append(sentence_of(found.errors, found.where))
    if goal is not None and goal.error is not None and not found.met:
        said.append(
            f"--error {goal.error:g} was not met: all {found.non_zero} coefficients leave "
            f"{100 * found.errors[GOAL_METRIC].value:.3g} %; give a larger --size"
        )
    return tuple(said)


def sentence_of(errors: dict[str, Estimate], where: str) -> str:
    """State errors with their standard errors."""
    parts = [
        f"{name} {100 * one.value:.3g} ± {100 * one.deviation:.1g} %"
        for name, one in errors.items()
    ]
    return f"off {where}: {', '.join(parts)}"
