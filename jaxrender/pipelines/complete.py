"""A whole BRDF from few measurements and a folder of measured materials; where to measure next.

What the materials have in common is learnt once and kept in the cache, by the files' names, sizes
and times.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.brdf.tables.isotropic import node_angles, pair_at
from jaxrender.brdf.tables.learned import FEWEST_MATERIALS, LearnedMaterials, learn_materials
from jaxrender.brdf.tables.measurements import Measurements
from jaxrender.errors import InputError
from jaxrender.inverse.completion import USUAL_NOISE, Completion, NextPairs, complete, next_pairs
from jaxrender.io.atomic import replacing
from jaxrender.io.merl import SCALES, MerlTable, map_merl, write_merl
from jaxrender.pipelines.brdf_sources import measurements_of
from jaxrender.pipelines.caches import remembered
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.result import write_json

_MERL = ".binary"
_GREY, _COLOURED = 1, 3
# Errors are summed up where both directions have more than this cosine, that of 80 degrees.
_LOWEST_TOLD = 0.17


class Completed(NamedTuple):
    """What was found, and sentences about it; None where nothing was asked."""

    completion: Completion | None
    pairs: NextPairs | None
    said: tuple[str, ...]


def complete_samples(
    samples: Path | None,
    materials: Path,
    out: Path | None = None,
    *,
    following: int = 0,
    components: int = 40,
    noise: float | None = None,
    progress: Progress | None = None,
) -> Completed:
    """Complete the BRDF of a file of measurements as MERL's ``out``, and name pairs that follow.

    Beside ``out`` lies its ``.json`` of numbers.  Raises ``InputError`` for a file that holds no
    scattered measurements, a folder of fewer than five MERL files, more components than these tell,
    measurements of neither one nor three channels, and nothing to do.
    """
    if out is not None and out.suffix.lower() != _MERL:
        raise InputError(f"{out}: the table is written as MERL's; name a file that ends in {_MERL}")
    if out is not None and samples is None:
        raise InputError(f"{out}: nothing was measured that could be completed; give SAMPLES")
    if out is None and following < 1:
        raise InputError("nothing to do: give --out, or the number of pairs that --next asks for")
    progress = progress or SilentProgress()
    measured = None if samples is None else _measured(samples)
    with progress.stage("learn materials"):
        learned, said = _learned(materials, components)
    completion = pairs = None
    try:
        if out is not None and measured is not None:
            with progress.stage("complete"):
                completion = complete(learned, measured, noise)
            said += _write(out, completion, learned, len(measured.values))
        if following > 0:
            with progress.stage("choose pairs"):
                pairs = next_pairs(learned, following, measured, noise or USUAL_NOISE)
            said += _table(pairs)
    except ValueError as error:
        raise InputError(f"{samples or materials}: {error}") from None
    return Completed(completion, pairs, tuple(said))


def _measured(samples: Path) -> Measurements:
    if not samples.is_file():
        raise InputError(f"{samples}: no such file; give a file of scattered measurements")
    measured = measurements_of(str(samples))
    if measured is None:
        raise InputError(
            f"{samples}: a whole BRDF, and no scattered measurements; give a Cornell .brdf or an "
            "ALTA text file"
        )
    channels = measured.values.shape[1]
    if channels not in (_GREY, _COLOURED):
        raise InputError(f"{samples}: {channels} channels; a MERL file has three, or one is grey")
    return measured


def _learned(folder: Path, components: int) -> tuple[LearnedMaterials, list[str]]:
    """Learn from a folder, or look up what was learnt of it."""
    files = sorted(folder.glob(f"*{_MERL}"))
    if len(files) < FEWEST_MATERIALS:
        raise InputError(
            f"{folder}: {len(files)} MERL files (*{_MERL}); give a folder of at least "
            f"{FEWEST_MATERIALS} measured materials"
        )
    about = [(str(one.resolve()), one.stat()) for one in files]
    key = [f"{path} {stat.st_size} {stat.st_mtime_ns}" for path, stat in about]
    made: list[LearnedMaterials] = []

    def learn() -> np.ndarray:
        try:
            made.append(learn_materials([map_merl(one) for one in files], SCALES, components))
        except ValueError as error:
            raise InputError(f"{folder}: {error}") from None
        # A node that was not measured of all materials has no variance of its own.
        known = made[0].known[..., None].astype(np.float32)
        return np.concatenate([made[0].table, known], axis=-1)

    kept = remembered("materials", ["1", str(components), *key], learn)
    learned = LearnedMaterials(kept[..., :-1], kept[..., -1] > 0)
    part = float(np.mean(learned.known))
    said = f"learnt from {len(files)} materials: {learned.count} components, {100 * part:.0f} % of "
    return learned, [said + "the table's nodes were measured of all of them"]


def _write(out: Path, completion: Completion, learned: LearnedMaterials, count: int) -> list[str]:
    """Write the table and its numbers, and say how well it is known."""
    values = np.asarray(completion.brdf.values)
    grey = values.shape[-1] == _GREY
    brdf = completion.brdf
    if grey:
        brdf = type(brdf)(np.repeat(values, _COLOURED, axis=-1))
    write_merl(out, MerlTable.of(brdf))
    lower = np.minimum(*(pair[..., 2] for pair in pair_at(node_angles(learned.shape))))
    error = completion.relative_error[learned.known & (lower > _LOWEST_TOLD)]
    median, most = np.quantile(error, 0.5), np.quantile(error, 0.9)
    numbers = {
        "measurements": count,
        "components": learned.count,
        "relative_error_median": float(median),
        "relative_error_90": float(most),
        "noise": completion.noise.tolist(),
        "excess": completion.excess.tolist(),
        "left_out": completion.left_out.tolist(),
        "coefficients": completion.coefficients.tolist(),
    }
    beside = out.with_name(out.name + ".json")
    with replacing(beside) as aside:
        write_json(aside, numbers)

    def percent(values: np.ndarray) -> str:
        return " ".join(f"{100 * value:.1f}" for value in values)

    said = [
        f"{count} measurements; each foretold by the others within {percent(completion.left_out)} "
        "% rms of its logarithm",
        f"standard error of an entry within 80 degrees: {100 * median:.0f} % in the median, below "
        f"{100 * most:.0f} % for nine of ten",
    ]
    if np.any(completion.excess > 1.5):
        said.append(
            "the material departs from the learnt ones more than they do from one another, by "
            f"{' '.join(f'{np.sqrt(e):.1f}' for e in completion.excess)} times; errors know of it"
        )
    if grey:
        said.append("one channel was measured: the table has it three times")
    return [*said, f"table: {out}; numbers: {beside}"]


def _table(pairs: NextPairs) -> list[str]:
    """List pairs by their angles, the incoming direction at azimuth 0."""
    polar = [np.degrees(np.arccos(one[:, 2])) for one in (pairs.incoming, pairs.outgoing)]
    azimuth = [np.arctan2(one[:, 1], one[:, 0]) for one in (pairs.incoming, pairs.outgoing)]
    apart = np.degrees(azimuth[1] - azimuth[0]) % 360
    lines = ["measure next [degrees]: theta in, theta out, azimuth apart; variance that remains"]
    for number, row in enumerate(zip(*polar, apart, 100 * pairs.remaining), 1):
        lines.append("{:3d}: {:5.1f} {:5.1f} {:6.1f}   {:5.1f} %".format(number, *row))
    return lines
