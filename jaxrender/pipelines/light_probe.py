"""Light from photographs of a mirror ball: an environment with its errors, and what was done.

The folder holds, as latitude-longitude images of the convention ``z-up``:

``probe.exr``
    radiance; what no photograph shows is filled smoothly
``deviation.exr``
    its standard deviation; where it was filled, that of the light that was seen; where all
    photographs saturate, as much as the radiance, which is then a lower bound
``confidence.exr``
    the exit cosine of the best view: 0 where nothing was shown

and ``light.json`` (what was done, slow light and lamps), ``light.png``, and ``response.txt`` where
the response was recovered.  Where no camera is given the world's +X is to the right in the picture,
+Z is up, and the camera looks along +Y.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.harmonics import LatLongGrid
from jaxrender.imaging import Circle, Curve
from jaxrender.io import read_image, write_curve, write_image
from jaxrender.lighting import (
    Ball,
    BallView,
    Environment,
    Evidence,
    MergedViews,
    ball_of_circle,
    ball_of_mask,
    candidates,
    fill_smoothly,
    merge_views,
    take,
    view_of_ball,
)
from jaxrender.pipelines.contact_sheet import write_contact_sheet
from jaxrender.pipelines.lamps import Lamp, lamps_of
from jaxrender.pipelines.output import FolderState, fingerprint_of, prepare, result_folder
from jaxrender.pipelines.probe_views import MergedView, Reading, View, merged_views, read_views
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.shapes import Bool, Float

# Light that was seen with less than this exit cosine is filled.
_SEEN = 0.1
_LEAST_ROWS = 16


class ProbeOptions(NamedTuple):
    """How a ball becomes an environment.

    ``ball`` is row, column and radius of its circle in pixels, ``mask`` a picture that is white on
    the ball.  ``camera_angle`` in degrees: what shows the camera itself.  ``sigma``: the roughness
    at which light is slow.
    """

    reading: Reading = Reading()
    mask: Path | None = None
    ball: tuple[float, float, float] | None = None
    reflectance: float = 0.65
    camera_angle: float = 5.0
    height: int | None = None
    sigma: float = 0.1


class LightProbe(NamedTuple):
    """The written folder, the light, and the lines that sum it up."""

    folder: Path
    lines: tuple[str, ...]


def light_probe(
    photographs: Sequence[Path],
    out: Path,
    options: ProbeOptions | None = None,
    progress: Progress | None = None,
    force: bool = False,
) -> LightProbe:
    """Write the folder; raises ``InputError`` for photographs that show no light."""
    options, progress = options or ProbeOptions(), progress or SilentProgress()
    _check(options)
    with progress.stage("read"):
        views = read_views(photographs, options.reading)
    files = [path for view in views for path in view.paths] + list(photographs)
    files += [options.mask] if options.mask else []
    response = options.reading.response
    if response is not None and Path(response).is_file():
        files.append(Path(response))
    digest = fingerprint_of("light", repr(options), files)
    if prepare(out, digest, force) is FolderState.FINISHED:
        progress.note(f"{out}: made before; reused (--force: anew)")
        return LightProbe(out, tuple(_stored(out / "light.json")["summary"]))
    with progress.stage("merge"):
        found, curve, said = merged_views(views, options.reading, progress.note)
    with progress.stage("unwrap"):
        balls = [_ball(view.view, options) for view in found]
        merged, clipped = _unwrapped(found, balls, options)
        environment, deviation, filled = _whole(merged)
        lamps, slow = lamps_of(environment, options.sigma)
    about = {
        "convention": "z-up",
        "channels": "linear red, green and blue of the camera",
        "units": "radiance 1 fills the scale of a photograph of exposure 1 that sees it directly",
        "reflectance": options.reflectance,
        "response": said,
        "views": [_account(one, ball) for one, ball in zip(found, balls)],
        "disagreement_of_views": merged.disagreement if len(found) > 1 else None,
        "left_out": f"within {options.camera_angle:g} degrees of the camera, and saturated pixels",
        "filled_part": filled,
        "saturated_part": _part(clipped),
        "sigma": options.sigma,
        "slow_energy": slow,
        "lamps": [
            {"direction": lamp.direction.tolist(), "irradiance": lamp.irradiance.tolist()}
            for lamp in lamps
        ],
    }
    about["summary"] = lines = _summary(about, said, lamps)
    with progress.stage("write"), result_folder(out, digest, force) as folder:
        write_image(folder / "probe.exr", np.asarray(environment.radiance))
        write_image(folder / "deviation.exr", deviation)
        write_image(folder / "confidence.exr", merged.confidence[..., None])
        if isinstance(curve, Curve) and "recovered" in said:
            write_curve(folder / "response.txt", curve, said)
        text = json.dumps(about, indent=2, allow_nan=False)
        (folder / "light.json").write_text(text + "\n", encoding="utf-8")
        _draw(folder / "light.png", environment, merged, options.sigma, lamps)
    return LightProbe(out, tuple(lines))


def _check(options: ProbeOptions) -> None:
    for name, value in (("reflectance", options.reflectance), ("sigma", options.sigma)):
        if not 0 < value <= 1:
            raise InputError(f"--{name} is {value:g}: give a number above 0 and up to 1")
    if not 0 <= options.camera_angle < 90:
        raise InputError(f"--camera-angle is {options.camera_angle:g}: give 0 to below 90 degrees")
    if options.height is not None and options.height < _LEAST_ROWS:
        raise InputError(f"--height is {options.height}: give {_LEAST_ROWS} rows or more")
    if options.ball is not None and options.mask is not None:
        raise InputError("--ball and --mask both say where the ball is: give one of them")


def _ball(view: View, options: ProbeOptions) -> Ball:
    """Find the ball of a view: as stated, by its mask, or by its alpha."""
    place = str(view.paths[0])
    try:
        if options.ball is not None:
            row, column, radius = options.ball
            if not radius > 0:
                raise ValueError(f"--ball: the radius is {radius:g}; give one above 0")
            return ball_of_circle(Circle(row, column, radius, 0.0, 1.0), view.camera)
        if options.mask is not None:
            place = str(options.mask)
            mask = read_image(options.mask).pixels.mean(axis=-1)
            return ball_of_mask(mask / max(float(mask.max()), 1e-300), view.camera)
        if view.mask is not None:
            return ball_of_mask(view.mask, view.camera)
        if view.images[0].alpha is not None:
            return ball_of_mask(view.images[0].alpha, view.camera)
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{place}: {error}") from None
    raise InputError(
        f"{place}: where is the ball? give --ball ROW,COLUMN,RADIUS in pixels, --mask PICTURE, or "
        "mask_path in transforms.json"
    )


class _Unwrapped(NamedTuple):
    """Merged views, and where all of them saturate: there their radiance is a lower bound."""

    merged: MergedViews
    clipped: Bool[np.ndarray, "row column"]


def _unwrapped(
    found: Sequence[MergedView], balls: Sequence[Ball], options: ProbeOptions
) -> _Unwrapped:
    """Unwrap every view, all to one height, and merge them.

    Saturated pixels are left out.  Where nothing else was seen, they come back as a bound.
    """
    lit = [np.asarray(np.isfinite(one.merged.standard_deviation).all(axis=-1)) for one in found]
    height = options.height or max(map(_rows, found, balls))
    if height < _LEAST_ROWS:
        raise InputError(
            f"{found[0].view.paths[0]}: the ball's radius is {height} pixels: photograph it "
            f"larger, {_LEAST_ROWS} or more"
        )
    merged = merge_views([_view(*each, height, options) for each in zip(found, balls, lit)])
    clipped = np.zeros(merged.confidence.shape, bool)
    if all(mask.all() for mask in lit):
        return _Unwrapped(merged, clipped)
    whole = merge_views(
        [_view(one, ball, None, height, options) for one, ball in zip(found, balls)]
    )
    clipped = (merged.confidence < _SEEN) & (whole.confidence >= _SEEN)
    radiance = np.where(clipped[..., None], whole.radiance, merged.radiance)
    deviation = np.where(clipped[..., None], whole.radiance, merged.deviation)
    confidence = np.where(clipped, whole.confidence, merged.confidence)
    return _Unwrapped(MergedViews(radiance, deviation, confidence, merged.disagreement), clipped)


def _rows(one: MergedView, ball: Ball) -> int:
    """The ball's radius in pixels."""
    camera = one.view.camera
    right = camera.world_from_camera[:3, 0] * ball.radius
    edge = camera.project(np.stack([ball.centre, ball.centre + right]))
    return round(float(np.linalg.norm(edge[1] - edge[0])))


def _view(
    one: MergedView,
    ball: Ball,
    usable: Bool[np.ndarray, "photo_row photo_column"] | None,
    height: int,
    options: ProbeOptions,
) -> BallView:
    deviation = one.merged.standard_deviation
    deviation = np.where(np.isfinite(deviation), deviation, 0)
    try:
        return view_of_ball(
            one.merged.radiance,
            one.view.camera,
            ball,
            height,
            Evidence(deviation, usable),
            reflectance=options.reflectance,
            camera_angle=math.radians(options.camera_angle),
        )
    except ValueError as error:
        raise InputError(f"{one.view.paths[0]}: {error}") from None


class _Whole(NamedTuple):
    """An environment without gaps, its standard deviation, and the part that was filled."""

    environment: Environment
    deviation: Float[np.ndarray, "row column channel"]
    filled: float


def _whole(merged: MergedViews) -> _Whole:
    seen = merged.confidence >= _SEEN
    weights = LatLongGrid(*seen.shape).weights()
    radiance = fill_smoothly(merged.radiance, seen)
    mean = np.average(radiance[seen], axis=0, weights=weights[seen])
    spread = np.average((radiance[seen] - mean) ** 2, axis=0, weights=weights[seen])
    deviation = np.where(seen[..., None], merged.deviation, np.sqrt(spread))
    return _Whole(Environment(radiance), deviation, _part(~seen))


def _part(marked: Bool[np.ndarray, "row column"]) -> float:
    """The part of all directions that is marked."""
    weights = LatLongGrid(*marked.shape).weights()
    return float(weights[marked].sum() / weights.sum())


def _account(one: MergedView, ball: Ball) -> dict:
    """What is said of a view: its photographs, and where the ball's outline is."""
    camera = one.view.camera
    xy = camera.project(np.asarray(ball.centre, float)[None])[0]
    account = one.account | {"ball": {"row": float(xy[1]), "column": float(xy[0])}}
    account["camera_to_world"] = camera.world_from_camera.tolist()
    saturated = ~np.isfinite(one.merged.standard_deviation).all(axis=-1)
    account["saturated_part_of_the_picture"] = float(saturated.mean())
    return account


def _summary(about: dict, said: str, lamps: Sequence[Lamp]) -> list[str]:
    lines = [said]
    count = len(about["views"])
    if count > 1:
        share = 100 * about["disagreement_of_views"]
        lines.append(f"{count} views, which disagree by {share:.2g} % (rms of the light)")
    lines.append(f"{100 * about['filled_part']:.2g} % of all directions were not seen: filled")
    if about["saturated_part"] > 0:
        lines.append(
            f"warning: {100 * about['saturated_part']:.2g} % of all directions are saturated in "
            "every photograph: their light is a lower bound; add a shorter exposure"
        )
    lines.append(f"{100 * about['slow_energy']:.3g} % of the energy is slow light, the rest lamps")
    for number, lamp in enumerate(lamps):
        place = ", ".join(f"{x:.3f}" for x in lamp.direction)
        power = ", ".join(f"{x:.3g}" for x in lamp.irradiance)
        lines.append(f"lamp {number + 1}: direction ({place}), irradiance ({power})")
    return lines


def _draw(
    path: Path,
    environment: Environment,
    merged: MergedViews,
    sigma: float,
    lamps: Sequence[Lamp],
) -> None:
    """Draw the light, its slow part, what was seen, and where the lamps are."""
    found = candidates(environment, sigma)
    slow = np.asarray(take(environment, found, len(found.cell), sigma).slow.radiance)
    directions = environment.grid.directions()
    marked = np.zeros(environment.grid.shape)
    for lamp in lamps:
        near = directions @ lamp.direction > math.cos(max(sigma / 2, 2 * np.pi / len(marked)))
        marked[near] = 1
    pictures = {
        "the light": np.asarray(environment.radiance),
        "slow light": slow,
        "lamps": marked[..., None] + 0.02,
        "confidence": merged.confidence[..., None],
    }
    write_contact_sheet(path, pictures, "light around the ball: +Z up, azimuth to the right")


def _stored(path: Path) -> dict:
    from jaxrender.io.jsonfiles import read_json

    return read_json(path)
