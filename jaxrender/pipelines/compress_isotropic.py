"""The tree over half and difference angles of a source, if that is better or asked for."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import BRDF, WaveletBRDF, fit_isotropic_table
from jaxrender.brdf.compression.energy import conserving
from jaxrender.brdf.compression.isotropic import GOAL_METRIC, Isotropic, Judge, compress_isotropic
from jaxrender.brdf.compression.judged_pairs import Estimate
from jaxrender.brdf.compression.squares import Goal
from jaxrender.brdf.half_difference_tree import TRANSFORMS
from jaxrender.brdf.isotropic_mean import IsotropicMean
from jaxrender.brdf.tables.cell_means import tabulate
from jaxrender.errors import InputError
from jaxrender.io.tree_layout import HALF_DIFFERENCE, HALF_DIFFERENCE_AXES, TreeAbout
from jaxrender.io.trees import write_tree
from jaxrender.pipelines.brdf_sources import Source
from jaxrender.wavelets import CoefficientTree, Wavelet, analyse_nonstandard, keep_largest

# Of all samples: 1,000 coefficients of 32^3.
DEFAULT_FRACTION = 0.0305
FOLDS = 5
# Squares of more cells take too long to be tried.
_SQUARES = 32


class Chosen(NamedTuple):
    """A tree, and what ``conserve`` took of uniform light that the BRDF reflects."""

    tree: Isotropic
    lost: float


def chosen_isotropic(
    source: Source,
    wavelets: Mapping[str, Wavelet],
    size: int,
    cell_samples: int,
    goal: Goal | None,
    embedding: str,
    transform: str | None,
    conserve: bool = False,
) -> Chosen | None:
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
    lost, limit = 0.0, None
    if conserve:
        done = conserving(brdf)
        brdf, lost, limit, said = done.brdf, done.lost, 1.0, (*said, done.sentence())
    found = compress_isotropic(brdf, judge, wavelet, size, kinds[0], count, error, limit)
    if source.measured is not None:
        table = judge.errors(source.brdf)
        said = (*said, f"the table behind the tree is {sentence_of(table, judge.where)}")
    return Chosen(found._replace(said=said), lost)


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
    said.append(found.energy.sentence())
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
