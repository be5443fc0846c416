"""``jaxrender measure``: a patch under the virtual gonioreflectometer, into a table (L 3.1.1).

Finished rows of exit directions are kept in a folder beside the result, ``OUT.partial``.  After any
interrupt the same command continues from there.  Another command is refused unless forced.
"""

import json
import math
import os
import shutil
import uuid
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry import EMBEDDINGS
from jaxrender.io.atomic import replacing
from jaxrender.io.jsonfiles import read_json
from jaxrender.io.tables import BRDFTable, read_table, write_table
from jaxrender.pipelines.brdf_sources import files_of, names_file
from jaxrender.pipelines.kept import keeping
from jaxrender.pipelines.output import fingerprint_of
from jaxrender.pipelines.patches import facets_of, patch_of
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.reflection.tracing.gonioreflectometer import (
    Block,
    Gonioreflectometer,
    Measurement,
    MeasureSettings,
)

DEFAULT_FACETS = ("lambertian",)
_RECIPE = "recipe.json"
# Numbers of a table, with its errors twice as many: 32^4 pairs in RGB are 3 million.
_MOST_NUMBERS = 2**28


class MeasureOptions(NamedTuple):
    """The options of the command line; see ``jaxrender measure --help``."""

    patch: str
    brdfs: tuple[str, ...] = DEFAULT_FACETS
    size: tuple[int, ...] = (16,)
    """One number for all four axes, or those of kappa_i, lambda_i, kappa_r and lambda_r."""
    embedding: str = "nusselt"
    samples: int = 256
    bounces: int = 4
    seed: int = 0
    region: tuple[float, ...] = (0.0, 0.0, 1.0, 1.0)
    relief: float = 0.1


class Measured(NamedTuple):
    """The written table, and a sentence on its accuracy."""

    path: Path
    table: BRDFTable
    text: str


def measure(
    options: MeasureOptions, out: Path, progress: Progress | None = None, force: bool = False
) -> Measured:
    """Measure a patch and write the table; continues an interrupted run of the same options.

    Raises ``InputError`` for options out of range and for unusable files.  Raises it without
    ``force`` where the result of another measurement is in the way, finished or not.
    """
    progress = progress or SilentProgress()
    settings = _settings(options)
    patch, files = patch_of(options.patch, options.relief)
    facets = facets_of(options.brdfs, patch.materials)
    named = [specification for specification in options.brdfs if names_file(specification)]
    files = [*files, *(path for one in named for path in files_of(one))]
    if 2.0 * math.prod(settings.size) * facets[0].amplitudes.shape[1] > _MOST_NUMBERS:
        raise InputError(f"size {settings.size}: more than {_MOST_NUMBERS} numbers; give a smaller")
    digest = fingerprint_of("measure", json.dumps(options._asdict(), sort_keys=True), files)
    if _is_finished(out, digest, force):
        progress.note(f"{out}: measured before; reused (--force: anew)")
        table = read_table(out)
        return Measured(out, table, _said(table))
    kept = _Kept.at(out, digest, force)
    meter = Gonioreflectometer.of(patch, facets)
    done = kept.rows(meter, settings)
    if done:
        progress.note(f"{kept.folder}: {len(done)} of {settings.size[2]} rows done; going on")
    count = len(done)
    going_on = f"of {settings.size[2]} rows are kept in {kept.folder}; the same command goes on"
    with progress.stage("measure"), keeping(lambda: f"{count} {going_on}"):
        for block in meter.blocks(settings, done):
            kept.keep(block)
            count += 1
            progress.advance(count / settings.size[2])
    with progress.stage("write"):
        found = Measurement.of(kept.blocks(settings.size[2]))
        about = {name: _plain(value) for name, value in options._asdict().items()}
        about |= {"source": "virtual gonioreflectometer", "fingerprint": digest}
        del about["embedding"]
        table = BRDFTable(*found, settings.embedding, 0, about)
        write_table(out, table)
        shutil.rmtree(kept.folder)
    return Measured(out, table, _said(table))


def _settings(options: MeasureOptions) -> MeasureSettings:
    size = options.size * 4 if len(options.size) == 1 else options.size
    if len(size) != 4 or len(options.region) != 4:
        raise InputError(
            f"--size {options.size} --region {options.region}: give one size or four, and four "
            "numbers u0 v0 u1 v1"
        )
    if options.embedding not in EMBEDDINGS:
        raise InputError(f"--embedding {options.embedding}: give one of {', '.join(EMBEDDINGS)}")
    u0, v0, u1, v1 = options.region
    settings = MeasureSettings(
        (size[0], size[1], size[2], size[3]), EMBEDDINGS[options.embedding],
        options.samples, options.bounces, options.seed, (u0, v0, u1, v1),
    )  # fmt: skip
    try:
        settings.check()
    except ValueError as error:
        raise InputError(str(error)) from None
    if options.seed < 0 or not math.isfinite(options.relief):
        raise InputError(f"seed {options.seed}, relief {options.relief}: give a seed from 0")
    return settings


class _Kept(NamedTuple):
    """The folder of finished rows."""

    folder: Path

    @classmethod
    def at(cls, out: Path, digest: str, force: bool) -> "_Kept":
        """Open or make it.  ``InputError`` if it belongs to another measurement."""
        folder = out.with_name(f"{out.name}.partial")
        if not out.parent.is_dir():
            raise InputError(f"{out}: no such folder {out.parent}; make it first")
        if folder.exists():
            try:
                found = read_json(folder / _RECIPE)["fingerprint"]
            except (OSError, ValueError, KeyError, TypeError):
                raise InputError(
                    f"{folder}: not what an interrupted measurement leaves; move it away"
                ) from None
            if found == digest:
                return cls(folder)
            if not force:
                raise InputError(
                    f"{folder}: left by another measurement; choose another output, or give "
                    "--force to discard it"
                )
            shutil.rmtree(folder)
        aside = out.with_name(f".{out.name}.{uuid.uuid4().hex}")
        aside.mkdir()
        text = json.dumps({"made_by": "jaxrender measure", "fingerprint": digest}, indent=2)
        (aside / _RECIPE).write_text(text + "\n", encoding="utf-8")
        os.replace(aside, folder)
        return cls(folder)

    def keep(self, block: Block) -> None:
        """Write a row, whole or not at all."""
        with replacing(self._path(block.row)) as aside:
            np.savez(aside, values=block.values, standard_errors=block.standard_errors)

    def rows(self, meter: Gonioreflectometer, settings: MeasureSettings) -> set[int]:
        """Say which rows are whole; a damaged one is measured again."""
        light, size = settings.size[:2], settings.size
        shape = (*light, size[3], meter.scene.channels)
        done = set()
        for row in range(size[2]):
            try:
                is_whole = self._block(row).values.shape == shape
            except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
                is_whole = False
            if is_whole:
                done.add(row)
        return done

    def blocks(self, count: int) -> Iterator[Block]:
        """Read all rows."""
        return (self._block(row) for row in range(count))

    def _block(self, row: int) -> Block:
        with np.load(self._path(row), allow_pickle=False) as held:
            return Block(row, held["values"], held["standard_errors"])

    def _path(self, row: int) -> Path:
        return self.folder / f"row_{row:04d}.npz"


def _is_finished(out: Path, digest: str, force: bool) -> bool:
    """Whether this very measurement is there already; ``InputError`` if something else is."""
    if not out.exists():
        return False
    if not out.is_file():
        raise InputError(f"{out}: a folder is in the way; choose another output file")
    if force:
        return False
    try:
        found = read_table(out).about.get("fingerprint")
    except InputError:
        found = None
    if found != digest:
        raise InputError(
            f"{out}: holds something else, or another measurement; choose another output, or give "
            "--force to replace it"
        )
    return True


def _plain(value: object) -> str | int | float:
    if isinstance(value, tuple):
        return " ".join(str(part) for part in value)
    return value if isinstance(value, int | float) else str(value)


def _said(table: BRDFTable) -> str:
    """Sum a table up: its size, its mean, the error of an entry."""
    values, errors = table.values, table.standard_errors
    seen = values[values > 0]
    mean = float(seen.mean()) if seen.size else 0.0
    error = 0.0 if errors is None or not seen.size else float(np.mean(errors[values > 0]))
    size = " x ".join(str(n) for n in values.shape[:4])
    return (
        f"{size} directions ({table.embedding.name}), {values.shape[4]} channels: mean {mean:.4g} "
        f"1/sr, standard error of an entry {error:.2g}"
    )
