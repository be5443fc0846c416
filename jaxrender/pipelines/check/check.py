"""Goes through a capture: how it is meant, what is wrong with it, what it can tell."""

import math
from pathlib import Path
from typing import NamedTuple

from jaxrender.errors import InputError
from jaxrender.inverse.conventions import FoundFraming
from jaxrender.io.atomic import replacing
from jaxrender.pipelines.analysis.forecast import ALL, analyze_config
from jaxrender.pipelines.check.conventions import (
    FoundConventions,
    RawCapture,
    find_conventions,
    lighting_of,
)
from jaxrender.pipelines.check.mend import Changes, place_in_words, with_changes, write_changes
from jaxrender.pipelines.check.mesh import about_mesh
from jaxrender.pipelines.check.page import page_of
from jaxrender.pipelines.check.photographs import Judged, judged
from jaxrender.pipelines.config import RunConfig, load_run_config
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.scene import shape_of

# The config of a folder, and the page that is written.
CONFIG, PAGE = "capture.yaml", "check.html"
# A silhouette that overlaps less is wrong, as is an exposure that is off by more than this factor.
# From the lesser factor on it is worth a remark: gloss, too, is brighter from some sides.
_LEAST_OVERLAP, _EXPOSURE, _PERHAPS_EXPOSURE = 0.7, 1.3, 1.15
# It is sure beyond so many deviations of the ratios of a pair.  Where they spread by more than the
# latter, gloss may make any factor.
_SURE, _GLOSSY = 3.0, 0.15
# More clipped values, less sharpness than that of other photographs, or a darkest hundredth of
# more than this part of the object's mean, are worth a remark.
_CLIPPED, _BLURRED, _HAZE = 0.02, 0.3, 0.2


class Checked(NamedTuple):
    """What a check found; ``wrong`` are the sentences about what should be mended.

    The first of them are about ``changes``, the keys in which the config does not say what it
    should; ``config`` is what it should say.  ``prospects`` are what can be recovered.
    """

    path: Path
    config: RunConfig
    captures: tuple[RawCapture, ...]
    conventions: tuple[FoundConventions, ...]
    changes: Changes
    wrong: tuple[str, ...]
    remarks: tuple[str, ...]
    photographs: tuple[Judged, ...]
    prospects: str

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
    photographs: list[Judged] = []
    with progress.stage("photographs"):
        for raw, one in zip(raws, found):
            if one.framing is not None and one.framing.fits:
                photographs += _judged(meant, raw, one.framing)
    wrong += [said for one in photographs for said in _wrong_with(one)]
    remarks += [said for one in photographs for said in _remarks_on(one)]
    prospects = "The shape is not where the photographs show it: mend that first."
    if photographs:
        prospects = _prospects(meant, progress)
    return Checked(
        path,
        meant,
        raws,
        tuple(found),
        changes,
        tuple(wrong),
        tuple(remarks),
        tuple(photographs),
        prospects,
    )


def _judged(config: RunConfig, raw: RawCapture, framing: FoundFraming) -> tuple[Judged, ...]:
    assert config.capture.geometry is not None
    lighting = lighting_of(config, raw)
    shape = shape_of(config.capture.geometry)
    try:
        return judged(raw, framing.framing, shape, one_light=lighting.per_frame is None)
    except InputError:
        # No pixel is usable, which the overlap says more plainly.
        return ()


def _wrong_with(one: Judged) -> list[str]:
    found = []
    if one.overlap is not None and one.overlap < _LEAST_OVERLAP:
        found.append(f"{one.name}: the silhouette overlaps the shape by {one.overlap:.2f} only")
    if _has_other_exposure(one):
        found.append(
            f"{one.name}: {one.exposure:.2f} times as bright as the others at the same points; "
            "give its exposure, or solve.free_exposure: true"
        )
    return found


def _has_other_exposure(one: Judged) -> bool:
    """Whether a photograph is off by more than its gloss can be."""
    if one.exposure is None or one.exposure_error is None:
        return False
    least = max(math.log(_EXPOSURE), _SURE * one.exposure_error)
    return one.exposure_error < _GLOSSY and abs(math.log(one.exposure)) > least


def _off(factor: float) -> float:
    """Take a factor to either side."""
    return max(factor, 1 / factor)


def _remarks_on(one: Judged) -> list[str]:
    found = []
    doubtful = one.exposure is not None and not _has_other_exposure(one)
    if one.exposure is not None and doubtful and _off(one.exposure) > _PERHAPS_EXPOSURE:
        found.append(
            f"{one.name}: {one.exposure:.2f} times as bright as the others at the same points: by "
            "its gloss, or by its exposure (solve.free_exposure: true finds that)"
        )
    if one.clipped_at is not None:
        found.append(
            f"{one.name}: {100 * one.saturated:.2g} % of the object is clipped: values pile up at "
            f"{one.clipped_at:.4g}; capture.saturation: auto leaves them out"
        )
    elif one.saturated > _CLIPPED:
        found.append(f"{one.name}: {100 * one.saturated:.2g} % of the object is clipped")
    if one.sharpness < _BLURRED:
        found.append(f"{one.name}: blurred, {one.sharpness:.2f} of the usual sharpness")
    if one.black > _HAZE:
        found.append(
            f"{one.name}: nothing is darker than {100 * one.black:.2g} % of the object's mean; is "
            "the sensor's black level taken off?"
        )
    return found


def _prospects(config: RunConfig, progress: Progress) -> str:
    """Say what an analysis expects to recover, or why it cannot."""
    try:
        return analyze_config(config, ALL, progress).text
    except InputError as error:
        return str(error)


def write_page(found: Checked, folder: Path) -> Path:
    """Write ``check.html`` into a folder, which is made where it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / PAGE
    sentences = [said for one in found.conventions for said in one.sentences]
    title = found.path.parent.name if found.path.name == CONFIG else found.path.stem
    told = [*sentences, *found.remarks]
    page = page_of(title, told, list(found.wrong), found.photographs, found.prospects)
    with replacing(path) as aside:
        aside.write_text(page, encoding="utf-8")
    return path


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
