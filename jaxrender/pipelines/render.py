"""A finished result's views rendered again, or new views, under its light or another."""

from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.errors import InputError
from jaxrender.geometry import Shape, SurfaceView, observe
from jaxrender.inverse import KnownLight
from jaxrender.inverse.brdf import SHADOWED_ANGLE_PER_SIGMA
from jaxrender.inverse.known_light import exact_nodes, prepare_light
from jaxrender.inverse.observations import Observations
from jaxrender.io import Capture, read_capture, read_environment, write_image
from jaxrender.lighting import DirectionalSources, LightNodes
from jaxrender.pipelines.config import RunConfig, load_run_config
from jaxrender.pipelines.config.brdf import distribution_of
from jaxrender.pipelines.output import FolderState, fingerprint, prepare, result_folder
from jaxrender.pipelines.photographs import camera_samples
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.result import read_result
from jaxrender.pipelines.scene import fault_of, known_light, shape_of, sources_of_frame
from jaxrender.pipelines.shadows import TransferField
from jaxrender.reflection import (
    DualForward,
    ExactForward,
    ForwardModel,
    ShadowedDual,
    ShadowedForward,
    ShadowedModel,
    render_view,
)

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

    Where the light was recovered it is that light, in its gauge.  Raises ``InputError`` for a
    folder that holds no result and for input that has gone since.
    """
    progress = progress or SilentProgress()
    if model not in MODELS:
        raise ValueError(f"model={model!r}: choose one of {', '.join(MODELS)}")
    if not (result / "result.json").is_file():
        raise InputError(f"{result}: holds no finished result (no result.json); run fit first")
    config, found = load_run_config(result / "config.yaml"), read_result(result)
    made_from = [result / "result.json", *(p for p in (scene.environment, scene.cameras) if p)]
    missing = [path for path in made_from if not path.is_file()]
    if missing:
        raise InputError(f"{missing[0]}: no such file")
    digest = fingerprint(config, made_from, purpose=f"render {model} {scene.convention}")
    if prepare(out, digest, force) is FolderState.FINISHED:
        progress.note(f"{out}: rendered before; reused (--force: anew)")
        return out
    with progress.stage("render"), result_folder(out, digest, force) as folder:
        light = _light_of(config, (result, found), scene)
        _render_views(config, found, (model, light, scene.cameras), (folder, progress))
    return out


def material_of(brdf: dict) -> Microfacet:
    """Build the material that a ``result.json`` holds."""
    kd = np.array(brdf["kd"], float)
    if brdf["model"] == "lambertian":
        return Microfacet(kd, np.zeros_like(kd), 0.1, None)
    ks = np.broadcast_to(np.array(brdf["ks"], float), kd.shape)
    mu = None if brdf["mu"] == "none" else float(brdf["mu"])
    choices = brdf["fresnel"], brdf["masking"], distribution_of(brdf["model"])
    return Microfacet(kd, ks, float(brdf["sigma"]), mu, *choices)


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
    if config.task != "brdf":
        lamps = found["lighting"]["directional"]
        sources = DirectionalSources.none()
        if lamps:
            energies = np.array([lamp["irradiance"] for lamp in lamps]).clip(0)
            sources = DirectionalSources(np.array([lamp["direction"] for lamp in lamps]), energies)
        return KnownLight(read_environment(folder / "lighting_slow.exr"), sources)
    return known_light(config.lighting, [f.name for f in _capture_of(config, None).frames])


def _render_views(
    config: RunConfig,
    found: dict,
    how: tuple[str, KnownLight, Path | None],
    into: tuple[Path, Progress],
) -> None:
    (model, light, cameras), (folder, progress) = how, into
    assert config.capture.geometry is not None
    capture = _capture_of(config, cameras)
    shape, material = shape_of(config.capture.geometry), material_of(found["brdf"])
    if light.per_frame is not None and len(light.per_frame) != len(capture.frames):
        raise InputError(
            f"{cameras}: the light of the result moved with its photographs; new cameras need an "
            "--environment"
        )
    scale = float(found.get("scale", 1.0))
    shared: ForwardModel | ShadowedModel | None = None
    for number, frame in enumerate(capture.frames):
        view = observe(frame.camera, shape)
        sources = sources_of_frame(light, number)
        lit = light.environment is not None or bool(np.any(np.asarray(sources.irradiance) > 0))
        image = np.zeros((*view.hit.shape, 4))
        image[..., 3] = view.hit
        if lit and view.hit.any():
            if light.per_frame is not None or shared is None:
                own = KnownLight(light.environment, sources)
                shared = _forward(own, material, model, (shape, view))
            gain = scale * float(found.get("gains", {}).get(frame.name, 1.0))
            image[..., :3] = gain * render_view(material, view, shared)
        write_image(folder / f"{frame.name}.exr", image)
        progress.advance((number + 1) / len(capture.frames))


def _forward(
    light: KnownLight, material: Microfacet, model: str, seen: tuple[Shape, SurfaceView]
) -> ForwardModel | ShadowedModel:
    """Prepare one photograph's light for either model."""
    shape, view = seen
    convex = shape.is_convex()
    if model == "integral":
        cells = None if convex else SHADOWED_ANGLE_PER_SIGMA
        parts = exact_nodes(light, np.zeros(0, int), float(material.sigma), cells)
        nodes = parts[0]
        assert isinstance(nodes, LightNodes)
        nodes = LightNodes(*(jnp.asarray(a) for a in nodes))
        return ExactForward(nodes) if convex else ShadowedForward(shape, nodes)
    samples = camera_samples(view)
    observed = Observations(samples, np.zeros((len(samples.normals), 3)), np.zeros(0, int))
    dual = prepare_light(light, observed, material, "auto", None).dual
    if convex:
        return DualForward(dual)
    field = TransferField.of(shape, light.diffuse_degrees, len(samples.normals))
    return ShadowedDual(shape, dual, field.at)
