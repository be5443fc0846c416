"""A fit from its config to its result folder: load, trace, fit, account, write."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry import Mesh, Shape
from jaxrender.inverse import KnownLight
from jaxrender.inverse.photographs import (
    Listener,
    Photograph,
    observations_of,
)
from jaxrender.inverse.saturation import clipped_share
from jaxrender.io import Capture, write_image
from jaxrender.io.netcdf import Group, write
from jaxrender.pipelines.caches import capture_folder, is_whole
from jaxrender.pipelines.captures import (
    LitCapture,
    captures_of,
    joined,
    light_of_captures,
)
from jaxrender.pipelines.clock import Clock
from jaxrender.pipelines.config import (
    CaptureConfig,
    CaptureLightingConfig,
    FurtherCaptureConfig,
    RecipeConfig,
    RunConfig,
    load_recipe,
    load_run_config,
    resolved_yaml,
)
from jaxrender.pipelines.kept import keeping
from jaxrender.pipelines.output import FolderState, fingerprint, prepare, result_folder
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.result import (
    ARRAYS,
    ARRAYS_FORMAT,
    RESULT,
    provenance_of,
    read_result,
    write_json,
)
from jaxrender.pipelines.scene import (
    fault_of,
    input_files,
    shape_of,
)
from jaxrender.pipelines.summary import summary_of
from jaxrender.pipelines.synth import synthesise
from jaxrender.pipelines.tasks import task_named
from jaxrender.pipelines.tasks.recovery import Evidence, Recovery
from jaxrender.shapes import Float

# At most this many photographs are shown in the report, spread over the capture.
_SHOWN = 6
# Photographs of which more than this part of the values is clipped tell nothing.
_CLIPPED = 0.9


Photographed = TypeVar("Photographed", CaptureConfig, FurtherCaptureConfig)


class FitReport(NamedTuple):
    """The end of a run: its outcome, its folder, and a table for the terminal."""

    outcome: str
    folder: Path
    summary: str


def fit(
    config: RunConfig,
    force: bool = False,
    dry_run: bool = False,
    progress: Progress | None = None,
) -> FitReport:
    """Fit what a config asks for and write the result folder.

    An identical run that has finished is reused; ``dry_run`` checks the input and writes nothing.
    Raises ``InputError`` for any wrong input.
    """
    progress = progress or SilentProgress()
    folder = config.output or Path.cwd() / "runs" / _name_of(config)
    recipes = config.recipes
    with Clock(progress) as clock, keeping(lambda: _kept(recipes)):
        config = _with_photographs(config, clock, progress, dry_run)
        if config.recipes:
            return FitReport("dry run", folder, _would_render(config.recipes))
        captures = captures_of(config)
        inputs = _inputs(config, captures)
        digest = fingerprint(config, inputs)
        if prepare(folder, digest, force) is FolderState.FINISHED:
            progress.note(f"{folder}: an identical run has finished here; reused (--force: anew)")
            found = read_result(folder)
            return FitReport(found["outcome"], folder, summary_of(found))
        evidence = _load(config, captures, clock, progress)
        _check_not_black(config, evidence)
        _check_not_clipped(config, evidence)
        task = task_named(config.task)
        task.check(config, evidence)
        if dry_run:
            return FitReport("dry run", folder, f"dry run: would {task.would(config, evidence)}")
        recovery = task.recover(config, evidence, clock, progress)
        with result_folder(folder, digest, force) as into:
            result = _write(into, folder.name, config, inputs, recovery, evidence.shape, clock)
        return FitReport(result["outcome"], folder, summary_of(result))


def _kept(recipes: Sequence[Path]) -> str:
    """Say what is there after an interrupt."""
    loaded = {path: load_recipe(path) for path in recipes}
    whole = [is_whole(recipe, capture_folder(recipe, path)) for path, recipe in loaded.items()]
    photographs = "the rendered photographs are kept; " if whole and all(whole) else ""
    return f"{photographs}no result was written, and an earlier one is as it was"


def _with_photographs(
    config: RunConfig, clock: Clock, progress: Progress, dry_run: bool
) -> RunConfig:
    """Render recipes' photographs, or find them in the cache, and point the config at them."""
    recipes = {path: load_recipe(path) for path in config.recipes}
    places = {path: capture_folder(recipe, path) for path, recipe in recipes.items()}
    if not recipes or (dry_run and not all(place.exists() for place in places.values())):
        return config
    _check_one_shape(config, recipes)
    with clock.stage("synth"):
        for path, recipe in recipes.items():
            force = not is_whole(recipe, places[path])
            synthesise(recipe, path, places[path], force, progress)
    made = {path: load_run_config(place / "config.yaml") for path, place in places.items()}
    capture, lighting, path = config.capture, config.lighting, config.capture.recipe
    if path is not None:
        found = made[path]
        geometry = config.capture.geometry or found.capture.geometry
        capture = _photographed(capture, found).model_copy(update={"geometry": geometry})
        if config.knows_light and not lighting.given:
            stated = lighting.model_fields_set & {"split", "free_scale"}
            lighting = found.lighting.model_copy(update={k: getattr(lighting, k) for k in stated})
    captures = tuple(
        one if one.recipe is None else _lit(_photographed(one, made[one.recipe]), made[one.recipe])
        for one in config.captures
    )
    with fault_of(f"the light of {', '.join(map(str, recipes))}"):
        update: dict[str, Any] = {"capture": capture, "lighting": lighting}
        if captures:
            # What is not stated stays so.
            update["captures"] = captures
        config = config.model_copy(update=update)
        config.refuse_in_vain()
    return config


def _photographed(capture: Photographed, made: RunConfig) -> Photographed:
    """Put a recipe's photographs in the place of the recipe."""
    return capture.model_copy(update={"recipe": None, "transforms": made.capture.transforms})


def _lit(capture: FurtherCaptureConfig, made: RunConfig) -> FurtherCaptureConfig:
    """Light a further capture as its recipe does, unless another light is stated."""
    if capture.lighting.given:
        return capture
    stated = made.lighting.model_fields_set & set(CaptureLightingConfig.model_fields)
    lighting = CaptureLightingConfig(**{name: getattr(made.lighting, name) for name in stated})
    return capture.model_copy(update={"lighting": lighting})


def _check_one_shape(config: RunConfig, recipes: dict[Path, RecipeConfig]) -> None:
    """Refuse recipes of different objects."""
    first = config.capture.recipe
    for at, one in enumerate(config.captures):
        if first is None or one.recipe is None:
            continue
        if recipes[one.recipe].geometry != recipes[first].geometry:
            raise InputError(
                f"captures[{at}].recipe: {one.recipe} has another geometry than {first}; all "
                "captures must be of one object"
            )


def _load(
    config: RunConfig, captures: tuple[LitCapture, ...], clock: Clock, progress: Progress
) -> Evidence:
    with clock.stage("load"):
        assert config.capture.geometry is not None
        shape = shape_of(config.capture.geometry)
        light = light_of_captures(captures, shape) if config.knows_light else None
        listener = Listener(progress.note, progress.advance)
        images = [one.images(listener) for one in captures]
    with clock.stage("trace"):
        photographs = [
            photograph
            for one, own in zip(captures, images)
            for photograph in one.traced(own, shape, listener)
        ]
        light = _light_of_kept(light, joined([one.capture for one in captures]), photographs)
        pool = observations_of(photographs)
        observations = task_named(config.task).draw(config, pool, light)
    return Evidence(photographs, shape, light, pool, observations)


def _light_of_kept(
    light: KnownLight | None, capture: Capture, photographs: list[Photograph]
) -> KnownLight | None:
    """Drop the sources of photographs that were skipped."""
    if light is None:
        return None
    with fault_of("lighting.per_frame"):
        return light.of_frames(capture.numbers_of(p.frame.name for p in photographs))


def _check_not_black(config: RunConfig, evidence: Evidence) -> None:
    if not np.any(evidence.observations.radiance > 0):
        raise InputError(
            f"{config.capture.transforms}: every usable pixel is black; check the photographs and "
            "the position of capture.geometry"
        )


def _check_not_clipped(config: RunConfig, evidence: Evidence) -> None:
    share = clipped_share(evidence.pool)
    if share > _CLIPPED:
        raise InputError(
            f"{config.capture.transforms}: {100 * share:.3g} % of the usable values are clipped: "
            "they stand at the highest value of their photograph; take the photographs with a "
            "shorter exposure"
        )


def _write(
    folder: Path,
    title: str,
    config: RunConfig,
    inputs: list[Path],
    recovery: Recovery,
    shape: Shape,
    clock: Clock,
) -> dict:
    """Write everything of a result; ``result.json`` last, when all its seconds are known."""
    with clock.stage("result"):
        result, provenance = recovery.result(), provenance_of(inputs, config.samples.seed)
    with clock.stage("predict"):
        predictions = recovery.predict()
    photographs = recovery.photographs
    with clock.stage("write"):
        (folder / "config.yaml").write_text(resolved_yaml(config), encoding="utf-8")
        write(folder / ARRAYS, ARRAYS_FORMAT, Group(groups=recovery.arrays()))
        recovery.write_images(folder)
        (folder / "images").mkdir()
        for photograph, predicted in zip(photographs, predictions):
            residual = np.where(photograph.covered[..., None], photograph.radiance - predicted, 0)
            write_image(folder / "images" / f"{photograph.frame.name}_predicted.exr", predicted)
            write_image(folder / "images" / f"{photograph.frame.name}_residual.exr", residual)
    with clock.stage("report"):
        from jaxrender.pipelines.report import FramePictures, write_report

        shown = np.unique(np.linspace(0, len(predictions) - 1, _SHOWN).round().astype(int))
        frames = tuple(
            FramePictures(p.frame.name, p.radiance, q, p.selection.usable, p.covered)
            for p, q in ((photographs[k], predictions[k]) for k in shown)
        )
        so_far = result.document(provenance, clock.taken())
        # For the page alone: unit vectors from the object to each camera.
        so_far["views"] = [view.tolist() for view in map(_towards, photographs) if view.any()]
        so_far["faces"] = shape.face_normals() if isinstance(shape, Mesh) else np.zeros((0, 3))
        write_report(folder, recovery.page(title, so_far, frames))
    document = result.document(provenance, clock.taken())
    write_json(folder / RESULT, document)
    return document


def _towards(photograph: Photograph) -> Float[np.ndarray, "3"]:
    """The unit vector from the object to the camera; zero where the object is not seen."""
    mean = photograph.view.outgoing[photograph.view.hit].sum(axis=0)
    return mean / max(float(np.linalg.norm(mean)), 1e-12)


def _inputs(config: RunConfig, captures: tuple[LitCapture, ...]) -> list[Path]:
    frames = joined([one.capture for one in captures]).frames
    photographs = [frame.image_path for frame in frames]
    masks = [frame.mask_path for frame in frames if frame.mask_path is not None]
    return sorted({*input_files(config), *photographs, *masks})


def _name_of(config: RunConfig) -> str:
    """Name a run by its first capture, and say how many more there are."""
    more = f"_and_{len(config.captures)}_more" if config.captures else ""
    if config.capture.recipe is not None:
        return config.capture.recipe.stem + more
    assert config.capture.transforms is not None
    return (config.capture.transforms.parent.name or "capture") + more


def _would_render(recipes: tuple[Path, ...]) -> str:
    views = [load_recipe(path).views for path in recipes]
    lines = [
        f"{one.count} photographs of {one.width} x {one.height} pixels from {path}"
        for one, path in zip(views, recipes)
    ]
    return f"dry run: would render {' and '.join(lines)}, then fit them"
