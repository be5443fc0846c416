"""A finished result's views rendered again, or new views, under its light or another."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.errors import InputError
from jaxrender.geometry import Shape, SurfaceView, observe
from jaxrender.inverse import KnownLight
from jaxrender.inverse.known_light import prepare_light
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.photographs import camera_samples
from jaxrender.io import Capture, read_capture, read_environment, write_image
from jaxrender.lighting import DirectionalSources
from jaxrender.pipelines.config import RunConfig, load_run_config
from jaxrender.pipelines.deviation import MaterialCovariance, image_deviation, read_covariance
from jaxrender.pipelines.exact_light import exact_forward
from jaxrender.pipelines.output import FolderState, fingerprint, prepare, result_folder
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.result import ARRAYS, RESULT, read_result
from jaxrender.pipelines.scene import (
    fault_of,
    known_light,
    shape_of,
)
from jaxrender.pipelines.shadows import transfer_field
from jaxrender.pipelines.subject import Subject, subject_of
from jaxrender.reflection import DualForward, ForwardModel, ShadowedDual, ShadowedModel

MODELS = ("integral", "dual")


class Scene(NamedTuple):
    """What takes the place of the result's own light and cameras; None: its own."""

    environment: Path | None = None
    convention: str = "z-up"
    cameras: Path | None = None


OWN_SCENE = Scene()


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

    Beside an image of one material lies ``NAME_deviation.exr``: the standard deviation that the
    covariance of the material (gain and scale included) makes of it, to first order.  Where the
    light was recovered it is that light, in its gauge.  Raises ``InputError`` for a folder that
    holds no result and for input that has gone since.
    """
    progress = progress or SilentProgress()
    if model not in MODELS:
        raise ValueError(f"model={model!r}: choose one of {', '.join(MODELS)}")
    found, config = read_result(result), load_run_config(result / "config.yaml")
    made_from = [result / RESULT, *(p for p in (scene.environment, scene.cameras) if p)]
    missing = [path for path in made_from if not path.is_file()]
    if missing:
        raise InputError(f"{missing[0]}: no such file")
    digest = fingerprint(config, made_from, purpose=f"render {model} {scene.convention}")
    if prepare(out, digest, force) is FolderState.FINISHED:
        progress.note(f"{out}: rendered before; reused (--force: anew)")
        return out
    with progress.stage("render"), result_folder(out, digest, force) as folder:
        light = _light_of(config, (result, found), scene)
        _render_views(config, (result, found), (model, light, scene), (folder, progress))
    return out


def _capture_of(config: RunConfig, cameras: Path | None) -> Capture:
    """Read the cameras of the result, or other ones."""
    if cameras is not None:
        return read_capture(cameras, require_images=False)
    assert config.capture.transforms is not None
    return read_capture(
        config.capture.transforms,
        images=config.capture.images,
        allow_outside=config.capture.allow_outside,
        require_images=False,
    )


def _light_of(config: RunConfig, result: tuple[Path, dict], scene: Scene) -> KnownLight:
    """Find the light: another one, what was recovered, or what was given."""
    folder, found = result
    if scene.environment is not None:
        with fault_of(f"{scene.environment}"):
            other = read_environment(scene.environment, scene.convention)
            return KnownLight(other, DirectionalSources.none())
    if not config.knows_light:
        lamps = found["lighting"]["directional"]
        sources = DirectionalSources.none()
        if lamps:
            energies = np.array([lamp["irradiance"] for lamp in lamps]).clip(0)
            sources = DirectionalSources(np.array([lamp["direction"] for lamp in lamps]), energies)
        return KnownLight(read_environment(folder / "lighting_slow.exr"), sources)
    return known_light(config.lighting, [f.name for f in _capture_of(config, None).frames])


def _render_views(
    config: RunConfig,
    result: tuple[Path, dict],
    how: tuple[str, KnownLight, Scene],
    into: tuple[Path, Progress],
) -> None:
    (model, light, scene), (folder, progress) = how, into
    cameras, found = scene.cameras, result[1]
    assert config.capture.geometry is not None
    capture = _capture_of(config, cameras)
    shape = shape_of(config.capture.geometry)
    subject = subject_of(config, result, shape)
    if model == "dual" and not isinstance(subject.lobe, Glossy):
        raise InputError(
            f"{result[0]}: --model dual is for a lobe about the reflected direction, which this "
            "material has not; use --model integral"
        )
    covariance = _covariance(config, result[0], scene, progress)
    if light.per_frame is not None and len(light.per_frame) != len(capture.frames):
        raise InputError(
            f"{cameras}: the light of the result moved with its photographs; new cameras need an "
            "--environment"
        )
    scale, gains = float(found.get("scale", 1.0)), found.get("gains", {})
    shared: ForwardModel | ShadowedModel | None = None
    for number, frame in enumerate(capture.frames):
        view = observe(frame.camera, shape)
        sources = light.sources_of(number)
        lit = light.environment is not None or bool(np.any(np.asarray(sources.irradiance) > 0))
        image = np.zeros((*view.hit.shape, 4))
        image[..., 3] = view.hit
        if lit and view.hit.any():
            if light.per_frame is not None or shared is None:
                own = KnownLight(light.environment, sources)
                shared = _forward(own, subject, model, (shape, view))
            gain = float(gains.get(frame.name, 1.0))
            radiance = subject.image(view, shared)
            image[..., :3] = scale * gain * radiance
            slopes = None if covariance is None else subject.slopes(view, shared)
            if covariance is not None and slopes is not None:
                which = list(gains).index(frame.name) if frame.name in gains else None
                deviation = np.zeros_like(radiance)
                deviation[view.hit] = image_deviation(
                    covariance.of_frame(which, subject.amplitudes, subject.numbers),
                    slopes,
                    radiance[view.hit],
                    (gain, scale),
                )
                write_image(folder / f"{frame.name}_deviation.exr", deviation)
        write_image(folder / f"{frame.name}.exr", image)
        progress.advance((number + 1) / len(capture.frames))


def _covariance(
    config: RunConfig, folder: Path, scene: Scene, progress: Progress
) -> MaterialCovariance | None:
    """Read the material's covariance; where there is none to speak of, say why."""
    if config.task not in ("brdf", "factorize"):
        return None
    if config.task == "factorize" and scene.environment is None:
        progress.note(
            "no standard deviations: the errors of a light that was recovered with the material go "
            "together with those of the material; give --environment to see the material's"
        )
        return None
    found = read_covariance(folder / ARRAYS)
    if found is None:
        progress.note(f"{folder}: no standard deviations: the result has no covariance")
    return found


def _forward(
    light: KnownLight, subject: Subject, model: str, seen: tuple[Shape, SurfaceView]
) -> ForwardModel | ShadowedModel:
    """Prepare one photograph's light for either model."""
    shape, view = seen
    if model == "integral":
        return exact_forward(light, subject.width, shape)
    samples = camera_samples(view)
    observed = Observations(samples, np.zeros((len(samples.normals), 3)), np.zeros(0, int))
    assert isinstance(subject.lobe, Glossy)
    dual = prepare_light(light, observed, subject.lobe, "auto", None).dual
    if shape.is_convex():
        return DualForward(dual)
    field = transfer_field(shape, light.diffuse_degrees, len(samples.normals))
    return ShadowedDual(shape, dual, field.at)
