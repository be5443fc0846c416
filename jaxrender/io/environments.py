"""Environment images: any named panorama in, our latitude-longitude image out."""

import math
from pathlib import Path

import numpy as np

from jaxrender.errors import InputError
from jaxrender.io.images import MEND, read_image, write_image
from jaxrender.lighting.environment import Environment
from jaxrender.lighting.layouts import panorama_named
from jaxrender.lighting.panoramas import from_polar_rows, to_latlong, to_own_latlong

AXES = ("world", "probe")


def read_environment(
    path: str | Path,
    convention: str = "z-up",
    scale: float | int = 1.0,
    height: int | None = None,
    axes: str = "world",
    *,
    yaw: float | int = 0.0,
    mirrored: bool = False,
    at_poles: bool = False,
) -> Environment:
    """Read a panorama as the world's light, its radiance multiplied by ``scale``.

    ``convention`` is a name of ``lighting.PANORAMAS``; ``height`` the rows of the result, by
    default about the file's own resolution.  With ``axes="probe"`` the panorama's own axes stand in
    the place of the world's, for tools that speak of a probe alone.  A picture that is ``mirrored``
    is read from right to left; ``yaw`` then turns the light about the panorama's up, in degrees,
    counter-clockwise seen from above.  ``at_poles``: its first and last
    rows lie at the poles, as those of Mitsuba do.  Raises InputError for a file that cannot be read
    or has the wrong aspect, ValueError for an unknown convention, unknown axes
    or a scale that is not positive.
    """
    panorama_named(convention)
    if axes not in AXES:
        raise ValueError(f"axes={axes!r}: choose one of {', '.join(AXES)}")
    if not math.isfinite(yaw) or (yaw and axes == "probe"):
        raise ValueError(f"yaw is {yaw}: give finite degrees, and none for a probe's own axes")
    if not (math.isfinite(scale) and scale > 0):
        raise ValueError(f"scale is {scale}: it must be positive and finite")
    image = read_image(path, remedy=MEND)
    if image.metadata["is_integer"]:
        raise InputError(
            f"{path}: a panorama of integer values is not linear radiance; use EXR, HDR or PFM"
        )
    try:
        pixels = image.pixels[:, ::-1] if mirrored else image.pixels
        pixels = from_polar_rows(pixels) if at_poles else pixels
        if axes == "probe":
            return Environment(scale * to_own_latlong(pixels, convention, height))
        return Environment(scale * to_latlong(pixels, convention, height, yaw))
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None


def write_environment(path: str | Path, environment: Environment) -> None:
    """Write an environment as a z-up latitude-longitude image."""
    write_image(path, np.asarray(environment.radiance))
