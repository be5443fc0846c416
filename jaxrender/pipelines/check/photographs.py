"""Photographs judged: overlap with the shape, clipped and black values, sharpness, exposure."""

from typing import NamedTuple

import numpy as np

from jaxrender.geometry import Shape
from jaxrender.imaging import clipped_at, erode
from jaxrender.inverse.conventions import Framing, Silhouettes
from jaxrender.inverse.conventions.silhouettes import overlap
from jaxrender.inverse.photographs import Photograph
from jaxrender.pipelines.check.conventions import RawCapture
from jaxrender.shapes import Bool, Float

# Points of a photograph that are looked for in the others, and how near to them is the same point.
_POINTS, _SAME_POINT = 300, 0.01
# Fewer points in common say nothing of two exposures.
_FEWEST = 20
# Ratios of a pair spread by this much, at least, by where pixels lie; of a Gaussian, the median
# absolute deviation is this part of the standard deviation.
_LEAST_SPREAD, _MEDIAN_ABSOLUTE = 0.03, 0.6745


class Judged(NamedTuple):
    """One photograph in numbers; ``photograph`` and ``mask`` are what the numbers are of.

    ``saturated`` is the clipped part of the object, ``clipped_at`` the stored value at which values
    pile up below what the config leaves out, None where none do.  ``black`` is the darkest
    hundredth of the picture relative to the object's mean, ``sharpness`` the energy of its
    gradients relative to the median
    photograph.  ``exposure`` is by how much it is brighter than the others at the same points of
    the surface, and ``exposure_error`` how far its logarithm may be off by gloss; None where
    nothing is known of that.
    """

    photograph: Photograph
    mask: Bool[np.ndarray, "row column"] | None
    overlap: float | None
    saturated: float
    clipped_at: float | None
    black: float
    sharpness: float
    exposure: float | None
    exposure_error: float | None

    @property
    def name(self) -> str:
        """The name of the photograph."""
        return self.photograph.frame.name


def judged(
    raw: RawCapture, framing: Framing, shape: Shape, *, one_light: bool
) -> tuple[Judged, ...]:
    """Judge the photographs that see the object; ``one_light`` if all have the same light."""
    photographs = raw.meant(framing, shape)
    seen = Silhouettes.of(raw.capture, raw.images, raw.reading).meant(framing)
    masks = dict(zip(seen.names, seen.masks))
    images = dict(zip((frame.name for frame in raw.capture.frames), raw.images))
    sharp = np.array([_sharpness(photograph) for photograph in photographs])
    middle = float(np.median(sharp)) or 1.0
    gains = _exposures(photographs, shape) if one_light else [None] * len(photographs)
    found = []
    for photograph, energy, gain in zip(photographs, sharp, gains):
        name, mask = photograph.frame.name, masks.get(photograph.frame.name)
        pixels = images[name].pixels
        common = None if mask is None else overlap(mask, photograph.view.hit)
        object_pixels = pixels[:, ::-1] if framing.mirrored else pixels
        found.append(
            Judged(
                photograph,
                mask,
                common,
                *_saturated(object_pixels[photograph.view.hit], photograph.saturation),
                _black(pixels, object_pixels[photograph.view.hit]),
                float(energy) / middle,
                None if gain is None else gain.factor,
                None if gain is None else gain.error,
            )
        )
    return tuple(found)


class _Clipped(NamedTuple):
    share: float
    at: float | None


def _saturated(
    values: Float[np.ndarray, "pixel channel"], levels: Float[np.ndarray, "channel"]
) -> _Clipped:
    """Find which part is clipped: what is left out, and what piles up although nobody said so."""
    finite = np.nan_to_num(values, posinf=np.inf)
    kept = finite[~np.any(finite >= levels, axis=1)]
    tops = [clipped_at(channel) or np.inf for channel in kept.T] if len(kept) else [np.inf]
    share = float(np.mean(np.any(finite >= np.minimum(levels, tops), axis=1)))
    return _Clipped(share, min(tops) if np.isfinite(tops).any() else None)


def _black(
    pixels: Float[np.ndarray, "row column channel"], values: Float[np.ndarray, "pixel channel"]
) -> float:
    mean = float(np.nanmean(values))
    return float(np.nanpercentile(pixels, 1)) / mean if mean > 0 else 0.0


def _sharpness(photograph: Photograph) -> float:
    """Divide the squares of the gradients by those of the values, inside the object."""
    grey = np.nan_to_num(photograph.radiance).mean(axis=-1)
    inside = erode(photograph.view.hit, 2)
    if not inside.any():
        inside = photograph.view.hit
    down, across = np.gradient(grey)
    power = float(np.sum(grey[inside] ** 2))
    return float(np.sum(down[inside] ** 2 + across[inside] ** 2)) / power if power > 0 else 0.0


class _Gain(NamedTuple):
    """By how much a photograph is brighter, and how far the logarithm may be off by its gloss."""

    factor: float
    error: float


def _exposures(photographs: list[Photograph], shape: Shape) -> list[_Gain | None]:
    """Compare what photographs show at the same points, and solve for a gain of each.

    Highlights move over the surface, so that the median of the ratios is taken.  Another exposure
    multiplies all points alike; gloss does not, so that the spread of the ratios of a pair says how
    much of them gloss may be.
    """
    count, near = len(photographs), _SAME_POINT * shape.diagonal()
    rows, right, spreads = [], [], []
    of_photograph: list[list[float]] = [[] for _ in photographs]
    for i, one in enumerate(photographs):
        points, values = _points_of(one)
        for j, other in enumerate(photographs):
            ratio = None if i == j else _ratio(points, values, other, near)
            if ratio is not None:
                row = np.zeros(count)
                row[j], row[i] = 1, -1
                rows.append(row)
                right.append(ratio.middle)
                spreads.append(ratio.spread)
                of_photograph[i].append(ratio.spread)
                of_photograph[j].append(ratio.spread)
    told = np.array([bool(own) for own in of_photograph])
    if not rows:
        return [None] * count
    weights = 1 / np.maximum(spreads, _LEAST_SPREAD)
    logs = np.linalg.lstsq(np.array(rows) * weights[:, None], right * weights, rcond=None)[0]
    logs = logs - np.median(logs[told])
    return [
        _Gain(float(np.exp(log)), float(np.min(own))) if own else None
        for log, own in zip(logs, of_photograph)
    ]


class _Points(NamedTuple):
    points: Float[np.ndarray, "point 3"]
    values: Float[np.ndarray, "point"]


class _Ratio(NamedTuple):
    """The logarithm by which one photograph is brighter than another at the same points."""

    middle: float
    spread: float


def _points_of(photograph: Photograph) -> _Points:
    usable = np.argwhere(photograph.selection.usable)
    at = tuple(usable[:: max(1, len(usable) // _POINTS)].T)
    grey = photograph.radiance.mean(axis=-1)
    return _Points(photograph.view.points[at], grey[at])


def _ratio(
    points: Float[np.ndarray, "point 3"],
    values: Float[np.ndarray, "point"],
    other: Photograph,
    near: float,
) -> _Ratio | None:
    places = other.frame.camera.project(points)
    shape = np.array(other.view.hit.shape)
    cell = np.floor(np.where(np.isfinite(places), places, -1)).astype(int)[:, ::-1]
    inside = ((cell >= 0) & (cell < shape)).all(axis=1)
    row, column = cell[inside].T
    same = np.linalg.norm(other.view.points[row, column] - points[inside], axis=1) < near
    both = other.selection.usable[row, column] & same & (values[inside] > 0)
    seen = other.radiance.mean(axis=-1)[row, column]
    both &= seen > 0
    if np.count_nonzero(both) < _FEWEST:
        return None
    logs = np.log(seen[both] / values[inside][both])
    middle = float(np.median(logs))
    return _Ratio(middle, float(np.median(np.abs(logs - middle))) / _MEDIAN_ABSOLUTE)
