"""Views of a ball, or through a lens, unwrapped to one environment and merged."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry import Pinhole
from jaxrender.imaging import Circle, circle_of_edges
from jaxrender.io import read_image
from jaxrender.lighting import (
    Ball,
    BallView,
    Evidence,
    MergedViews,
    ball_of_circle,
    ball_of_mask,
    merge_views,
    view_of_ball,
    view_of_lens,
)
from jaxrender.pipelines.probe_views import MergedView, Reading, View
from jaxrender.shapes import Bool

# Light that was seen with less than this exit cosine, or part of a texel, is filled.
SEEN = 0.1
LEAST_ROWS = 16
# A photograph of the light itself has more rows than a fit has use for.
_MOST_ROWS = 512


class ProbeOptions(NamedTuple):
    """How photographs become an environment.

    ``reading.lens`` None: they show a ball.  ``ball`` is row, column and radius of its circle in
    pixels, ``mask`` a picture that is white on the ball.  ``camera_angle`` in degrees: what shows
    the camera itself.  ``sigma``: the roughness at which light is slow.
    """

    reading: Reading = Reading()
    mask: Path | None = None
    ball: tuple[float, float, float] | None = None
    reflectance: float = 0.65
    camera_angle: float = 5.0
    height: int | None = None
    sigma: float = 0.1


class FoundBall(NamedTuple):
    """The ball of a view, None where a lens sees the light itself, and how it was found."""

    ball: Ball | None
    by: str


def ball_of(view: View, options: ProbeOptions) -> FoundBall:
    """Find the ball of a view: as stated, by a mask, by alpha, or else by its edges."""
    if options.reading.lens is not None:
        return FoundBall(None, "no ball")
    place = str(view.paths[0])
    try:
        if options.ball is not None:
            row, column, radius = options.ball
            if not radius > 0:
                raise ValueError(f"--ball: the radius is {radius:g}; give one above 0")
            circle = Circle(row, column, radius, 0.0, 1.0)
            return FoundBall(ball_of_circle(circle, view.camera), "as stated")
        if options.mask is not None:
            place = str(options.mask)
            mask = read_image(options.mask).pixels.mean(axis=-1)
            mask /= max(float(mask.max()), 1e-300)
            return FoundBall(ball_of_mask(mask, view.camera), "by the mask")
        if view.mask is not None:
            return FoundBall(ball_of_mask(view.mask, view.camera), "by the mask")
        if view.images[0].alpha is not None:
            return FoundBall(ball_of_mask(view.images[0].alpha, view.camera), "by alpha")
        return _by_edges(view)
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{place}: {error}") from None


def _by_edges(view: View) -> FoundBall:
    try:
        circle = circle_of_edges([image.pixels.mean(axis=-1) for image in view.images])
    except ValueError as error:
        raise InputError(
            f"{view.paths[0]}: where is the ball? {error}; give --ball ROW COLUMN RADIUS in "
            "pixels, --mask PICTURE, or mask_path in transforms.json"
        ) from None
    said = (
        f"by its edges, at row {circle.row:.1f}, column {circle.column:.1f}, with a radius of "
        f"{circle.radius:.1f} pixels ({100 * circle.support:.0f} % of its outline)"
    )
    return FoundBall(ball_of_circle(circle, view.camera), said)


class Unwrapped(NamedTuple):
    """Merged views, and where all of them saturate: there their radiance is a lower bound."""

    merged: MergedViews
    clipped: Bool[np.ndarray, "row column"]


def unwrapped(
    found: Sequence[MergedView], balls: Sequence[Ball | None], options: ProbeOptions
) -> Unwrapped:
    """Unwrap every view, all to one height, and merge them.

    Saturated pixels are left out.  Where nothing else was seen, they come back as a bound.
    """
    lit = [np.asarray(np.isfinite(one.merged.standard_deviation).all(axis=-1)) for one in found]
    height = options.height or max(map(_rows, found, balls))
    if height < LEAST_ROWS:
        said = f"the ball's radius is {height} pixels: photograph it larger"
        if options.reading.lens is not None:
            said = f"its lens resolves {height} rows: photograph it in more pixels"
        raise InputError(f"{found[0].view.paths[0]}: {said}, {LEAST_ROWS} or more")
    merged = merge_views([_view(*each, height, options) for each in zip(found, balls, lit)])
    clipped = np.zeros(merged.confidence.shape, bool)
    if all(mask.all() for mask in lit):
        return Unwrapped(merged, clipped)
    whole = merge_views(
        [_view(one, ball, None, height, options) for one, ball in zip(found, balls)]
    )
    clipped = (merged.confidence < SEEN) & (whole.confidence >= SEEN)
    radiance = np.where(clipped[..., None], whole.radiance, merged.radiance)
    deviation = np.where(clipped[..., None], whole.radiance, merged.deviation)
    confidence = np.where(clipped, whole.confidence, merged.confidence)
    return Unwrapped(MergedViews(radiance, deviation, confidence, merged.disagreement), clipped)


def _rows(one: MergedView, ball: Ball | None) -> int:
    """The ball's radius in pixels; of a lens as many as it resolves, up to a bound."""
    camera = one.view.camera
    if ball is None:
        assert isinstance(camera, Pinhole)
        return min(round(math.pi * camera.fl_y), _MOST_ROWS)
    right = camera.world_from_camera[:3, 0] * ball.radius
    edge = camera.project(np.stack([ball.centre, ball.centre + right]))
    return round(float(np.linalg.norm(edge[1] - edge[0])))


def _view(
    one: MergedView,
    ball: Ball | None,
    usable: Bool[np.ndarray, "photo_row photo_column"] | None,
    height: int,
    options: ProbeOptions,
) -> BallView:
    deviation = one.merged.standard_deviation
    deviation = np.where(np.isfinite(deviation), deviation, 0)
    evidence = Evidence(deviation, usable)
    try:
        if ball is None:
            assert isinstance(one.view.camera, Pinhole)
            field = math.radians(options.reading.field)
            if one.view.mask is not None:
                usable = one.view.mask if usable is None else usable & one.view.mask
                evidence = Evidence(deviation, usable)
            return view_of_lens(one.merged.radiance, one.view.camera, height, evidence, field)
        return view_of_ball(
            one.merged.radiance,
            one.view.camera,
            ball,
            height,
            evidence,
            reflectance=options.reflectance,
            camera_angle=math.radians(options.camera_angle),
        )
    except ValueError as error:
        raise InputError(f"{one.view.paths[0]}: {error}") from None
