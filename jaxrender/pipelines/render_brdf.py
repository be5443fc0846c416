"""A BRDF by itself, on a ball or a mesh: its pictures under a light, by the exact integral."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import lobe_width
from jaxrender.errors import InputError
from jaxrender.geometry import Shape, Sphere, observe
from jaxrender.inverse import KnownLight
from jaxrender.io import Frame, read_capture, read_environment, read_mesh, write_image
from jaxrender.lighting import DirectionalSources
from jaxrender.pipelines.brdf_sources import files_of, source_of
from jaxrender.pipelines.config import ViewsConfig
from jaxrender.pipelines.exact_light import exact_forward
from jaxrender.pipelines.output import FolderState, fingerprint_of, prepare, result_folder
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.scene import fault_of
from jaxrender.pipelines.synth import cameras_of
from jaxrender.reflection import render_view

# The camera that looks at the object where none is given: a ball of radius 1 fills its picture.
_VIEW = ViewsConfig(count=1, start_degrees=-90.0, elevation_degrees=15.0, width=128, height=128)


class Stage(NamedTuple):
    """What a BRDF is shown on: a light, a mesh (None: a ball of radius 1) and cameras (None: one).

    The one looks along +Y, a little from above.
    """

    environment: Path
    convention: str = "z-up"
    mesh: Path | None = None
    cameras: Path | None = None


def render_brdf(
    named: str, out: Path, stage: Stage, force: bool = False, progress: Progress | None = None
) -> Path:
    """Render a source of ``brdf_sources`` into ``out`` as EXR, with alpha = coverage.

    Raises ``InputError`` for an unreadable source, light, mesh or camera, and where none sees it.
    """
    progress = progress or SilentProgress()
    inputs = [path for path in (stage.environment, stage.mesh, stage.cameras) if path is not None]
    for path in inputs:
        if not path.is_file():
            raise InputError(f"{path}: no such file")
    settings = json.dumps([named, stage.convention])
    digest = fingerprint_of("render a BRDF", settings, [*inputs, *files_of(named)])
    if prepare(out, digest, force) is FolderState.FINISHED:
        progress.note(f"{out}: rendered before; reused (--force: anew)")
        return out
    with progress.stage("read"):
        source = source_of(named)
        brdf = source.colours
        for sentence in source.said:
            progress.note(f"{source.name}: {sentence}")
        with fault_of(str(stage.environment)):
            environment = read_environment(stage.environment, stage.convention)
            light = KnownLight(environment, DirectionalSources.none())
        shape = Sphere(np.zeros(3), 1.0) if stage.mesh is None else read_mesh(stage.mesh)
    views = [(frame, observe(frame.camera, shape)) for frame in frames_of(stage, shape)]
    if not any(view.hit.any() for _, view in views):
        raise InputError(f"{stage.cameras}: no camera sees the object; mend the cameras")
    with progress.stage("render"), result_folder(out, digest, force) as folder:
        forward = exact_forward(light, lobe_width(brdf), shape, condensed=True)
        for number, (frame, view) in enumerate(views):
            image = np.zeros((*view.hit.shape, 4))
            image[..., 3] = view.hit
            # A series of few terms may be negative, which no picture is.
            image[..., :3] = np.maximum(render_view(brdf, view, forward), 0)
            write_image(folder / f"{frame.name}.exr", image)
            progress.advance((number + 1) / len(views))
    return out


def frames_of(stage: Stage, shape: Shape) -> tuple[Frame, ...]:
    """Read the cameras of a stage, or place the one that looks at the shape."""
    if stage.cameras is not None:
        return read_capture(stage.cameras, require_images=False, foreign=False).frames
    low, high = np.asarray(shape.bounds())
    radius = 1.0 if stage.mesh is None else float(np.linalg.norm(high - low)) / 2
    views = _VIEW.model_copy(update={"distance": _VIEW.distance * radius})
    (camera,) = cameras_of(views, (low + high) / 2)
    return (Frame("view", camera, Path("view.exr"), None, None),)
