"""Photographs beside what a result predicts for them, and what may lie over both.

Photographs are read again from where the config says; predictions are those of the fit, from the
result's own ``images``.  Standard deviations are those of ``render``: of the material, to first
order.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import UInt8
from matplotlib import colormaps
from matplotlib.colors import to_hex
from scipy.ndimage import distance_transform_edt

from jaxrender.errors import InputError
from jaxrender.imaging.display import exposed, exposure_for
from jaxrender.inverse.photographs import Listener, Photograph
from jaxrender.io import read_image
from jaxrender.pipelines.captures import LitCapture, captures_of, joined
from jaxrender.pipelines.progress import Progress
from jaxrender.pipelines.render import OWN_SCENE, Rendering, renderings
from jaxrender.pipelines.report.display import bounding_box, data_uri, shrunk, with_alpha
from jaxrender.pipelines.result import FinishedRun
from jaxrender.pipelines.scene import shape_of
from jaxrender.shapes import Float

# At most this many photographs, spread over the capture, of at most so many pixels a side.
_SHOWN, _LONGEST = 6, 384
# Standard deviations change slowly and cost much: they are found at so many pixels a side.
_DEVIATION_SIDE = 40
_WITHIN_PERCENTILE = 98
_RESIDUAL_COLOURS, _DEVIATION_COLOURS = "RdBu_r", "viridis"


class Gallery(NamedTuple):
    """The photographs of a page, with the scale of the overlays in per cent of the mean."""

    frames: tuple[dict[str, Any], ...]
    total: int
    residual_limit: float
    deviation_limit: float | None
    residual_colours: tuple[str, ...]
    deviation_colours: tuple[str, ...]


class _Shown(NamedTuple):
    photograph: Photograph
    predicted: Float[np.ndarray, "row column 3"]
    deviation: Float[np.ndarray, "row column 3"] | None


def gallery_of(run: FinishedRun, progress: Progress) -> Gallery | None:
    """Read photographs and predictions; None, and a note, where the photographs have gone."""
    try:
        photographs, total = _photographs(run, progress)
        shown = [
            _Shown(one, _predicted(run, one), deviation)
            for one, deviation in zip(photographs, _deviations(run, photographs, progress))
        ]
    except InputError as error:
        progress.note(f"the page has no photographs: {error}")
        return None
    if not shown:
        return None
    inside = [np.nan_to_num(one.photograph.radiance[one.photograph.covered]) for one in shown]
    values = np.concatenate([part.ravel() for part in inside])
    if not values.size:
        return None
    exposure, mean = exposure_for(values), float(values.mean()) or 1.0
    residual = _limit([_residual(one)[one.photograph.covered] for one in shown], mean)
    known = [one.deviation[one.photograph.covered] for one in shown if one.deviation is not None]
    deviation = _limit(known, mean) if known else None
    frames = tuple(_frame(one, exposure, mean, residual, deviation) for one in shown)
    colours = (_colours(_RESIDUAL_COLOURS), _colours(_DEVIATION_COLOURS))
    return Gallery(frames, total, residual, deviation, *colours)


def _photographs(run: FinishedRun, progress: Progress) -> tuple[list[Photograph], int]:
    """Read photographs that are spread over all captures, every pixel that measured something."""
    assert run.config.capture.geometry is not None
    shape = shape_of(run.config.capture.geometry)
    captures = captures_of(run.config)
    names = [frame.name for one in captures for frame in one.capture.frames]
    places = np.unique(np.linspace(0, len(names) - 1, min(_SHOWN, len(names))).round())
    chosen = {names[int(k)] for k in places}
    listener = Listener(progress.note, progress.advance)
    found: list[Photograph] = []
    for one in captures:
        frames = tuple(frame for frame in one.capture.frames if frame.name in chosen)
        if not frames:
            continue
        stated = one.stated.model_copy(update={"invalid": "mask"})
        own = LitCapture(
            one.capture._replace(frames=frames), one.names, stated, one.lighting, min_cosine=0.0
        )
        found += own.traced(own.images(listener), shape, listener)
    return found, len(names)


def _predicted(run: FinishedRun, photograph: Photograph) -> Float[np.ndarray, "row column 3"]:
    path = run.folder / "images" / f"{photograph.frame.name}_predicted.exr"
    predicted = np.asarray(read_image(path, "mask").pixels, float)
    if predicted.shape != photograph.radiance.shape:
        raise InputError(
            f"{path}: has other pixels than its photograph {photograph.frame.image_path}, which "
            "has changed since; run fit again with --force"
        )
    return predicted


def _deviations(
    run: FinishedRun, photographs: list[Photograph], progress: Progress
) -> list[Float[np.ndarray, "row column 3"] | None]:
    """Carry the material's covariance into the pictures, where a result states it."""
    nothing: list[Float[np.ndarray, "row column 3"] | None] = [None] * len(photographs)
    if run.config.task != "brdf":
        return nothing
    capture = joined([one.capture for one in captures_of(run.config)])
    names = [one.frame.name for one in photographs]
    if not run.config.captures and run.config.lighting.per_frame is None:
        chosen = tuple(frame for frame in capture.frames if frame.name in names)
        capture = capture._replace(frames=chosen)
    longest = max(max(one.radiance.shape[:2]) for one in photographs)
    step = max(1, round(longest / _DEVIATION_SIDE))
    found = {}
    for rendered in renderings(run, OWN_SCENE, capture, progress, step=step):
        if rendered.deviation is None or rendered.frame.name not in names:
            continue
        photograph = photographs[names.index(rendered.frame.name)]
        found[rendered.frame.name] = _filled(rendered, photograph.radiance.shape[:2])
    return [found.get(name) for name in names]


def _filled(rendered: Rendering, size: tuple[int, int]) -> Float[np.ndarray, "row column 3"]:
    """Give every pixel the deviation of the nearest one that was rendered."""
    hit, deviation = rendered.view.hit, rendered.deviation
    assert deviation is not None
    coarse = np.zeros(rendered.radiance.shape)
    coarse[hit] = deviation
    nearest = distance_transform_edt(~hit, return_distances=False, return_indices=True)
    row, column = np.asarray(nearest)
    coarse = coarse[row, column]
    rows, columns = (
        np.minimum(np.rint(np.arange(count) * have / count).astype(int), have - 1)
        for count, have in zip(size, hit.shape)
    )
    return coarse[rows[:, None], columns[None]]


def _residual(one: _Shown) -> Float[np.ndarray, "row column"]:
    return np.nan_to_num(one.photograph.radiance - one.predicted).mean(axis=-1)


def _limit(parts: list[np.ndarray], mean: float) -> float:
    """Find what most pixels are within, in per cent of the mean radiance; two digits."""
    values = np.concatenate([np.abs(part).ravel() for part in parts])
    reached = 100 * float(np.percentile(values, _WITHIN_PERCENTILE)) / mean
    return float(f"{max(reached, 1e-3):.2g}")


def _frame(
    one: _Shown, exposure: float, mean: float, residual: float, deviation: float | None
) -> dict[str, Any]:
    photograph = one.photograph
    box = bounding_box(photograph.covered)
    covered = photograph.covered[box].astype(float)
    picture = np.nan_to_num(photograph.radiance[box])
    frame = {
        "name": photograph.frame.name,
        "photograph": data_uri(exposed(shrunk(picture, _LONGEST), exposure)),
        "predicted": data_uri(
            exposed(shrunk(one.predicted[box] * covered[..., None], _LONGEST), exposure)
        ),
        "residual": _overlay(
            0.5 + 50 * _residual(one)[box] / mean / residual, covered, _RESIDUAL_COLOURS
        ),
        "deviation": None,
    }
    if one.deviation is not None and deviation is not None:
        share = 100 * one.deviation[box].mean(axis=-1) / mean / deviation
        frame["deviation"] = _overlay(share, covered, _DEVIATION_COLOURS)
    return frame


def _overlay(
    share: Float[np.ndarray, "row column"], covered: Float[np.ndarray, "row column"], colours: str
) -> str:
    """Paint values from 0 to 1; the page shows through beside the object."""
    parts = shrunk(np.stack([share * covered, covered], axis=-1), _LONGEST)
    value = parts[..., 0] / np.maximum(parts[..., 1], 1e-6)
    painted = colormaps[colours](np.clip(value, 0, 1))[..., :3]
    pixels: UInt8[np.ndarray, "row column 3"] = np.rint(255 * painted).astype(np.uint8)
    return data_uri(with_alpha(pixels, parts[..., 1]))


def _colours(name: str) -> tuple[str, ...]:
    """List the colours of a scale from its lower to its upper end."""
    return tuple(to_hex(colour) for colour in colormaps[name](np.linspace(0, 1, 9)))


def false_bar() -> tuple[str, ...]:
    """List the colours of maps in false colours, from the lowest to the highest."""
    return _colours(_DEVIATION_COLOURS)


def false_colours() -> UInt8[np.ndarray, "code 3"]:
    """Make the colour of every code of a map in false colours; the last one is grey."""
    colours = np.rint(255 * colormaps[_DEVIATION_COLOURS](np.linspace(0, 1, 256))[:, :3])
    colours[-1] = 128
    return colours.astype(np.uint8)
