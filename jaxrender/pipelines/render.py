"""The views of a finished run, or new views, rendered under its light or another."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.errors import InputError
from jaxrender.geometry import Shape, SurfaceView, observe
from jaxrender.inverse import KnownLight
from jaxrender.inverse.factorization import as_points
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.photographs import camera_samples, posed
from jaxrender.inverse.prepared_light import prepare_light
from jaxrender.io import Capture, Frame, read_capture, read_environment, write_image
from jaxrender.lighting import DirectionalSources
from jaxrender.pipelines.captures import captures_of, joined, light_of_captures
from jaxrender.pipelines.config import RunConfig
from jaxrender.pipelines.deviation import MaterialCovariance, image_deviation, read_covariance
from jaxrender.pipelines.exact_light import exact_forward, with_points
from jaxrender.pipelines.output import FolderState, fingerprint, prepare, result_folder
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.result import ARRAYS, RESULT, FinishedRun, read_run
from jaxrender.pipelines.scene import (
    fault_of,
    shape_of,
)
from jaxrender.pipelines.shadows import transfer_field
from jaxrender.pipelines.subject import Subject
from jaxrender.pipelines.tasks import task_named
from jaxrender.reflection import DualForward, ForwardModel, ShadowedDual, ShadowedModel
from jaxrender.shapes import Float

MODELS = ("integral", "dual")


class Scene(NamedTuple):
    """The light and the cameras of a rendering; None stands for those of the result."""

    environment: Path | None = None
    convention: str = "z-up"
    cameras: Path | None = None


OWN_SCENE = Scene()


class Rendering(NamedTuple):
    """One view, rendered: radiance, and its standard deviation where that is known."""

    frame: Frame
    view: SurfaceView
    radiance: Float[np.ndarray, "row column channel"]
    deviation: Float[np.ndarray, "pixel channel"] | None


def render_config(
    result: Path,
    out: Path,
    model: str = "integral",
    force: bool = False,
    progress: Progress | None = None,
    *,
    scene: Scene = OWN_SCENE,
) -> Path:
    """Render every view of a finished result into ``out`` as EXR, with alpha = coverage.

    For one material each image has a ``NAME_deviation.exr``: its standard deviation to first order,
    by the covariance of the material, gain and scale included.  A recovered light is used in its
    gauge.  Raises ``InputError`` for a folder without a result and for missing input.
    """
    progress = progress or SilentProgress()
    if model not in MODELS:
        raise ValueError(f"model={model!r}: choose one of {', '.join(MODELS)}")
    run = read_run(result)
    made_from = [result / RESULT, *(p for p in (scene.environment, scene.cameras) if p)]
    missing = [path for path in made_from if not path.is_file()]
    if missing:
        raise InputError(f"{missing[0]}: no such file")
    digest = fingerprint(run.config, made_from, purpose=f"render {model} {scene.convention}")
    if prepare(out, digest, force) is FolderState.FINISHED:
        progress.note(f"{out}: rendered before; reused (--force: anew)")
        return out
    with progress.stage("render"), result_folder(out, digest, force) as folder:
        capture = capture_of_scene(run.config, scene)
        for rendered in renderings(run, scene, capture, progress, model):
            _write(rendered, folder)
    return out


def _write(rendered: Rendering, folder: Path) -> None:
    name, view = rendered.frame.name, rendered.view
    image = np.zeros((*view.hit.shape, 4))
    image[..., 3] = view.hit
    image[..., :3] = rendered.radiance
    if rendered.deviation is not None:
        picture = np.zeros_like(rendered.radiance)
        picture[view.hit] = rendered.deviation
        write_image(folder / f"{name}_deviation.exr", picture)
    write_image(folder / f"{name}.exr", image)


def capture_of_scene(config: RunConfig, scene: Scene) -> Capture:
    """Read the cameras of the scene: those of the result, or other ones in the same axes."""
    if scene.cameras is not None:
        others = read_capture(scene.cameras, require_images=False, foreign=False)
        return posed(others, config.capture.camera_axes)
    return joined([one.capture for one in captures_of(config, require_images=False)])


def light_of_run(run: FinishedRun, shape: Shape | None, scene: Scene = OWN_SCENE) -> KnownLight:
    """Find the light of a finished run: that of the scene, the recovered one, or the given one.

    Sources that have a place ask for the ``shape``.
    """
    config = run.config
    if scene.environment is not None:
        with fault_of(f"{scene.environment}"):
            other = read_environment(scene.environment, scene.convention)
            return KnownLight(other, DirectionalSources.none())
    if not config.knows_light:
        found = run.summary["lighting"]["directional"]
        sources = DirectionalSources.none()
        if found:
            # What stands beside the picture of the slow light; older results do not say it.
            shown = [source.get("irradiance_shown", source["irradiance"]) for source in found]
            energies = np.array(shown).clip(0)
            directions = np.array([source["direction"] for source in found])
            widths = np.radians([source.get("width_degrees", 0.0) for source in found])
            sources = as_points(DirectionalSources(directions, energies), widths)
        return KnownLight(read_environment(run.folder / "lighting_slow.exr"), sources)
    return light_of_captures(captures_of(config, require_images=False), shape)


def renderings(
    run: FinishedRun,
    scene: Scene,
    capture: Capture,
    progress: Progress,
    model: str = "integral",
    step: int = 1,
) -> Iterator[Rendering]:
    """Render every view of a finished result, in its own light or that of the scene.

    ``step``: of every so many rows and columns one is rendered, the first, and the others left out.
    Raises ``InputError`` for a light that the cameras or the model cannot use.
    """
    config = run.config
    assert config.capture.geometry is not None
    shape = shape_of(config.capture.geometry)
    light = light_of_run(run, shape, scene)
    subject = task_named(run.config.task).subject(run, shape)
    if model == "dual" and not isinstance(subject.lobe, Glossy):
        raise InputError(
            f"{run.folder}: --model dual needs a lobe about the reflected direction, which this "
            "material lacks; use --model integral"
        )
    covariance = _covariance(config, run.folder, scene, progress)
    if light.varies and light.frames != len(capture.frames):
        raise InputError(
            f"{scene.cameras}: the light of the result differs between its photographs; new "
            "cameras need an --environment"
        )
    scale, gains = float(run.summary.get("scale", 1.0)), run.summary.get("gains", {})
    shared: ForwardModel | ShadowedModel | None = None
    for number, frame in enumerate(capture.frames):
        view = SurfaceView(*(part[::step, ::step] for part in observe(frame.camera, shape)))
        environment, sources = light.environment_of(number), light.sources_of(number)
        lit = environment is not None or bool(np.any(np.asarray(sources.irradiance) > 0))
        radiance, deviation = np.zeros((*view.hit.shape, 3)), None
        if lit and view.hit.any():
            if light.varies or shared is None:
                shared = _forward(light.of_frame(number), subject, model, shape, view)
            gain = float(gains.get(frame.name, 1.0))
            image = subject.image(view, shared)
            radiance = scale * gain * image
            deviation = subject.deviation(view, shared)
            if deviation is not None:
                deviation = scale * gain * deviation
            slopes = None if covariance is None else subject.slopes(view, shared)
            if covariance is not None and slopes is not None:
                which = list(gains).index(frame.name) if frame.name in gains else None
                deviation = image_deviation(
                    covariance.of_frame(which, subject.amplitudes, subject.numbers),
                    slopes,
                    image[view.hit],
                    gain,
                    scale,
                )
        yield Rendering(frame, view, radiance, deviation)
        progress.advance((number + 1) / len(capture.frames))


def _covariance(
    config: RunConfig, folder: Path, scene: Scene, progress: Progress
) -> MaterialCovariance | None:
    """Read the material's covariance; where there is none, say why."""
    if config.task not in ("brdf", "factorize"):
        return None
    if config.task == "factorize" and scene.environment is None:
        progress.note(
            "no standard deviations: light and material were recovered together, and so are their "
            "errors; give --environment to see those of the material"
        )
        return None
    found = read_covariance(folder / ARRAYS)
    if found is None:
        progress.note(f"{folder}: no standard deviations: the result has no covariance")
    return found


def _forward(
    light: KnownLight, subject: Subject, model: str, shape: Shape, view: SurfaceView
) -> ForwardModel | ShadowedModel:
    """Prepare one photograph's light for either model."""
    if model == "integral":
        return exact_forward(light, subject.width, shape)
    points = light.points_of(0)
    if points is not None:
        others = light.distant
        rest = others and _forward(others, subject, model, shape, view)
        return with_points(rest, points, shape)
    samples = camera_samples(view)
    observed = Observations(samples, np.zeros((len(samples.normals), 3)), np.zeros(0, int))
    assert isinstance(subject.lobe, Glossy)
    dual = prepare_light(light, observed, subject.lobe, "auto", None).dual
    if shape.is_convex():
        return DualForward(dual)
    field = transfer_field(shape, light.diffuse_degrees, len(samples.normals))
    return ShadowedDual(shape, dual, field.at)
