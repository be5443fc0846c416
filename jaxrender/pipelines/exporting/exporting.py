"""``jaxrender export``: from a result folder to a folder of files for other programs."""

from pathlib import Path
from typing import NamedTuple

from jaxrender.errors import InputError
from jaxrender.io.exports import Contents, Part, plain_name
from jaxrender.pipelines.brdf_sources import files_of, names_result
from jaxrender.pipelines.exporting.contents import Held, contents_of, contents_of_source
from jaxrender.pipelines.exporting.formats import (
    ALL,
    FORMATS,
    MATERIAL,
    OF_MATERIALS,
    format_named,
    missing_of,
)
from jaxrender.pipelines.exporting.prepared import Prepared
from jaxrender.pipelines.exporting.readme import README, Section, readme_text
from jaxrender.pipelines.output import (
    FolderState,
    fingerprint,
    fingerprint_of,
    prepare,
    result_folder,
)
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.result import read_run
from jaxrender.pipelines.scene import input_files


class Exported(NamedTuple):
    """Where the files are, and what there is to say of them."""

    folder: Path
    sentences: tuple[str, ...]


def export(
    result: Path | str,
    to: str,
    out: Path | None = None,
    lossy: bool = False,
    force: bool = False,
    progress: Progress | None = None,
) -> Exported:
    """Write a result, or a BRDF, in a format, or in all that can hold it (``to="all"``).

    ``result`` is the folder of a fit, or any other source of ``brdf_sources``, shown on a ball.
    ``out`` is by default a folder beside the result.  What a format cannot hold is refused, unless
    ``lossy``.  Raises ``InputError`` for an unknown format, a folder without a result, a result
    that lacks what the format needs, and a folder that holds something else.
    """
    progress = progress or SilentProgress()
    names = tuple(FORMATS) if to == ALL else (to,)
    for name in names:
        format_named(name)
    path = Path(result)
    is_result = names_result(path)
    stem = path.resolve().name if is_result else plain_name(path.name)
    out = out or path.resolve().with_name(f"{stem}_{to}")
    if out.resolve() == path.resolve():
        raise InputError(f"--out {out}: is the result itself; choose another folder")
    if not is_result:
        names = tuple(name for name in names if name in OF_MATERIALS)
        if not names:
            raise InputError(
                f"{result}: a BRDF brings no light, which the format {to} needs; choose one of "
                f"{', '.join(OF_MATERIALS)}"
            )
    purpose, run = f"export {to} {lossy}", None
    if is_result:
        run = read_run(path)
        digest = fingerprint(run.config, [*files_of(path), *input_files(run.config)], purpose)
    else:
        digest = fingerprint_of(purpose, str(result), files_of(path))
    if prepare(out, digest, force) is FolderState.FINISHED:
        progress.note(f"{out}: exported before; reused (--force: anew)")
        return Exported(out, ())
    with progress.stage("read"):
        held, said = (contents_of(run), ()) if run else contents_of_source(str(result))
        for sentence in said:
            progress.note(sentence)
    sections: list[Section] = []
    left_out: list[str] = []
    with result_folder(out, digest, force) as folder:
        for name in names:
            with progress.stage(name):
                asked = _prepared(name, held, path, lossy, alone=to != ALL)
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
            f"choose one of {', '.join(_possible(contents))}"
        )
    else:
        try:
            asked = kind.prepared(contents)
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


def _possible(contents: Contents) -> list[str]:
    """List the formats of which the contents lack nothing."""
    return [name for name, kind in FORMATS.items() if not missing_of(contents, kind)]


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
