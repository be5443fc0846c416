"""How a spherical harmonic reflection map is laid out in a file: names, conventions, coordinates.

Every convention is an attribute: a word for programs, and a sentence for people.
"""

from typing import Any, NamedTuple

import numpy as np

from jaxrender.harmonics import CubeGrid, Grid, LatLongGrid, degrees, orders
from jaxrender.io.netcdf import Format, Variable
from jaxrender.reflection.shrm import GlobalShrm, LocalShrm, Shrm

FORMAT = Format("jaxrender spherical harmonic reflection map", 1, "jaxrender prefilter --shrm")

FRAMES: dict[str, type[Shrm]] = {"local": LocalShrm, "global": GlobalShrm}
GRIDS: dict[str, type[Grid]] = {"latitude-longitude": LatLongGrid, "cube": CubeGrid}
DIMENSIONS = ("row", "column", "outgoing", "channel")
AXES = ("world", "probe")

# What each convention means, for people who have the file alone.
_FORMULA = "B(C, o) = sum over k of maps[C, k] Y_k(o), k = p (p + 1) + q of `degree` and `order`"
_HARMONICS = (
    "real, orthonormal, without Condon-Shortley sign: Y_11 = +0.488603 x, q < 0 has sin(|q| phi)"
)
_FRAME_MEANING = {
    "local": "o in the frame of its texel, Rz(azimuth) Ry(polar angle), C its third axis",
    "global": "o in the same axes as C: for a distant viewer one Y_k(o) serves all texels",
}
WEIGHTED_MEANING = {
    0: "maps hold the reflected light B itself",
    1: "maps hold B cos t_o: divide by cos t_o = sqrt((1 + C . o) / 2), the exit cosine",
}
CENTRE_MEANING = {
    "reflected": "C is the direction to the viewer, reflected about the surface's normal",
    "normal": "C is the surface's normal",
}
_GRID_MEANING = {
    "latitude-longitude": "rows from +z down, columns by the azimuth from +x towards +y",
    "cube": "six square faces below each other: +x, +y, -x, -y, +z, -z; see `direction`",
}


class ShrmAbout(NamedTuple):
    """What a map was made from; parts of energies are NaN where they were not computed."""

    source: str
    brdf: str
    axes: str = "world"
    central_direction: str = "reflected"
    units: str = "radiance"
    convention: str = ""
    light_missing: float = float("nan")
    """Part of the light's energy that lies beyond the band limit (T 5.16)."""
    brdf_missing: float = float("nan")
    """Part of the BRDF's energy beyond the kept degrees (T 5.18)."""
    comment: str = ""


class ReflectionMap(NamedTuple):
    """A map with its description; ``about.comment`` is a sentence for people."""

    shrm: Shrm
    about: ShrmAbout


def coordinates(grid: Grid, order: int) -> dict[str, Variable]:
    """Make the arrays of a map's coordinates."""
    found = {}
    for name, numbers in (("degree", degrees(order)), ("order", orders(order))):
        words = f"{name} of an outgoing harmonic"
        found[name] = Variable(("outgoing",), numbers.astype(np.int32), "1", words)
    if isinstance(grid, LatLongGrid):
        polar, azimuth = grid.polar_angles(), grid.azimuths()
        found["polar_angle"] = Variable(("row",), polar, "radian", "polar angle of C")
        found["azimuth"] = Variable(("column",), azimuth, "radian", "azimuth of C")
    else:
        dimensions = ("row", "column", "component")
        found["direction"] = Variable(dimensions, grid.directions(), "1", "C of a texel")
    return found


def attributes(shrm: Shrm, about: ShrmAbout) -> dict[str, Any]:
    """Arrange all that is not an array; ``ValueError`` for what a file does not hold."""
    frame = next((name for name, kind in FRAMES.items() if type(shrm) is kind), None)
    grid = next((name for name, kind in GRIDS.items() if type(shrm.grid) is kind), None)
    is_named = about.central_direction in CENTRE_MEANING and about.axes in AXES
    # The weight is known from the reflected direction alone.
    if shrm.weighted and about.central_direction == "normal":
        raise ValueError("a weighted map about the normal does not hold its weight; divide it out")
    if frame is None or grid is None or not is_named:
        raise ValueError(
            f"{type(shrm).__name__} on {type(shrm.grid).__name__} about "
            f"{about.central_direction!r} in axes {about.axes!r}: a file holds a LocalShrm or "
            f"GlobalShrm on a LatLongGrid or CubeGrid, about {' or '.join(CENTRE_MEANING)}, in "
            f"axes {' or '.join(AXES)}"
        )
    weighted = int(shrm.weighted)
    return {
        **about._asdict(),
        "central_direction_meaning": CENTRE_MEANING[about.central_direction],
        "formula": _FORMULA,
        "harmonics": _HARMONICS,
        "frame": frame,
        "frame_meaning": _FRAME_MEANING[frame],
        "grid": grid,
        "grid_meaning": _GRID_MEANING[grid],
        "band_limit": shrm.band_limit,
        "view_degree": shrm.order,
        "weighted": weighted,
        "weighted_meaning": WEIGHTED_MEANING[weighted],
    }
