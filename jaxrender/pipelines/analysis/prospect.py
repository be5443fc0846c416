"""A config's cameras, shape and light, whether or not its photographs exist.

Blank pictures stand for the photographs.  Silhouettes, existing masks, grazing pixels, warnings and
refusals are then those of a fit.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.geometry import Camera, Shape
from jaxrender.imaging import Linear
from jaxrender.inverse import KnownLight, Observations
from jaxrender.inverse.brdf import check_enough
from jaxrender.inverse.elimination import Problem
from jaxrender.inverse.forecast import Situation
from jaxrender.inverse.observations import random_subset
from jaxrender.inverse.photographs import Listener, Reading, observations_of, trace_photographs
from jaxrender.io import Capture, Frame, Image
from jaxrender.lighting import DirectionalSources, SmoothLobes
from jaxrender.pipelines.captures import capture_of, joined, numbered
from jaxrender.pipelines.config import (
    CaptureConfig,
    CaptureLightingConfig,
    FurtherCaptureConfig,
    RecipeConfig,
    RunConfig,
    load_recipe,
)
from jaxrender.pipelines.progress import Progress
from jaxrender.pipelines.scene import (
    fault_of,
    known_light,
    light_for_fit,
    shape_of,
    unknowns_of,
)
from jaxrender.pipelines.synth import cameras_of

# Supposed where a config has no light: a window, the sky and a source.
_WINDOW_AND_SKY = SmoothLobes(
    np.array([[0.9, 0.5, 0.4], [0.0, 0.0, 1.0]]),
    np.radians([30.0, 60.0]),
    np.array([[1.0, 0.97, 0.92], [0.06, 0.07, 0.09]]),
)
_SOURCE = DirectionalSources(np.array([[-0.35, 0.8, 0.5]]), np.array([[1.2, 1.15, 1.05]]))
_ROWS = 64


class Prospect(NamedTuple):
    """What a fit would work on, but for the radiance of its samples.

    ``situation`` are the samples of a fit, ``pool`` all usable pixels.
    ``light_given`` is False where the config has no light and a typical one is supposed.
    """

    situation: Situation
    pool: Situation
    cameras: tuple[Camera, ...]
    names: tuple[str, ...]
    shape: Shape
    recipe: RecipeConfig | None
    light_given: bool


def prospect_of(config: RunConfig, progress: Progress) -> Prospect:
    """Trace the rays of a config's cameras and draw samples as its fit would.

    Raises ``InputError`` for what a fit would refuse, photographs apart.
    """
    recipe = None if config.capture.recipe is None else load_recipe(config.capture.recipe)
    shape = _shape(config, recipe)
    stated = (config.capture, *config.captures)
    told = [_cameras(one) for one in stated]
    given = config.lighting.given or recipe is not None
    light, captures = _light(config, told, shape), numbered(told)
    photographs = []
    for one, capture in zip(stated, captures):
        reading = Reading(Linear(), erode=one.erode, min_cosine=config.samples.min_cosine)
        blanks = [_blank(frame.camera) for frame in capture.frames]
        with fault_of(str(capture.source)):
            listener = Listener(progress.note, progress.advance)
            photographs += trace_photographs(capture, blanks, shape, reading, listener)
    kept = [photograph.frame for photograph in photographs]
    with fault_of("lighting.per_frame"):
        light = light.of_frames(joined(captures).numbers_of(frame.name for frame in kept))
    if light.near is not None:
        progress.note("point sources are taken to be as far as the middle of the object says")
    every = observations_of(photographs)
    observations = random_subset(every, config.sample_count, config.samples.seed)
    _check(config, observations, len(kept))
    situation, pool = (
        Situation(some.samples, np.asarray(some.frame), light) for some in (observations, every)
    )
    cameras = tuple(frame.camera for frame in kept)
    return Prospect(
        situation, pool, cameras, tuple(frame.name for frame in kept), shape, recipe, given
    )


def _shape(config: RunConfig, recipe: RecipeConfig | None) -> Shape:
    if recipe is not None:
        return shape_of(config.capture.geometry or recipe.geometry)
    assert config.capture.geometry is not None
    return shape_of(config.capture.geometry)


def _cameras(capture: CaptureConfig | FurtherCaptureConfig) -> Capture:
    """Read the cameras of a capture, or place those of its recipe."""
    if capture.recipe is None:
        found = capture_of(capture, require_images=False)
        return found._replace(frames=tuple(_without_missing_mask(f) for f in found.frames))
    recipe = load_recipe(capture.recipe)
    centre = np.asarray(shape_of(recipe.geometry).bounds()).mean(axis=0)
    with fault_of(f"{capture.recipe}: views.elevation_degrees {recipe.views.elevation_degrees:g}"):
        cameras = cameras_of(recipe.views, centre)
    frames = tuple(
        Frame(f"view_{number:03d}", camera, Path(f"view_{number:03d}"), None, None)
        for number, camera in enumerate(cameras)
    )
    return Capture(frames, capture.recipe)


def _without_missing_mask(frame: Frame) -> Frame:
    # Masks are painted once the photographs are there.
    missing = frame.mask_path is not None and not frame.mask_path.is_file()
    return frame._replace(mask_path=None) if missing else frame


def _light(config: RunConfig, captures: list[Capture], shape: Shape) -> KnownLight:
    """Make the light of all captures."""
    stated = [(config.lighting, config.capture.recipe)]
    stated += [(one.lighting, one.recipe) for one in config.captures]
    lights = [_one_light(*one, capture, shape) for one, capture in zip(stated, captures)]
    return KnownLight.joined(lights, [len(capture.frames) for capture in captures])


def _one_light(
    lighting: CaptureLightingConfig, recipe: Path | None, capture: Capture, shape: Shape
) -> KnownLight:
    """Make the light that is stated, or that of a recipe, or one that is typical."""
    if lighting.given:
        return known_light(lighting, [frame.name for frame in capture.frames], shape)
    if recipe is None:
        return KnownLight(_WINDOW_AND_SKY.to_environment(_ROWS), _SOURCE)
    with fault_of(f"{recipe}: lighting"):
        return light_for_fit(load_recipe(recipe), shape)


def _blank(camera: Camera) -> Image:
    pixels = np.ones((camera.height, camera.width, 3))
    return Image(pixels, None, {"is_integer": False}, np.zeros(pixels.shape[:2], bool))


def _check(config: RunConfig, observations: Observations, photographs: int) -> None:
    """Refuse samples that no fit can be made from."""
    problem = Problem.of(unknowns_of(config, photographs), observations.radiance.shape[1])
    with fault_of(f"samples.count is {config.samples.count}"):
        check_enough(observations, problem)
