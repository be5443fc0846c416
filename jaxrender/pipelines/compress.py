"""A BRDF as a wavelet tree in a file (L 4.4): tabulated, transformed, thresholded, and judged.

Samples are means over the cells of Nusselt's square, and zero outside its disc (L 4.1, 4.6).  The
coefficients of all channels share their places.  Two relative errors of the clamped values are
stated:

- What thresholding misses: the rms of the missing part over the rms of the table.  The dropped
  coefficients predict it (L 4.7, ERRATA 61); for an orthonormal wavelet exactly, but for clamping.
- What the tree misses of the BRDF itself, at the measured pairs or at random ones about the mirror
  directions (``judged_pairs``), with its standard error.  It shows where cells are wider than the
  lobe.

Isotropic BRDFs may be held over half and difference angles instead (``compress_isotropic``), where
the same number of coefficients misses far less of a glossy one.  ``auto`` holds a part of the
measurements out of the table, and chooses by the error there.

Python reads a tree, renders with it, draws directions from it, and finds the nearest models::

    tree = compressed(brdf, 32, Goal(0.01)).tree  # jaxrender.brdf.compression; from a model
    tree, about = read_tree("paint.nc")  # jaxrender.io
    material = WaveletBRDF(tree)  # jaxrender.brdf
    sampler = TreeSampler.of(tree)  # jaxrender.brdf; for reflection.tracing.path_radiance
    picture = shade_plane(light_tree, [tree], view)  # jaxrender.reflection.wavelet_shading
    best_models(material)  # jaxrender.inverse
"""

import time
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

from jaxrender.brdf import BRDF, WaveletBRDF
from jaxrender.brdf.compression.compressed import cell_table
from jaxrender.brdf.compression.energy import CONSERVES, Energy, conserving
from jaxrender.brdf.compression.isotropic import Isotropic, Judge
from jaxrender.brdf.compression.judged_pairs import Estimate
from jaxrender.brdf.compression.squares import Compression, Goal, compression_of
from jaxrender.brdf.half_difference_tree import TRANSFORMS
from jaxrender.brdf.tables.cell_means import CELL_SAMPLES
from jaxrender.brdf.tables.tabulated import TabulatedBRDF
from jaxrender.errors import InputError
from jaxrender.geometry import NUSSELT
from jaxrender.io.atomic import replacing
from jaxrender.io.tree_layout import TreeAbout
from jaxrender.io.trees import write_tree
from jaxrender.pipelines.brdf_sources import Source, source_of
from jaxrender.pipelines.compress_isotropic import chosen_isotropic, sentence_of, written
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.result import write_json
from jaxrender.wavelets import Wavelet, wavelet_named

# A table of so many numbers takes about 2 GB to make a tree of.
_MOST_NUMBERS = 2**26
_POINTS = 1 << 16
_TABLE_BYTES = 4
EMBEDDINGS = ("nusselt", "half-difference", "auto")
_USUAL_WAVELETS = {"nusselt": "haar", "half-difference": "cdf-2-2"}
_evaluate = eqx.filter_jit(BRDF.evaluate)


def goal_of(keep: float | None, error: str | None) -> Goal | None:
    """Read a goal from its words: an error as 5% or 0.05.  Raises ``InputError`` for others."""
    if keep is None and error is None:
        return None
    share = None
    if error is not None:
        number, percent, rest = error.strip().partition("%")
        try:
            share = float(number) / (100 if percent else 1)
        except ValueError:
            share = float("nan")
        if rest or not np.isfinite(share):
            raise InputError(f"--error {error}: give a part or percent, as 0.05 or 5%")
    return Goal(Goal().fraction if keep is None else keep, share)


class Compressed(NamedTuple):
    """The written tree, sentences about it, and whether it conserves energy (``Energy.outcome``).

    ``lost`` is what ``conserve`` took of uniform light that the BRDF reflects.
    """

    compression: Compression | Isotropic
    errors: dict[str, Estimate]
    said: tuple[str, ...]
    lost: float = 0.0

    @property
    def energy(self) -> Energy:
        """Of the tree."""
        return self.compression.energy

    @property
    def conserves_energy(self) -> bool:
        """Whether no albedo is above 1, but for rounding."""
        return self.energy.outcome == CONSERVES


def compress(
    named: str,
    out: Path,
    goal: Goal | None = None,
    *,
    size: int = 32,
    wavelet: str | None = None,
    spectral: bool = False,
    cell_samples: int = CELL_SAMPLES,
    embedding: str = "nusselt",
    transform: str | None = None,
    conserve: bool = False,
    progress: Progress | None = None,
) -> Compressed:
    """Write the tree of a BRDF: a file, a model or a fit's result folder (``brdf_sources``).

    ``cell_samples`` are taken for the mean over a cell of Nusselt's square, 1 at its centre.
    ``embedding`` is one of ``EMBEDDINGS``; ``transform`` of values belongs to ``half-difference``.
    The wavelet is Haar's by default over Nusselt's squares, and else the linear spline.
    ``conserve`` dims what sends out more light than arrives (``brdf.compression.conserving``).
    Beside the tree ``OUT.json`` holds what is said, as numbers.

    Raises ``InputError`` for unreadable and unwritable files, a size that is too large or no power
    of two, an unknown wavelet, and a goal out of range.
    """
    progress = progress or SilentProgress()
    _checked(goal or Goal(), size, cell_samples)
    _checked_coordinates(embedding, transform)
    wavelets = {kind: _wavelet_of(wavelet or usual) for kind, usual in _USUAL_WAVELETS.items()}
    if not out.parent.is_dir():
        raise InputError(f"{out}: no such folder {out.parent}; make it first")
    with progress.stage("read"):
        source = source_of(named, spectral)
    if embedding != "nusselt":
        with progress.stage("compare"):
            found = chosen_isotropic(
                source, wavelets, size, cell_samples, goal, embedding, transform, conserve
            )
        if found is not None:
            with progress.stage("write"):
                said = written(source, found.tree, goal, out)
            took = f"time: evaluation {1e6 * _seconds_a_point(found.tree.brdf):.3f} us a pair, warm"
            done = Compressed(found.tree, found.tree.errors, (*said, took), found.lost)
            _write_numbers(out, source.name, done)
            return done
    goal, chosen = goal or Goal(), wavelets["nusselt"]
    channels = source.brdf.amplitudes.shape[1]
    if size**4 * channels > _MOST_NUMBERS:
        raise InputError(
            f"--size {size} with {channels} channels is a table of {size**4 * channels:,} numbers; "
            f"at most {_MOST_NUMBERS:,}: give a smaller size"
        )
    seconds = {}
    with progress.stage("tabulate"):
        start = time.perf_counter()
        fill, brdf, lost, dimmed = "zero" if source.rings else "nearest", source.brdf, 0.0, ()
        if conserve:
            done = conserving(brdf)
            brdf, lost, dimmed = done.brdf, done.lost, (done.sentence(),)
        table, masked = cell_table(brdf, size, fill, cell_samples=cell_samples)
        seconds["tabulate"] = time.perf_counter() - start
    if not table.any():
        raise InputError(f"{named}: reflects nothing anywhere; there is nothing to compress")
    with progress.stage("transform"):
        start = time.perf_counter()
        found = compression_of(table, chosen, goal, 1.0 if conserve else None)
        seconds["transform"] = time.perf_counter() - start
    tree = WaveletBRDF(found.tree)
    with progress.stage("compare"):
        start = time.perf_counter()
        judge = Judge.of(source.brdf, source.measured)
        errors = judge.errors(tree)
        between = errors["plain"].value
        seconds["compare"] = time.perf_counter() - start
    with progress.stage("write"):
        start = time.perf_counter()
        kept = f"{found.tree.count} of {found.non_zero} coefficients"
        about = TreeAbout(
            source.name,
            channels=source.channels,
            wavelengths=source.wavelengths,
            relative_rms=found.measured,
            relative_rms_between=between,
            non_zero=found.non_zero,
            comment="; ".join([kept, *source.said, *dimmed, found.energy.sentence()]),
        )
        write_tree(out, found.tree, about)
        seconds["write"] = time.perf_counter() - start
    said = [*_said_of_source(source, size, masked), *dimmed, *_said(found, goal, out)]
    said.append(
        f"{sentence_of(errors, judge.where)}; if plain is much more than the error above, the "
        "cells are wider than the lobe: give a larger --size, or --embedding half-difference"
    )
    each = _seconds_a_point(tree)
    stages = ", ".join(f"{name} {took:.2f} s" for name, took in seconds.items())
    said.append(f"time: {stages}; evaluation {1e6 * each:.3f} us a pair, warm")
    done = Compressed(found, errors, tuple(said), lost)
    _write_numbers(out, source.name, done)
    return done


def _write_numbers(out: Path, name: str, done: Compressed) -> None:
    """Write what was found beside the tree, whole or not at all."""
    energy, tree = done.energy, done.compression.tree
    document = {
        "task": "compress",
        "source": name,
        "outcome": energy.outcome,
        "albedo": {"largest": energy.largest, "of_table": energy.of_table},
        "albedo_over_table": energy.ratio,
        "albedo_over_table_undimmed": energy.undimmed,
        "lost_of_table": energy.lost,
        "lost_by_conserve": done.lost,
        "coefficients": {"kept": tree.count, "non_zero": done.compression.non_zero},
        "errors": {
            metric: {"value": one.value, "standard_error": one.deviation}
            for metric, one in done.errors.items()
        },
    }
    with replacing(out.with_name(f"{out.name}.json")) as aside:
        write_json(aside, document)


def _checked(goal: Goal, size: int, cell_samples: int) -> None:
    if size < 2 or size & (size - 1):
        near = 2 ** max(1, round(np.log2(max(size, 2))))
        raise InputError(f"--size {size}: no power of two; give {near}")
    if cell_samples != 1 and (cell_samples < 1 or cell_samples % 2):
        raise InputError(f"--cell-samples {cell_samples}: give 1, or an even number such as 16")
    if goal.error is not None and not 0 < goal.error < 1:
        raise InputError(f"--error {goal.error}: a relative error lies between 0 and 1, as 0.05")
    if not 0 < goal.fraction <= 1:
        raise InputError(f"--keep {goal.fraction}: a fraction is above 0 and at most 1, as 0.01")


def _checked_coordinates(embedding: str, transform: str | None) -> None:
    if embedding not in EMBEDDINGS:
        raise InputError(f"--embedding {embedding}: choose one of {', '.join(EMBEDDINGS)}")
    if transform is not None and transform not in TRANSFORMS:
        raise InputError(f"--transform {transform}: choose one of {', '.join(TRANSFORMS)}")
    if transform not in (None, "none") and embedding == "nusselt":
        raise InputError(
            f"--transform {transform}: trees over nusselt hold plain values, which shading and "
            "sampling take; leave it out, or give --embedding half-difference"
        )


def _wavelet_of(name: str) -> Wavelet:
    try:
        return wavelet_named(name)
    except ValueError as error:
        raise InputError(f"--wavelet: {error}") from None


def _seconds_a_point(brdf: BRDF) -> float:
    """Time the evaluation of pairs of directions, compiled before."""
    rng = np.random.default_rng(0)
    pair = rng.normal(size=(2, _POINTS, 3)).astype(np.float32)
    pair[..., 2] = np.abs(pair[..., 2])
    pair /= np.linalg.norm(pair, axis=-1, keepdims=True)
    jax.block_until_ready(_evaluate(brdf, *pair))
    start = time.perf_counter()
    jax.block_until_ready(_evaluate(brdf, *pair))
    return (time.perf_counter() - start) / _POINTS


def _said_of_source(source: Source, size: int, masked: int) -> list[str]:
    said = [f"{source.name}: {sentence}" for sentence in source.said]
    if isinstance(source.brdf, TabulatedBRDF) and (
        source.brdf.size != (size,) * 4 or source.brdf.embedding != NUSSELT
    ):
        have = " x ".join(map(str, source.brdf.size))
        said.append(
            f"resampled from {have} ({source.brdf.embedding.name}) to {size}^4 (nusselt), between "
            f"samples by the {source.brdf.reconstruction} reconstruction"
        )
    if masked:
        how = "set 0" if source.rings else "filled from the nearest"
        said.append(f"{masked} of the table's samples negative or not finite, {how}")
    return said


def _said(found: Compression, goal: Goal, out: Path) -> list[str]:
    tree, written = found.tree, out.stat().st_size
    dense = _TABLE_BYTES * tree.size**4 * tree.channels
    said = [
        f"size: {tree.count} of {found.non_zero} non-zero coefficients "
        f"({100 * tree.count / max(found.non_zero, 1):.3g} %), {written:,} bytes, "
        f"1/{dense / written:.0f} of the table of {tree.size}^4 x {tree.channels} in float32",
        f"error: {_percent(found.measured)} rms of the table's own (predicted "
        f"{_percent(found.predicted)}{'' if tree.wavelet.orthonormal else ', an estimate'}); by "
        f"channel {' '.join(_percent(e) for e in found.by_channel)}",
        f"reciprocity: exchanging directions changes {_percent(found.samples.reciprocity_error)} "
        f"(the table {_percent(found.table.reciprocity_error)})",
        found.energy.sentence(),
    ]
    if goal.error is not None and found.measured > goal.error:
        said.append(f"--error {goal.error:g} was not met with {tree.wavelet.name}; try haar")
    return said


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"
