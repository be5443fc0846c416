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
from jaxrender.io import Capture, Frame, Image, read_capture
from jaxrender.lighting import DirectionalSources, SmoothLobes
from jaxrender.pipelines.config import RecipeConfig, RunConfig, load_recipe
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

    ``light_given`` is False where the config has no light and a typical one is supposed.
    """

    situation: Situation
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
    shape, capture = _shape_and_cameras(config, recipe)
    light, given = _light(config, recipe, capture)
    reading = Reading(Linear(), erode=config.capture.erode, min_cosine=config.samples.min_cosine)
    blanks = [_blank(frame.camera) for frame in capture.frames]
    with fault_of(str(capture.source)):
        listener = Listener(progress.note, progress.advance)
        photographs = trace_photographs(capture, blanks, shape, reading, listener)
    kept = [photograph.frame for photograph in photographs]
    with fault_of("lighting.per_frame"):
        light = light.of_frames(capture.numbers_of(frame.name for frame in kept))
    observations = random_subset(
        observations_of(photographs), config.samples.count, config.samples.seed
    )
    _check(config, observations, len(kept))
    situation = Situation(observations.samples, np.asarray(observations.frame), light)
    cameras = tuple(frame.camera for frame in kept)
    return Prospect(situation, cameras, tuple(frame.name for frame in kept), shape, recipe, given)


def _shape_and_cameras(config: RunConfig, recipe: RecipeConfig | None) -> tuple[Shape, Capture]:
    if recipe is None:
        assert config.capture.transforms is not None
        assert config.capture.geometry is not None
        capture = read_capture(
            config.capture.transforms,
            images=config.capture.images,
            allow_outside=config.capture.allow_outside,
            require_images=False,
        )
        frames = tuple(_without_missing_mask(frame) for frame in capture.frames)
        return shape_of(config.capture.geometry), Capture(frames, capture.source)
    place = config.capture.recipe
    assert place is not None
    shape = shape_of(config.capture.geometry or recipe.geometry)
    centre = np.asarray(shape_of(recipe.geometry).bounds()).mean(axis=0)
    with fault_of(f"{place}: views.elevation_degrees {recipe.views.elevation_degrees:g}"):
        cameras = cameras_of(recipe.views, centre)
    frames = tuple(
        Frame(f"view_{number:03d}", camera, Path(f"view_{number:03d}"), None, None)
        for number, camera in enumerate(cameras)
    )
    return shape, Capture(frames, place)


def _without_missing_mask(frame: Frame) -> Frame:
    # Masks are painted once the photographs are there.
    missing = frame.mask_path is not None and not frame.mask_path.is_file()
    return frame._replace(mask_path=None) if missing else frame


def _light(
    config: RunConfig, recipe: RecipeConfig | None, capture: Capture
) -> tuple[KnownLight, bool]:
    if config.lighting.given:
        return known_light(config.lighting, [frame.name for frame in capture.frames]), True
    if recipe is None:
        return KnownLight(_WINDOW_AND_SKY.to_environment(_ROWS), _SOURCE), False
    with fault_of(f"{config.capture.recipe}: lighting"):
        return light_for_fit(recipe), True


def _blank(camera: Camera) -> Image:
    pixels = np.ones((camera.height, camera.width, 3))
    return Image(pixels, None, {"is_integer": False}, np.zeros(pixels.shape[:2], bool))


def _check(config: RunConfig, observations: Observations, photographs: int) -> None:
    """Refuse samples that no fit can be made from."""
    problem = Problem.of(unknowns_of(config, photographs), observations.radiance.shape[1])
    with fault_of(f"samples.count is {config.samples.count}"):
        check_enough(observations, problem)
