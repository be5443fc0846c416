"""Photographs beside what the recovered material predicts, and the difference of the two."""

from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8
from matplotlib import colormaps
from matplotlib.colors import to_hex

from jaxrender.imaging.display import exposed, exposure_for
from jaxrender.pipelines.report.contents import FramePictures
from jaxrender.pipelines.report.display import (
    LONGEST_SIDE,
    Picture,
    bounding_box,
    data_uri,
    shrunk,
    with_alpha,
)
from jaxrender.shapes import Float

# The picture of the first page, whose file is to stay small.
_SMALL_SIDE = 128
# At most this many frames, spread over the capture.
_SHOWN = 6
# The residual's scale ends where this part of the usable pixels is within it.
_WITHIN_PERCENTILE = 98
_SMALLEST_LIMIT = 0.1
# Pixels that the fit did not use are shown this faintly.
_FADED = 0.35
_COLOURS = "RdBu_r"


class Frame(NamedTuple):
    """One photograph's three pictures, as data URIs, and its residual in per cent."""

    name: str
    photograph: str
    predicted: str
    residual: str
    rms: float | None


class Gallery(NamedTuple):
    """The frames with what is common to them: the residual's scale and its colours.

    ``worst`` is the frame that is explained worst, its residual small, for the first page.
    """

    frames: tuple[Frame, ...]
    total: int
    limit: float
    gradient: str
    worst: Frame | None = None


class _Scale(NamedTuple):
    """What all frames share: the exposure, the mean radiance, the residual's limit in per cent."""

    exposure: float
    mean: float
    limit: float


def gallery(frames: tuple[FramePictures, ...]) -> Gallery:
    """Prepare the pictures; the residual is photograph - prediction, its channels averaged."""
    shown = _spread(frames)
    scale = _scale(shown)
    found = tuple(_frame(frame, scale) for frame in shown)
    return Gallery(found, len(frames), scale.limit, _gradient(), _worst(shown, found, scale))


def _worst(
    shown: tuple[FramePictures, ...], found: tuple[Frame, ...], scale: _Scale
) -> Frame | None:
    """Find the frame with the largest residual; None where no residual is known."""
    known = [k for k, frame in enumerate(found) if frame.rms is not None]
    if not known:
        return None
    worst = max(known, key=lambda k: found[k].rms or 0.0)
    small = data_uri(_residual_map(shown[worst], scale, _SMALL_SIDE))
    return found[worst]._replace(residual=small)


def _spread(frames: tuple[FramePictures, ...]) -> tuple[FramePictures, ...]:
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(_SHOWN, len(frames))).round())
    return tuple(frames[int(k)] for k in chosen)


def _scale(frames: tuple[FramePictures, ...]) -> _Scale:
    used = [np.nan_to_num(frame.photograph[frame.usable]).ravel() for frame in frames]
    used = np.concatenate(used) if used else np.zeros(0)
    mean = float(used.mean()) if used.size else 0.0
    mean = mean if mean > 0 else 1.0
    off = [np.abs(_difference(frame)[frame.usable]).ravel() for frame in frames]
    off = np.concatenate(off) if off else np.zeros(0)
    reached = 100 * float(np.percentile(off, _WITHIN_PERCENTILE)) / mean if off.size else 0.0
    return _Scale(exposure_for(used), mean, _round_up(max(reached, _SMALLEST_LIMIT)))


def _difference(frame: FramePictures) -> Float[np.ndarray, "row column"]:
    return np.nan_to_num(frame.photograph - frame.predicted).mean(axis=-1)


def _round_up(value: float) -> float:
    """Round up to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= value * (1 - 1e-9)))


def _frame(frame: FramePictures, scale: _Scale) -> Frame:
    box = bounding_box(frame.covered)
    photograph, predicted = frame.photograph[box], frame.predicted[box]
    covered = frame.covered[box].astype(float)[..., None]
    return Frame(
        frame.name,
        data_uri(exposed(shrunk(np.nan_to_num(photograph)), scale.exposure)),
        data_uri(exposed(shrunk(np.nan_to_num(predicted) * covered), scale.exposure)),
        data_uri(_residual_map(frame, scale)),
        _rms(frame),
    )


def _inside(
    picture: Picture, covered: Float[np.ndarray, "row column 1"], longest: int
) -> Float[np.ndarray, "shown_row shown_column channel"]:
    """Shrink a picture without mixing in what lies beside the object."""
    share = np.maximum(shrunk(covered, longest), 1e-6)
    return shrunk(picture * covered, longest) / share


def _residual_map(
    frame: FramePictures, scale: _Scale, longest: int = LONGEST_SIDE
) -> UInt8[np.ndarray, "row column 4"]:
    box = bounding_box(frame.covered)
    covered = frame.covered[box].astype(float)[..., None]
    difference = _inside(_difference(frame)[box][..., None], covered, longest)[..., 0]
    percent = 100 * difference / scale.mean
    colours = colormaps[_COLOURS](np.clip(0.5 + percent / (2 * scale.limit), 0, 1))
    opacity = np.where(frame.usable[box], 1.0, _FADED)[..., None] * covered
    return with_alpha(
        np.rint(255 * colours[..., :3]).astype(np.uint8), shrunk(opacity, longest)[..., 0]
    )


def _rms(frame: FramePictures) -> float | None:
    """sqrt(sum r^2 / sum B^2) over the usable pixels."""
    measured, predicted = (p[frame.usable] for p in (frame.photograph, frame.predicted))
    power = float(np.sum(measured**2))
    return float(np.sqrt(np.sum((measured - predicted) ** 2) / power)) if power > 0 else None


def _gradient() -> str:
    """List the residual's colours from its lower to its upper limit, as CSS wants them."""
    colours = colormaps[_COLOURS](np.linspace(0, 1, 9))
    return ", ".join(to_hex(colour) for colour in colours)
