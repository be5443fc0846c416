"""What a fit has freed, as a result states it: values, errors, mended cameras, pictures."""

from pathlib import Path
from typing import Any

import numpy as np

from jaxrender.geometry import Shape
from jaxrender.inverse.calibration import Calibration
from jaxrender.inverse.misfit import Left
from jaxrender.inverse.nuisances import NUISANCES
from jaxrender.inverse.photographs import Photograph
from jaxrender.io import Capture, Frame, write_capture
from jaxrender.shapes import Float

# The mended cameras of the only capture.
CAMERAS = "capture.json"


def calibration_document(calibration: Calibration, photographs: list[Photograph]) -> dict[str, Any]:
    """Lay out what was freed: for each nuisance its numbers, errors and priors, in units."""
    found = {}
    for name in calibration.free:
        nuisance, numbers = NUISANCES[name], calibration.corrections.of(name)
        every = len(numbers)
        found[name] = {
            "meaning": nuisance.meaning,
            "value": nuisance.in_units(numbers).tolist(),
            "standard_error": nuisance.in_units(calibration.errors[name]).tolist(),
            "prior": nuisance.in_units(nuisance.deviations(every)).tolist(),
            "unit": [unit.name for unit in nuisance.units],
        }
        if name in ("exposure", "camera"):
            found[name]["photographs"] = [p.frame.name for p in photographs]
    return {
        "free": list(calibration.free),
        "settled": calibration.settled,
        "nuisances": found,
        "sentences": list(calibration.sentences),
    }


def by_photograph(
    fitted: Left,
    photographs: list[Photograph],
    calibration: Calibration | None,
    gains: Float[np.ndarray, "frame"] | None = None,
) -> list[dict[str, Any]]:
    """Sum up what a fit leaves of each photograph, relative to its radiance (rms).

    And its gain and how far its camera was turned, where these were free.
    """
    observed, found = fitted.observations, []
    radiance, frame = np.asarray(observed.radiance, float), np.asarray(observed.frame)
    pixels = observed.pixels[:, None]
    if calibration is not None and "exposure" in calibration.free:
        gains = np.exp(calibration.corrections.exposure)
    for number, photograph in enumerate(photographs):
        own = frame == number
        squares, level = (
            float(np.sum((pixels * part**2)[own])) for part in (fitted.residual, radiance)
        )
        rms = float(np.sqrt(squares / level)) if level > 0 else None
        row: dict[str, Any] = {"name": photograph.frame.name, "relative_rms": rms}
        if gains is not None:
            row["gain"] = float(gains[number])
        if calibration is not None and "camera" in calibration.free:
            turned = float(np.linalg.norm(calibration.corrections.camera[number]))
            row["turned_degrees"] = float(np.degrees(turned))
        found.append(row)
    return found


def mended(
    photographs: list[Photograph], calibration: Calibration, shape: Shape
) -> list[Photograph]:
    """See the object as the mended cameras do; pixels stay those of the files."""
    corrections = calibration.corrections
    return [
        photograph._replace(view=corrections.view(photograph.frame.camera, number, shape))
        for number, photograph in enumerate(photographs)
    ]


def write_cameras(
    folder: Path,
    calibration: Calibration,
    photographs: list[Photograph],
    shape: Shape,
) -> None:
    """Write mended cameras and exposures, for another fit to start from.

    Each of several captures has a file of its own, with its number.
    """
    corrections = calibration.corrections
    frames: dict[int, list[Frame]] = {}
    captures = {id(photograph.capture): photograph.capture for photograph in photographs}
    for number, photograph in enumerate(photographs):
        frame, gain = photograph.frame, float(np.exp(corrections.exposure[number]))
        exposure = frame.exposure
        if gain != 1:
            exposure = gain * (1.0 if exposure is None else exposure)
        camera = corrections.camera_of(frame.camera, number, shape)
        mended = frame._replace(camera=camera, exposure=exposure)
        frames.setdefault(id(photograph.capture), []).append(mended)
    for at, (key, own) in enumerate(frames.items(), 1):
        name = CAMERAS if len(frames) == 1 else f"capture_{at}.json"
        write_capture(folder / name, Capture(tuple(own), captures[key].source))
