"""The page of a check: every photograph with what is drawn over it, and what all of them see."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import UInt8
from matplotlib import colormaps
from scipy.ndimage import binary_erosion

from jaxrender.imaging.display import codes, exposed, exposure_for
from jaxrender.lighting import PANORAMAS
from jaxrender.pipelines.check.photographs import Judged
from jaxrender.pipelines.report.display import bounding_box, data_uri, shrunk
from jaxrender.pipelines.report.page import filled
from jaxrender.shapes import Bool, Float

# At most this many photographs are shown, spread over the capture.
_SHOWN = 24
# How much of the photograph is left under what is drawn over it.
_UNDER = 0.35
_SHAPE, _MASK = np.array([255, 64, 48], np.uint8), np.array([40, 200, 255], np.uint8)
# Rows of the pictures of all directions, and of the cells that are counted.
_ROWS, _CELLS = 180, 30
_COLOURS = "viridis"


class Row(NamedTuple):
    """One photograph: its numbers in words, and its pictures as data URIs."""

    name: str
    numbers: tuple[str, ...]
    outlines: str
    normals: str
    mirrors: str


def page_of(
    title: str, sentences: list[str], wrong: list[str], photographs: tuple[Judged, ...], told: str
) -> str:
    """Write the page; ``told`` is what an analysis expects to recover."""
    shown = np.unique(np.linspace(0, len(photographs) - 1, min(_SHOWN, len(photographs))).round())
    normals = [one.photograph.view.normals[one.photograph.view.hit] for one in photographs]
    mirrors = [_mirrors(one)[one.photograph.view.hit] for one in photographs]
    values: dict[str, Any] = {
        "title": title,
        "sentences": sentences,
        "wrong": wrong,
        "rows": [_row(photographs[int(k)]) for k in shown] if photographs else [],
        "total": len(photographs),
        "seen": _directions(normals),
        "reflected": _directions(mirrors),
        "told": told,
    }
    return filled("check.html.j2", values)


def numbers_of(one: Judged) -> tuple[str, ...]:
    """Say a photograph's numbers in words."""
    exposure = "" if one.exposure is None else f"{one.exposure:.2f} x"
    return (
        "" if one.overlap is None else f"{one.overlap:.2f}",
        f"{100 * one.saturated:.2g} %",
        f"{100 * one.black:.2g} %",
        f"{one.sharpness:.2f}",
        exposure,
    )


def _row(one: Judged) -> Row:
    photograph = one.photograph
    hit = photograph.view.hit
    seen = hit if one.mask is None else hit | one.mask
    box = bounding_box(seen)
    radiance = np.nan_to_num(photograph.radiance)
    picture = exposed(radiance, exposure_for(radiance[hit]))
    lines = picture.copy()
    if one.mask is not None:
        lines[_edge(one.mask)] = _MASK
    lines[_edge(hit)] = _SHAPE
    return Row(
        one.name,
        numbers_of(one),
        data_uri(lines[box]),
        _drawn(picture[box], photograph.view.normals[box], hit[box]),
        _drawn(picture[box], _mirrors(one)[box], hit[box]),
    )


def _drawn(
    picture: UInt8[np.ndarray, "row column 3"],
    directions: Float[np.ndarray, "row column 3"],
    hit: Bool[np.ndarray, "row column"],
) -> str:
    """Draw directions over a photograph: x, y and z as red, green and blue."""
    over = (1 - _UNDER) * (directions + 1) / 2 + _UNDER * picture / 255
    mixed = np.where(hit[..., None], over, picture / 255)
    return data_uri(codes(np.clip(shrunk(mixed), 0, 1)))


def _edge(mask: Bool[np.ndarray, "row column"]) -> Bool[np.ndarray, "row column"]:
    return mask & ~np.asarray(binary_erosion(mask), bool)


def _mirrors(one: Judged) -> Float[np.ndarray, "row column 3"]:
    """Where a mirror would look: R = 2 (N.V) N - V; zero where nothing is hit."""
    view = one.photograph.view
    return 2 * view.exit_cosines[..., None] * view.normals - view.outgoing


def _directions(each: list[Float[np.ndarray, "_ 3"]]) -> str:
    """Paint how many photographs have something in each direction: +Z up, azimuth to the right."""
    counts = np.zeros((_CELLS, 2 * _CELLS))
    for directions in each:
        place = np.floor(PANORAMAS["z-up"].pixels(directions, _CELLS)).astype(int)
        seen = np.zeros(counts.shape, bool)
        seen[np.clip(place[:, 0], 0, _CELLS - 1), place[:, 1] % (2 * _CELLS)] = True
        counts += seen
    colours = colormaps[_COLOURS](counts / max(1.0, float(counts.max())))[..., :3]
    colours[counts == 0] = 0.12
    factor = _ROWS // _CELLS
    return data_uri(codes(np.kron(colours, np.ones((factor, factor, 1)))))
