"""Where cameras stood around the object, and the largest gap between them."""

from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes

from jaxrender.pipelines.report.plots import INK, SERIES, small_plot
from jaxrender.shapes import Float

# Places of a new camera that are tried: this many, from a little below the horizon up.
_TRIED, _LOWEST = 4000, -0.17
# So many faces of a mesh say which places see its front.
_FACES = 1000
# A place that sees less than this part of what the best place sees is none for a camera.
_LEAST_FRONT = 0.2


class Gap(NamedTuple):
    """The direction that is farthest from every camera, and how far that is; all in degrees."""

    azimuth: float
    elevation: float
    radius: float


def gap_among(
    views: Float[np.ndarray, "camera 3"], faces: Float[np.ndarray, "face 3"]
) -> Gap | None:
    """Find the largest gap among directions to cameras; None where there are no cameras.

    ``faces`` are normals of a mesh, none for a sphere.  A place from which an open mesh shows its
    back is no gap.
    """
    if not len(views):
        return None
    # A spiral of equal areas, from the zenith down.
    step = (np.arange(_TRIED) + 0.5) / _TRIED
    height = 1 - (1 - _LOWEST) * step
    azimuth = np.pi * (1 + np.sqrt(5)) * np.arange(_TRIED)
    radius = np.sqrt(1 - height**2)
    places = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=-1)
    nearest = np.max(places @ views.T, axis=1)
    some = faces[:: max(1, len(faces) // _FACES)]
    front = np.maximum(places @ some.T, 0).sum(axis=1)
    best = int(np.argmin(np.where(front < _LEAST_FRONT * front.max(), np.inf, nearest)))
    turned = float(np.degrees(np.arctan2(places[best, 1], places[best, 0]))) % 360
    return Gap(
        turned,
        float(np.degrees(np.arcsin(height[best]))),
        float(np.degrees(np.arccos(np.clip(nearest[best], -1, 1)))),
    )


def views_plot(views: Float[np.ndarray, "camera 3"], gap: Gap) -> Markup:
    """Draw azimuth and elevation of the cameras, and the gap."""
    azimuth = np.degrees(np.arctan2(views[:, 1], views[:, 0])) % 360
    elevation = np.degrees(np.arcsin(np.clip(views[:, 2], -1, 1)))

    def paint(axes: Axes) -> None:
        axes.scatter(azimuth, elevation, s=30, color=SERIES[0], label="cameras")
        axes.scatter(
            [gap.azimuth], [gap.elevation], s=170, facecolors="none", edgecolors=SERIES[1],
            linewidths=1.8, label="largest gap", clip_on=False,
        )  # fmt: skip
        axes.set_xlim(-5, 365)
        axes.set_xticks(range(0, 361, 90))
        axes.set_ylim(min(-20.0, float(elevation.min()) - 5), 95)
        axes.axhline(0, color=INK, linewidth=0.8)
        axes.set_xlabel("azimuth [degrees]")
        axes.set_ylabel("elevation [degrees]")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)

    told = f"{len(views)} cameras, and the largest gap at azimuth {gap.azimuth:.0f} degrees"
    return small_plot("front-views", told, paint)
