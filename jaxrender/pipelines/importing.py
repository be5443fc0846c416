"""The capture of another program, written as one of ours, with a config that fits it.

Photographs stay where they are, unless they are to be copied.  The config says in comments what the
folder of the other program says, and what was assumed where it says nothing.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry import Mesh
from jaxrender.io import (
    Capture,
    Frame,
    read_environment,
    read_mesh,
    write_capture,
    write_curve,
    write_environment,
    write_mesh,
)
from jaxrender.io.captures import (
    Contents,
    Looking,
    StatedEnvironment,
    StatedLight,
    StatedSphere,
    read_contents,
    recognise,
)
from jaxrender.io.images import image_size
from jaxrender.pipelines.config import load_run_config
from jaxrender.pipelines.imported_config import config_text
from jaxrender.pipelines.output import FolderState, fingerprint_of, prepare, result_folder
from jaxrender.pipelines.photographs_found import examined
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.shapes import Float

CONFIG = "capture.yaml"
_CAMERAS, _LIGHTS, _PANORAMA = "transforms.json", "lights.json", "environment.exr"
_RESPONSE = "response.txt"


class ImportOptions(NamedTuple):
    """What an import is told beside the folder.

    ``format`` chooses among several that are found.  ``frame``: whether cameras are as they were
    before a program moved all of them (original), or as its file has them.  ``images`` is the
    folder that paths start from instead of the file's own.
    """

    mesh: Path | None = None
    sphere: StatedSphere | None = None
    format: str | None = None
    frame: Literal["original", "file"] = "original"
    images: Path | None = None
    allow_outside: bool = False
    copy: bool = False


class Imported(NamedTuple):
    """The folder that was written, and the sentences of its config."""

    folder: Path
    sentences: tuple[str, ...]


def import_capture(
    place: Path,
    out: Path,
    options: ImportOptions,
    force: bool = False,
    progress: Progress | None = None,
) -> Imported:
    """Write a folder with ``transforms.json`` and ``capture.yaml``; it appears whole or not at all.

    ``place`` is a folder of a program whose format is known, or a file in it.  Raises
    ``InputError`` where nothing or too much is recognised, where photographs are missing or of
    other sizes than their cameras, and where the shape is not known.
    """
    progress = progress or SilentProgress()
    recognised = recognise(place, options.format)
    root = place if place.is_dir() else place.parent
    looking = Looking(
        options.images or root, options.allow_outside, original=options.frame == "original"
    )
    with progress.stage("read cameras and shape"):
        contents = _shaped(read_contents(recognised, looking), place, options)
    with progress.stage("look at the photographs"):
        contents = examined(contents, progress.advance)
        digest = _digest(contents, options)
    sentences = (*contents.found, *contents.assumed)
    if prepare(out, digest, force) is FolderState.FINISHED:
        return Imported(out, (f"imported before, in {out}", *sentences))
    with progress.stage("write"), result_folder(out, digest, force) as folder:
        _write(folder, recognised.name, contents, options, looking.folder)
        # What is written is what a fit takes.
        load_run_config(folder / CONFIG)
    return Imported(out, sentences)


def _shaped(contents: Contents, place: Path, options: ImportOptions) -> Contents:
    """Choose the shape: the one that is told, or else the one that the format brings."""
    if options.mesh is not None and options.sphere is not None:
        raise InputError(f"{place}: a mesh and a sphere are told; give one of --mesh, --sphere")
    if options.mesh is not None:
        contents = contents._replace(mesh=options.mesh, mesh_placed=None, sphere=None, square=None)
    elif options.sphere is not None:
        contents = contents._replace(mesh=None, sphere=options.sphere, square=None)
    elif contents.mesh is not None:
        said = f"the shape is {contents.mesh.name}, which lies beside the cameras"
        contents = contents._replace(found=(*contents.found, said))
    elif contents.sphere is None and contents.square is None:
        raise InputError(
            f"{place}: the shape of the object is not known; give --mesh FILE (.obj, .ply, .glb, "
            ".stl), or --sphere X,Y,Z,RADIUS in world units"
        )
    if contents.mesh is not None:
        # A mesh that cannot be read is told now.
        read_mesh(contents.mesh)
    return contents


def _digest(contents: Contents, options: ImportOptions) -> str:
    """Make the fingerprint; photographs count by name, size and time, for they may be many."""
    pictures = []
    for frame in contents.capture.frames:
        for path in filter(None, (frame.image_path, frame.mask_path)):
            about = path.stat()
            pictures.append((str(path.resolve()), about.st_size, about.st_mtime_ns))
    files = [*contents.files, *([contents.mesh] if contents.mesh else [])]
    settings = json.dumps([repr(options), repr(contents.light), pictures])
    return fingerprint_of("import", settings, files)


def _write(folder: Path, name: str, contents: Contents, options: ImportOptions, root: Path) -> None:
    """Write all files of a capture."""
    frames = contents.capture.frames
    light, mesh = contents.light, contents.mesh
    if options.copy:
        frames = tuple(_copied(folder, frame) for frame in frames)
        root = folder
    if mesh is not None:
        mesh = _shape_file(folder, mesh, contents.mesh_placed, options.copy)
    elif contents.square is not None:
        mesh = Path("shape.obj")
        write_mesh(folder / mesh, _square(contents.square.side))
    parts = _parts(frames, light)
    for name_of_part, own in parts.items():
        write_capture(folder / name_of_part, Capture(own, root / _CAMERAS))
    if contents.curve is not None:
        write_curve(folder / _RESPONSE, contents.curve, "as the format says")
    if light.per_frame is not None:
        _write_lights(folder / _LIGHTS, contents)
    panorama = light.environment
    if panorama is not None and (options.copy or _is_other(panorama)):
        panorama = _written(folder, panorama, _PANORAMA)
    if light.environments is not None:
        own = (
            _written(folder, one, f"environments/{frame.name}.exr")
            for one, frame in zip(light.environments, frames)
        )
        light = light._replace(environments=tuple(own))
    text = config_text(
        name,
        contents._replace(mesh=mesh, light=light._replace(environment=panorama)),
        parts=tuple(parts),
        images=None if options.copy else root.resolve(),
        outside=not all(_inside(frame, root) for frame in frames),
    )
    (folder / CONFIG).write_text(text, encoding="utf-8")


def _parts(frames: tuple[Frame, ...], light: StatedLight) -> dict[str, tuple[Frame, ...]]:
    """Name the files of cameras: one of all photographs, or one of each that has its own light."""
    if light.environments is None:
        return {_CAMERAS: frames}
    return {f"transforms_{frame.name}.json": (frame,) for frame in frames}


def _copied(folder: Path, frame: Frame) -> Frame:
    """Copy a photograph and its mask, named by the frame."""
    image = folder / "images" / f"{frame.name}{frame.image_path.suffix}"
    image.parent.mkdir(exist_ok=True)
    shutil.copyfile(frame.image_path, image)
    mask = frame.mask_path
    if mask is not None:
        own = folder / "masks" / f"{frame.name}{mask.suffix}"
        own.parent.mkdir(exist_ok=True)
        shutil.copyfile(mask, own)
        mask = own
    return frame._replace(image_path=image, mask_path=mask)


def _shape_file(
    folder: Path, mesh: Path, placed: Float[np.ndarray, "4 4"] | None, copy: bool
) -> Path:
    """Write the mesh where it lies in the world, copy it, or leave it."""
    if placed is not None:
        own = read_mesh(mesh)
        turn = placed[:3, :3] / np.cbrt(np.linalg.det(placed[:3, :3]))
        vertices = own.vertices @ placed[:3, :3].T + placed[:3, 3]
        moved = Mesh(vertices, own.faces, own.normals @ turn.T, own.texture_coordinates)
        write_mesh(folder / "shape.ply", moved)
        return Path("shape.ply")
    if copy:
        shutil.copyfile(mesh, folder / f"shape{mesh.suffix}")
        return Path(f"shape{mesh.suffix}")
    return mesh.resolve()


def _square(side: float) -> Mesh:
    """Make a flat square, with the texture as its pictures show it."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    vertices = np.column_stack([side * (corners - 0.5), np.zeros(4)])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh(vertices, faces, texture_coordinates=corners[faces])


def _inside(frame: Frame, root: Path) -> bool:
    paths = (frame.image_path, frame.mask_path)
    return all(p is None or p.resolve().is_relative_to(root.resolve()) for p in paths)


def _write_lights(path: Path, contents: Contents) -> None:
    assert contents.light.per_frame is not None
    entries = {
        frame.name: [{key: list(value) for key, value in one._asdict().items()} for one in sources]
        for frame, sources in zip(contents.capture.frames, contents.light.per_frame)
    }
    path.write_text(json.dumps(entries, indent=1) + "\n", encoding="utf-8")


def _is_other(panorama: StatedEnvironment) -> bool:
    """Whether a panorama is laid out as no config can say."""
    return panorama.turn is not None or panorama.at_poles


def _written(folder: Path, panorama: StatedEnvironment, name: str) -> StatedEnvironment:
    """Copy a panorama, turned as the world has it."""
    (folder / name).parent.mkdir(exist_ok=True)
    if not _is_other(panorama):
        own = Path(name).with_suffix(panorama.path.suffix)
        shutil.copyfile(panorama.path, folder / own)
        return panorama._replace(path=own)
    image_size(panorama.path)
    environment = read_environment(
        panorama.path,
        panorama.convention,
        panorama.scale,
        yaw=panorama.yaw,
        mirrored=panorama.mirrored,
        at_poles=panorama.at_poles,
    )
    if panorama.turn is not None:
        environment = environment.turned(panorama.turn)
    write_environment(folder / name, environment)
    return StatedEnvironment(Path(name), "z-up")
