"""Formats of captures, each known by what it has in a folder, and the reading of any of them."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from jaxrender.errors import InputError
from jaxrender.io.captures import (
    colmap,
    diligent,
    flash,
    metashape,
    mitsuba,
    objects_with_lighting,
    opencv,
    stanford_orb,
    transforms,
)
from jaxrender.io.captures.capture import Capture
from jaxrender.io.captures.contents import Contents
from jaxrender.io.captures.paths import Looking


class Format(NamedTuple):
    """A format: what it is known by, how such files are found in a folder, and their reader.

    ``instead_of`` is a format that would take the same files for its own, without what stands
    beside them; of several files of a folder the first is then meant.
    """

    looked_for: str
    find: Callable[[Path], list[Path]]
    read: Callable[[Path, Looking], Contents]
    instead_of: str | None = None


FORMATS: dict[str, Format] = {
    "transforms": Format(
        transforms.LOOKED_FOR, transforms.find_transforms, transforms.read_transforms
    ),
    "colmap": Format(colmap.LOOKED_FOR, colmap.find_colmap, colmap.read_colmap),
    "opencv": Format(opencv.LOOKED_FOR, opencv.find_opencv, opencv.read_opencv),
    "diligent": Format(diligent.LOOKED_FOR, diligent.find_diligent, diligent.read_diligent),
    "flash": Format(flash.LOOKED_FOR, flash.find_flash, flash.read_flash),
    "mitsuba": Format(mitsuba.LOOKED_FOR, mitsuba.find_mitsuba, mitsuba.read_mitsuba),
    "metashape": Format(metashape.LOOKED_FOR, metashape.find_metashape, metashape.read_metashape),
    "stanford-orb": Format(
        stanford_orb.LOOKED_FOR,
        stanford_orb.find_stanford_orb,
        stanford_orb.read_stanford_orb,
        instead_of="transforms",
    ),
    "objects-with-lighting": Format(
        objects_with_lighting.LOOKED_FOR,
        objects_with_lighting.find_objects_with_lighting,
        objects_with_lighting.read_objects_with_lighting,
    ),
}


# How files of other formats end; a transforms.json may end in any other way.
_FOREIGN = (".xml", ".yml", ".yaml", ".bin", ".txt")


class Recognised(NamedTuple):
    """A format that was found, and the file that it is known by."""

    name: str
    path: Path


def recognise(place: Path, name: str | None = None) -> Recognised:
    """Find the one format of a folder, or of a file in it.

    ``name`` chooses among several.  Raises InputError where none or several are found, which lists
    what was looked for, or what was found.
    """
    if not place.exists():
        raise InputError(f"{place}: no such folder; mend the path")
    if name is not None and name not in FORMATS:
        raise InputError(f"{place}: no format {name!r}; known are {', '.join(FORMATS)}")
    folder = place if place.is_dir() else place.parent
    asked = FORMATS if name is None else {name: FORMATS[name]}
    found = [
        Recognised(one, path)
        for one, form in asked.items()
        for path in form.find(folder)
        if place.is_dir() or path.samefile(place)
    ]
    special = [one for one in found if FORMATS[one.name].instead_of]
    plain = {FORMATS[one.name].instead_of for one in special}
    found = [*special[:1], *(one for one in found if one not in special and one.name not in plain)]
    if len(found) == 1:
        return found[0]
    if not found:
        looked = "; ".join(f"{one}: {form.looked_for}" for one, form in asked.items())
        raise InputError(f"{place}: nothing recognised; looked for {looked}")
    listed = ", ".join(f"{one.name} ({one.path.relative_to(folder)})" for one in found)
    remedy = "choose by --format NAME"
    if len({one.name for one in found}) == 1:
        remedy = "give the path of one instead of the folder"
    raise InputError(f"{place}: several captures: {listed}; {remedy}")


def read_contents(recognised: Recognised, looking: Looking) -> Contents:
    """Read all that a recognised file and what is beside it say."""
    return FORMATS[recognised.name].read(recognised.path, looking)


def read_capture(
    path: str | Path,
    images: str | Path | None = None,
    *,
    allow_outside: bool = False,
    require_images: bool = True,
    foreign: bool = True,
) -> Capture:
    """Read the cameras and the paths of a capture, not yet its pixels.

    ``path`` is a ``transforms.json``, or a file or a folder of any of the ``FORMATS``.
    ``images``: the folder in which paths are looked up instead of the file's own.
    ``require_images=False``: the cameras alone are wanted, the pictures need not exist.
    ``foreign=False``: only a ``transforms.json`` is, which stands for all that is read.
    A frame is named by its file without folder and suffix; where two would share that name, by the
    whole path with ``_`` between folders; where that does not help, by number and file.
    Raises InputError that names the file, the frame and the key.
    """
    path = Path(path)
    folder = path if path.is_dir() else path.parent
    looking = Looking(Path(images) if images else folder, allow_outside, require_images)
    is_foreign = path.is_dir() or (path.is_file() and path.suffix.lower() in _FOREIGN)
    if is_foreign and foreign:
        return read_contents(recognise(path), looking).capture
    if is_foreign and path.is_file():
        raise InputError(f"{path}: no transforms.json; `jaxrender import` makes one of it")
    return transforms.read_transforms(path, looking).capture
