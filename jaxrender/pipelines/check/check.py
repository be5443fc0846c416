"""Goes through a capture: how it is meant, what is wrong with it, what it can tell."""

from pathlib import Path
from typing import NamedTuple

from jaxrender.errors import InputError
from jaxrender.pipelines.check.conventions import FoundConventions, RawCapture, find_conventions
from jaxrender.pipelines.check.mend import Changes, place_in_words, with_changes, write_changes
from jaxrender.pipelines.check.mesh import about_mesh
from jaxrender.pipelines.config import RunConfig, load_run_config
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.scene import shape_of

# The config of a folder.
CONFIG = "capture.yaml"


class Checked(NamedTuple):
    """What a check found; ``wrong`` are the sentences about what should be mended.

    ``config`` is what the config should say, ``changes`` are the keys in which it does not.
    """

    path: Path
    config: RunConfig
    captures: tuple[RawCapture, ...]
    conventions: tuple[FoundConventions, ...]
    changes: Changes
    wrong: tuple[str, ...]
    remarks: tuple[str, ...]

    @property
    def is_fine(self) -> bool:
        """Whether nothing is wrong."""
        return not self.wrong


def config_path(capture: Path) -> Path:
    """Find the config that is meant: a file, or the one in a folder."""
    if not capture.is_dir():
        return capture
    path = capture / CONFIG
    if not path.is_file():
        raise InputError(f"{capture}: the folder has no {CONFIG}; give the config itself")
    return path


def check(path: Path, progress: Progress | None = None) -> Checked:
    """Check the capture of a config.

    Raises ``InputError`` for what cannot be read, and for photographs that a recipe renders.
    """
    progress = progress or SilentProgress()
    config = load_run_config(path)
    if config.recipes:
        raise InputError(
            f"{path}: the photographs are those of a recipe, whose conventions are known; "
            "check looks at photographs of your own (capture.transforms)"
        )
    assert config.capture.geometry is not None
    with progress.stage("load"):
        raws = tuple(RawCapture.of(config, k) for k in range(1 + len(config.captures)))
        remarks = about_mesh(shape_of(config.capture.geometry))
    changes: dict = {}
    found = []
    meant = config
    with progress.stage("conventions"):
        for raw in raws:
            one = find_conventions(meant, raw)
            found.append(one)
            changes |= one.changes
            meant = with_changes(config, changes)
    wrong = [
        f"{place_in_words(place)} should be {_said(value)}" for place, value in changes.items()
    ]
    for one in found:
        if one.framing is None or not one.framing.fits:
            wrong.append(one.sentences[0])
        if one.orientation is not None and not (one.orientation.why or one.orientation.fits):
            wrong.append(one.orientation.sentences()[0])
    return Checked(path, meant, raws, tuple(found), changes, tuple(wrong), tuple(remarks))


def fix(found: Checked) -> None:
    """Write what was found into the config's file."""
    if found.changes:
        write_changes(found.path, found.changes)


def summary_of(found: Checked, fixed: bool) -> str:
    """Sum a check up for a terminal."""
    lines = []
    for raw, one in zip(found.captures, found.conventions):
        lines.append(f"{raw.capture.source.name}: {len(raw.images)} photographs")
        lines += [f"  {sentence}" for sentence in one.sentences]
    lines += [f"  {remark}" for remark in found.remarks]
    if found.changes and fixed:
        lines.append(f"written into {found.path}:")
        lines += [f"  {place_in_words(p)}: {_said(v)}" for p, v in found.changes.items()]
    left = found.wrong[len(found.changes) :] if fixed else found.wrong
    if left:
        lines.append("wrong:")
        lines += [f"  {sentence}" for sentence in left]
        if found.changes and not fixed:
            lines.append("jaxrender check --fix writes these keys into the config")
    elif not found.changes:
        lines.append("nothing is wrong")
    return "\n".join(lines)


def _said(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(f'{x:g}' for x in value)}]"
    return f"{value:g}" if isinstance(value, float) else str(value)
