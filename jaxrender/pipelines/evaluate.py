"""A finished result against photographs and a true light, by the measures of benchmarks."""

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.imaging import Similarity, similarity
from jaxrender.imaging.display import exposed, exposure_for, png_of
from jaxrender.inverse.photographs import (
    Listener,
    Photograph,
    Reading,
    posed,
    read_photographs,
    trace_photographs,
)
from jaxrender.io import Capture, read_capture, read_environment, write_image
from jaxrender.pipelines.captures import captures_of, joined, reading_of
from jaxrender.pipelines.output import fingerprint, prepare, result_folder
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.render import Scene, renderings
from jaxrender.pipelines.result import RESULT, FinishedRun, read_run
from jaxrender.pipelines.scene import fault_of, input_files, shape_of
from jaxrender.reflection import LightDifference, compare_lights
from jaxrender.shapes import Bool, Float

EVALUATION = "evaluation.json"
# Of more than this share at white, or of less than this median, a display shows little.
_MANY_WHITE, _DARK = 0.5, 0.02


class Measures(NamedTuple):
    """How pictures are compared, and with which true ``light``, if any.

    ``exposure`` times radiance is what a display shows, 1 being white.  ``scaled``: a factor for
    each photograph and channel is free, as benchmarks have it.
    """

    exposure: float = 1.0
    scaled: bool = True
    light: Path | None = None


class Evaluation(NamedTuple):
    """What was measured, in words; by photograph; and by sphere where a true light was given."""

    summary: str
    photographs: dict[str, Similarity]
    spheres: dict[str, LightDifference]


class _Compared(NamedTuple):
    name: str
    similarity: Similarity
    predicted: Float[np.ndarray, "row column channel"]
    truth: Float[np.ndarray, "row column channel"]
    mask: Bool[np.ndarray, "row column"]


def evaluate_result(
    result: Path,
    scene: Scene,
    measures: Measures,
    out: Path | None = None,
    force: bool = False,
    *,
    progress: Progress | None = None,
) -> Evaluation:
    """Compare photographs with what a finished result predicts for their cameras.

    The photographs are those of ``scene.cameras`` (None: those of the fit); their pixels are read
    as those of the fit were.  Masks are what both the shape and the photograph cover.  ``out`` gets
    the numbers, and for each photograph the prediction and a picture of both with the difference.
    Raises ``InputError`` for a folder without a result, missing input, and photographs of which
    none shows enough of the object.
    """
    progress = progress or SilentProgress()
    if not (math.isfinite(measures.exposure) and measures.exposure > 0):
        raise InputError(f"--exposure {measures.exposure:g}: it must be positive and finite")
    run = read_run(result)
    missing = [path for path in _given(scene, measures) if not path.is_file()]
    if missing:
        raise InputError(f"{missing[0]}: no such file")
    # Before anything is rendered for a folder that may not be written.
    digest = _digest(run, scene, measures)
    if out is not None:
        prepare(out, digest, force)
    with progress.stage("evaluate"):
        spheres = {} if measures.light is None else _compare_light(run, measures.light, scene)
        compared = _compare(run, scene, measures, progress)
    photographs = {one.name: one.similarity for one in compared}
    summary = _summary(photographs, measures) + _summary_of_light(spheres)
    evaluation = Evaluation(summary, photographs, spheres)
    if out is not None:
        with result_folder(out, digest, force=True) as folder:
            _write(folder, evaluation, compared, measures)
    return evaluation


def _given(scene: Scene, measures: Measures) -> list[Path]:
    paths = (scene.environment, scene.cameras, measures.light)
    return [path for path in paths if path is not None]


def _digest(run: FinishedRun, scene: Scene, measures: Measures) -> str:
    files = [*input_files(run.config), run.folder / RESULT, *_given(scene, measures)]
    purpose = f"evaluate {scene.convention} {measures.exposure} {measures.scaled}"
    return fingerprint(run.config, files, purpose=purpose)


def _compare_light(run: FinishedRun, light: Path, scene: Scene) -> dict[str, LightDifference]:
    """Compare the recovered light with the true one, whose panorama has the scene's layout.

    A light that is known only together with the material has a free factor in each channel.
    """
    recovered = run.folder / "lighting.exr"
    if run.config.knows_light or not recovered.is_file():
        raise InputError(
            f"{run.folder}: --light: the light of this fit was given, not recovered; leave it out"
        )
    with fault_of(str(light)):
        true = read_environment(light, scene.convention)
        return compare_lights(
            read_environment(recovered), true, scale_channels=run.config.task == "factorize"
        )


def _photographs(
    run: FinishedRun, scene: Scene, progress: Progress
) -> tuple[Capture, list[Photograph]]:
    """Read the photographs with every pixel that measured something, rims and grazing ones too."""
    assert run.config.capture.geometry is not None
    shape = shape_of(run.config.capture.geometry)
    listener = Listener(progress.note, progress.advance)
    if scene.cameras is not None:
        others = read_capture(scene.cameras, foreign=False)
        others = posed(others, run.config.capture.camera_axes)
        read = [(others, reading_of(run.config.capture, 0.0))]
    else:
        read = [(one.capture, one.reading) for one in captures_of(run.config)]
    found = []
    for capture, reading in read:
        whole: Reading = reading._replace(erode=0, min_cosine=0.0, invalid="mask")
        with fault_of(str(capture.source)):
            images = read_photographs(capture, whole, listener)
            found += trace_photographs(capture, images, shape, whole, listener)
    return joined([capture for capture, _ in read]), found


def _compare(
    run: FinishedRun, scene: Scene, measures: Measures, progress: Progress
) -> list[_Compared]:
    capture, photographs = _photographs(run, scene, progress)
    by_name = {photograph.frame.name: photograph for photograph in photographs}
    found = []
    for rendered in renderings(run, scene, capture, progress):
        photograph = by_name.get(rendered.frame.name)
        if photograph is None:
            continue
        mask = photograph.selection.usable
        truth = np.asarray(photograph.radiance, float)
        predicted = np.broadcast_to(rendered.radiance, truth.shape)
        try:
            alike = similarity(
                predicted, truth, mask, scaled=measures.scaled, exposure=measures.exposure
            )
        except ValueError as error:
            progress.note(f"{photograph.frame.image_path}: warning: left out: {error}")
            continue
        found.append(_Compared(rendered.frame.name, alike, alike.scale * predicted, truth, mask))
    if not found:
        raise InputError(f"{capture.source}: no photograph can be compared; see the warnings")
    _warn(found, measures, progress)
    return found


def _warn(compared: list[_Compared], measures: Measures, progress: Progress) -> None:
    """Say so where an exposure leaves PSNR-L and SSIM without a meaning."""
    shown = measures.exposure * np.concatenate([one.truth[one.mask].ravel() for one in compared])
    white, middle = float(np.mean(shown >= 1)), float(np.median(shown))
    if white > _MANY_WHITE or middle < _DARK:
        trouble = f"{100 * white:.0f} % of it is white" if white > _MANY_WHITE else "it is black"
        wanted = exposure_for(shown / measures.exposure)
        progress.note(
            f"warning: a display shows little of the object at --exposure {measures.exposure:g} "
            f"({trouble}): PSNR-L and SSIM mean little; --exposure {wanted:.2g} shows it"
        )


def means_of(photographs: dict[str, Similarity]) -> dict[str, float]:
    """Average each measure over the photographs."""
    names = ("psnr_hdr", "psnr_ldr", "ssim", "relative_rms")
    return {
        name: float(np.mean([getattr(alike, name) for alike in photographs.values()]))
        for name in names
    }


def _summary(photographs: dict[str, Similarity], measures: Measures) -> str:
    width = max(len("photograph"), *map(len, photographs))
    lines = [f"{'photograph':{width}}  PSNR-H  PSNR-L    SSIM     rms"]
    lines += [
        f"{name:{width}}  {alike.psnr_hdr:6.2f}  {alike.psnr_ldr:6.2f}  {alike.ssim:6.4f}"
        f"  {100 * alike.relative_rms:5.2f} %"
        for name, alike in photographs.items()
    ]
    mean = means_of(photographs)
    lines.append(
        f"{'mean':{width}}  {mean['psnr_hdr']:6.2f}  {mean['psnr_ldr']:6.2f}  {mean['ssim']:6.4f}"
        f"  {100 * mean['relative_rms']:5.2f} %"
    )
    share = 100 * float(np.mean([alike.share for alike in photographs.values()]))
    scaling = "after a scale of each channel" if measures.scaled else "without any scale"
    lines.append(
        f"{scaling}; the object covers {share:.0f} % of the pictures, and the rms is of it alone"
    )
    return "\n".join(lines)


def _summary_of_light(spheres: dict[str, LightDifference]) -> str:
    if not spheres:
        return ""
    lines = [f"{'sphere':12}  {'rms':>7}  {'scaled':>7}   angle"]
    lines += [
        f"{name:12}  {100 * one.rms:5.1f} %  {100 * one.scaled_rms:5.1f} %  {one.angle:5.2f} deg"
        for name, one in spheres.items()
    ]
    return "\n" + "\n".join(lines)


def _write(
    folder: Path, evaluation: Evaluation, compared: list[_Compared], measures: Measures
) -> None:
    document: dict[str, Any] = {
        "protocol": "Stanford-ORB: mask eroded by 2 pixels, means over the whole picture",
        "exposure": measures.exposure,
        "scaled": measures.scaled,
        "mean": means_of(evaluation.photographs),
        "photographs": {
            name: alike._asdict() | {"scale": alike.scale.tolist()}
            for name, alike in evaluation.photographs.items()
        },
    }
    if evaluation.spheres:
        document["spheres"] = {name: one._asdict() for name, one in evaluation.spheres.items()}
    text = json.dumps(_finite(document), indent=2, allow_nan=False)
    (folder / EVALUATION).write_text(text + "\n", encoding="utf-8")
    shown = np.concatenate([one.truth[one.mask].ravel() for one in compared])
    exposure = exposure_for(shown)
    for one in compared:
        inside = one.mask[..., None]
        predicted, truth = np.where(inside, one.predicted, 0), np.where(inside, one.truth, 0)
        write_image(folder / f"{one.name}.exr", predicted)
        panels = (truth, predicted, np.abs(predicted - truth))
        picture = np.concatenate([exposed(panel, exposure) for panel in panels], axis=1)
        (folder / f"{one.name}.png").write_bytes(png_of(picture))


def _finite(value: Any) -> Any:
    """Put None for what JSON has no number for: the PSNR of equal pictures."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
