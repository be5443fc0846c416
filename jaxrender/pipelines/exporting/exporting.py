"""``jaxrender export``: from a result folder to a folder of files for other programs."""

from pathlib import Path
from typing import NamedTuple

from jaxrender.errors import InputError
from jaxrender.io.exports import Contents, Part
from jaxrender.pipelines.exporting.contents import Held, contents_of
from jaxrender.pipelines.exporting.formats import (
    ALL,
    FORMATS,
    MATERIAL,
    format_named,
    missing_of,
)
from jaxrender.pipelines.exporting.prepared import Prepared
from jaxrender.pipelines.exporting.readme import README, Section, readme_text
from jaxrender.pipelines.output import FolderState, fingerprint, prepare, result_folder
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.result import ARRAYS, RESULT, read_run
from jaxrender.pipelines.scene import input_files


class Exported(NamedTuple):
    """Where the files are, and what there is to say of them."""

    folder: Path
    sentences: tuple[str, ...]


def export(
    result: Path,
    to: str,
    out: Path | None = None,
    lossy: bool = False,
    force: bool = False,
    progress: Progress | None = None,
) -> Exported:
    """Write a result in a format, or in all that can hold it (``to="all"``).

    ``out`` is by default a folder beside the result.  What a format cannot hold is refused, unless
    ``lossy``.  Raises ``InputError`` for an unknown format, a folder without a result, a result
    that lacks what the format needs, and a folder that holds something else.
    """
    progress = progress or SilentProgress()
    names = tuple(FORMATS) if to == ALL else (to,)
    for name in names:
        format_named(name)
    run = read_run(result)
    out = out or result.resolve().with_name(f"{result.resolve().name}_{to}")
    if out.resolve() == result.resolve():
        raise InputError(f"--out {out}: is the result itself; choose another folder")
    made_from = [result / RESULT, *(p for p in (result / ARRAYS,) if p.is_file())]
    made_from += input_files(run.config)
    digest = fingerprint(run.config, made_from, purpose=f"export {to} {lossy}")
    if prepare(out, digest, force) is FolderState.FINISHED:
        progress.note(f"{out}: exported before; reused (--force: anew)")
        return Exported(out, ())
    with progress.stage("read"):
        held = contents_of(run)
    sections: list[Section] = []
    left_out: list[str] = []
    with result_folder(out, digest, force) as folder:
        for name in names:
            with progress.stage(name):
                asked = _prepared(name, held, result, lossy, alone=to != ALL)
                if isinstance(asked, str):
                    left_out.append(asked)
                    continue
                sections.append(_written(name, asked, folder, own_folder=to == ALL))
        _write_readme(folder, held.contents, sections, left_out)
    return Exported(out, tuple(_said(sections, left_out)))


def _prepared(name: str, held: Held, result: Path, lossy: bool, *, alone: bool) -> Prepared | str:
    """Prepare a format; where that cannot be, say why, or raise it if nothing else was asked."""
    kind, contents = format_named(name), held.contents
    why = None
    missing = missing_of(contents, kind)
    asked = None
    if missing:
        why = (
            f"{result}: holds no {' and no '.join(missing)}, which the format {name} needs; "
            "choose another format"
        )
    else:
        try:
            asked = kind.prepare(contents)
        except InputError as error:
            if alone:
                raise
            return str(error)
        of_all = () if kind.needs == (MATERIAL,) else held.losses
        asked = asked._replace(losses=(*of_all, *asked.losses))
        if asked.losses and not lossy:
            lost = "; ".join(asked.losses)
            why = f"{result}: the format {name} would lose {lost}. Give --lossy to go on"
    if why is None:
        assert asked is not None
        return asked
    if alone:
        raise InputError(why)
    return why


def _written(name: str, asked: Prepared, folder: Path, *, own_folder: bool) -> Section:
    """Write a format's files, in a folder of their own where there are several formats."""
    place = folder / name if own_folder else folder
    place.mkdir(exist_ok=True)
    found = asked.write(place)
    parts = found.parts
    if own_folder:
        parts = tuple(Part(f"{name}/{part.file}", part.about) for part in parts)
    return Section(name, FORMATS[name].about, parts, asked.losses, found.remarks)


def _write_readme(
    folder: Path, contents: Contents, sections: list[Section], left_out: list[str]
) -> None:
    text = readme_text(contents, sections, left_out)
    (folder / README).write_text(text, encoding="utf-8")


def _said(sections: list[Section], left_out: list[str]) -> list[str]:
    """Sum the export up for a terminal."""
    said = []
    for section in sections:
        said.append(f"{section.name}: {', '.join(part.file for part in section.parts)}")
        said += [f"  lost: {loss}" for loss in section.losses]
        said += [f"  {remark}" for remark in section.remarks]
    return [*said, *(f"left out: {sentence}" for sentence in left_out)]
