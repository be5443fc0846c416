"""A fit from its config to its result folder: load, trace, fit, account, write."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.inverse import KnownLight
from jaxrender.inverse.photographs import (
    Listener,
    Photograph,
    observations_of,
    read_photographs,
    trace_photographs,
)
from jaxrender.inverse.saturation import clipped_share
from jaxrender.io import Capture, write_image
from jaxrender.io.netcdf import Group, write
from jaxrender.pipelines.caches import capture_folder, is_whole
from jaxrender.pipelines.clock import Clock
from jaxrender.pipelines.config import (
    RunConfig,
    load_recipe,
    load_run_config,
    resolved_yaml,
)
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
    capture_of,
    fault_of,
    input_files,
    known_light,
    reading_of,
    shape_of,
)
from jaxrender.pipelines.summary import summary_of
from jaxrender.pipelines.synth import synthesise
from jaxrender.pipelines.tasks import task_named
from jaxrender.pipelines.tasks.recovery import Evidence, Recovery

# At most this many photographs are shown in the report, spread over the capture.
_SHOWN = 6
# Photographs of which more than this part of the values is clipped tell nothing.
_CLIPPED = 0.9


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
    with Clock(progress) as clock:
        config = _with_photographs(config, clock, progress, dry_run)
        if config.capture.recipe is not None:
            return FitReport("dry run", folder, _would_render(config))
        capture = capture_of(config.capture)
        inputs = _inputs(config, capture)
        digest = fingerprint(config, inputs)
        if prepare(folder, digest, force) is FolderState.FINISHED:
            progress.note(f"{folder}: an identical run has finished here; reused (--force: anew)")
            found = read_result(folder)
            return FitReport(found["outcome"], folder, summary_of(found))
        evidence = _load(config, capture, clock, progress)
        _check_not_black(config, evidence)
        _check_not_clipped(config, evidence)
        task = task_named(config.task)
        task.check(config, evidence)
        if dry_run:
            return FitReport("dry run", folder, f"dry run: would {task.would(config, evidence)}")
        recovery = task.recover(config, evidence, clock, progress)
        with result_folder(folder, digest, force) as into:
            result = _write(into, folder.name, config, inputs, recovery, clock)
        return FitReport(result["outcome"], folder, summary_of(result))


def _with_photographs(
    config: RunConfig, clock: Clock, progress: Progress, dry_run: bool
) -> RunConfig:
    """Render a recipe's photographs, or find them in the cache, and point the config at them."""
    if config.capture.recipe is None:
        return config
    recipe = load_recipe(config.capture.recipe)
    place = capture_folder(recipe, config.capture.recipe)
    if dry_run and not place.exists():
        return config
    with clock.stage("synth"):
        force = not is_whole(recipe, place)
        synthesise(recipe, config.capture.recipe, place, force, progress)
    made = load_run_config(place / "config.yaml")
    capture = config.capture.model_copy(
        update={
            "recipe": None,
            "transforms": made.capture.transforms,
            "geometry": config.capture.geometry or made.capture.geometry,
        }
    )
    lighting = config.lighting
    if config.knows_light and not lighting.given:
        stated = lighting.model_fields_set & {"split", "free_scale"}
        lighting = made.lighting.model_copy(update={k: getattr(lighting, k) for k in stated})
    with fault_of(f"the light of {config.capture.recipe}"):
        config = config.model_copy(update={"capture": capture, "lighting": lighting})
        config.refuse_in_vain()
    return config


def _load(config: RunConfig, capture: Capture, clock: Clock, progress: Progress) -> Evidence:
    with clock.stage("load"):
        assert config.capture.geometry is not None
        shape = shape_of(config.capture.geometry)
        light = None
        if config.knows_light:
            light = known_light(config.lighting, [frame.name for frame in capture.frames])
        listener, reading = Listener(progress.note, progress.advance), reading_of(config)
        images = read_photographs(capture, reading, listener)
    with clock.stage("trace"):
        with fault_of(str(config.capture.transforms)):
            photographs = trace_photographs(capture, images, shape, reading, listener)
        light = _light_of_kept(light, capture, photographs)
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
        write_report(folder, recovery.page(title, so_far, frames))
    document = result.document(provenance, clock.taken())
    write_json(folder / RESULT, document)
    return document


def _inputs(config: RunConfig, capture: Capture) -> list[Path]:
    photographs = [frame.image_path for frame in capture.frames]
    masks = [frame.mask_path for frame in capture.frames if frame.mask_path is not None]
    return sorted({*input_files(config), *photographs, *masks})


def _name_of(config: RunConfig) -> str:
    if config.capture.recipe is not None:
        return config.capture.recipe.stem
    assert config.capture.transforms is not None
    return config.capture.transforms.parent.name or "capture"


def _would_render(config: RunConfig) -> str:
    assert config.capture.recipe is not None
    recipe = load_recipe(config.capture.recipe)
    return (
        f"dry run: would render {recipe.views.count} photographs of "
        f"{recipe.views.width} x {recipe.views.height} pixels from {config.capture.recipe}, "
        "then fit them"
    )
