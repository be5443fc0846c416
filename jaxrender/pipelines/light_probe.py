"""Light from photographs of a mirror ball, through a fisheye, or of a panorama, with its errors.

The folder holds, as latitude-longitude images of the convention ``z-up``:

``probe.exr``
    radiance; what no photograph shows is filled smoothly
``deviation.exr``
    its standard deviation; where it was filled, that of the light that was seen; where all
    photographs saturate, as much as the radiance, which is then a lower bound
``confidence.exr``
    the exit cosine of the best view, or the part of a texel that it shows: 0 where nothing was

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
from jaxrender.imaging import Curve
from jaxrender.io import write_curve, write_image
from jaxrender.lighting import (
    Environment,
    MergedViews,
    candidates,
    fill_smoothly,
    take,
)
from jaxrender.pipelines.contact_sheet import write_contact_sheet
from jaxrender.pipelines.lamps import Lamp, lamps_of
from jaxrender.pipelines.output import FolderState, fingerprint_of, prepare, result_folder
from jaxrender.pipelines.probe_unwrapping import (
    LEAST_ROWS,
    SEEN,
    FoundBall,
    ProbeOptions,
    ball_of,
    unwrapped,
)
from jaxrender.pipelines.probe_views import MergedView, merged_views, read_views
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.shapes import Bool, Float


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
        located = [ball_of(view.view, options) for view in found]
        balls = [one.ball for one in located]
        merged, clipped = unwrapped(found, balls, options)
        environment, deviation, filled = _whole(merged)
        lamps, slow = lamps_of(environment, options.sigma)
    about = {
        "convention": "z-up",
        "channels": "linear red, green and blue of the camera",
        "units": "radiance 1 fills the scale of a photograph of exposure 1 that sees it directly",
        "seen": options.reading.lens or "ball",
        "reflectance": None if options.reading.lens else options.reflectance,
        "response": said,
        "views": [_account(*each) for each in zip(found, located)],
        "disagreement_of_views": merged.disagreement if len(found) > 1 else None,
        "left_out": _left_out(options),
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


def _left_out(options: ProbeOptions) -> str:
    if options.reading.lens is not None:
        return "what is masked or beyond the field of view, and saturated pixels"
    return f"within {options.camera_angle:g} degrees of the camera, and saturated pixels"


def _check(options: ProbeOptions) -> None:
    for name, value in (("reflectance", options.reflectance), ("sigma", options.sigma)):
        if not 0 < value <= 1:
            raise InputError(f"--{name} is {value:g}: give a number above 0 and up to 1")
    if not 0 <= options.camera_angle < 90:
        raise InputError(f"--camera-angle is {options.camera_angle:g}: give 0 to below 90 degrees")
    if options.height is not None and options.height < LEAST_ROWS:
        raise InputError(f"--height is {options.height}: give {LEAST_ROWS} rows or more")
    lens = options.reading.lens
    if lens is not None and (options.ball is not None or options.mask is not None):
        raise InputError(f"--{lens} shows no ball: leave out --ball and --mask")
    if not 0 < options.reading.field <= 360:
        raise InputError(f"--fisheye {options.reading.field:g}: give 1 to 360 degrees")
    if options.ball is not None and options.mask is not None:
        raise InputError("--ball and --mask both say where the ball is: give one of them")


class _Whole(NamedTuple):
    """An environment without gaps, its standard deviation, and the part that was filled."""

    environment: Environment
    deviation: Float[np.ndarray, "row column channel"]
    filled: float


def _whole(merged: MergedViews) -> _Whole:
    seen = merged.confidence >= SEEN
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


def _account(one: MergedView, located: FoundBall) -> dict:
    """What is said of a view: its photographs, and where the ball's outline is."""
    camera = one.view.camera
    account, ball = dict(one.account), located.ball
    if ball is not None:
        xy = camera.project(np.asarray(ball.centre, float)[None])[0]
        account["ball"] = {"row": float(xy[1]), "column": float(xy[0]), "found": located.by}
    account["camera_to_world"] = camera.world_from_camera.tolist()
    saturated = ~np.isfinite(one.merged.standard_deviation).all(axis=-1)
    account["saturated_part_of_the_picture"] = float(saturated.mean())
    return account


def _summary(about: dict, said: str, lamps: Sequence[Lamp]) -> list[str]:
    lines = [said]
    for one in about["views"]:
        if one.get("ball", {}).get("found", "").startswith("by its edges"):
            lines.append(f"{one['photographs'][0]}: the ball was found {one['ball']['found']}")
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
    write_contact_sheet(path, pictures, "the light: +Z up, azimuth to the right")


def _stored(path: Path) -> dict:
    from jaxrender.io.jsonfiles import read_json

    return read_json(path)
