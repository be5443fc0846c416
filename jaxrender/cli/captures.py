"""The command about captures of other programs: ``import``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from jaxrender.cli import process
from jaxrender.cli.app import DONE, app, examples
from jaxrender.cli.reporting import AS_USUAL, Reporting
from jaxrender.errors import InputError


@app.command(
    name="import",
    help_epilogue=examples(
        "import photos --mesh cat.ply --out cat",
        "import scene/sparse/0 --images scene/images --sphere 0,0,0,1 --out ball",
    ),
)
def import_(
    folder: Path,
    /,
    *,
    out: Path,
    mesh: Path | None = None,
    sphere: str | None = None,
    format: str | None = None,
    frame: Literal["original", "file"] = "original",
    images: Path | None = None,
    allow_outside: bool = False,
    copy: bool = False,
    force: bool = False,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Make a capture of what another program wrote, and a config that fits it.

    The folder gets transforms.json and capture.yaml, which says what was found and assumed.

    Parameters
    ----------
    folder
        Folder of transforms.json, of a COLMAP model or of another known format, or a file in it.
    out
        Folder to write the capture into.
    mesh
        Shape of the object (.obj, .ply, .glb, .stl), in the world of the cameras.
    sphere
        Shape of a ball in the place of a mesh: centre and radius, as 0,0,0,1.
    format
        The format to read, where several are found.
    frame
        Undo what a program did to all cameras (original), or leave them as its file has them.
    images
        Folder that the paths of photographs start from, instead of the file's own.
    allow_outside
        Let paths in the file lead outside its folder.
    copy
        Copy photographs and mesh into the capture.
    force
        Replace an earlier import of something else.
    """
    from jaxrender.pipelines.importing import CONFIG, ImportOptions, import_capture

    options = ImportOptions(mesh, _sphere(sphere), format, frame, images, allow_outside, copy)
    imported = import_capture(folder, out.resolve(), options, force, progress=reporting.progress())
    for sentence in imported.sentences:
        process.say(sentence)
    process.say(f"capture: {out}; next: jaxrender check {out}, then jaxrender fit {out / CONFIG}")
    return DONE


def _sphere(text: str | None):
    """Read a centre and a radius."""
    from jaxrender.io.captures import StatedSphere

    if text is None:
        return None
    try:
        x, y, z, radius = (float(word) for word in text.split(","))
    except ValueError:
        raise InputError(f"--sphere {text}: wanted X,Y,Z,RADIUS, such as 0,0,0,1") from None
    if not radius > 0:
        raise InputError(f"--sphere {text}: the radius must be positive")
    return StatedSphere((x, y, z), radius)
