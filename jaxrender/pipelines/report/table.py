"""The table that corrects a material: where the photographs changed the model, and how surely."""

from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes

from jaxrender.brdf.tables.isotropic import node_angles
from jaxrender.inverse.brdf_table import Correction
from jaxrender.pipelines.report.contents import MaterialContents
from jaxrender.pipelines.report.plots import INK, SERIES, plot
from jaxrender.pipelines.report.wording import percent, shown

# Difference angles (degrees) that are drawn, each as a line.
_DRAWN = (15.0, 45.0, 75.0)
# The factor is drawn from 1/2 to 2, or as far as it goes, but to no more than ten times either way.
_REACH = (2.0, 10.0)
# Beyond this half angle (degrees) there is little to see.
_WIDEST = 60.0
_TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10)


class TableSection(NamedTuple):
    """What the page says of a table, in words and numbers, and the factor as lines."""

    sentence: str
    before: str
    after: str
    seen: str
    prior: str
    plot: Markup


def table(contents: MaterialContents) -> TableSection | None:
    """Lay out the section; None where the material has no table."""
    correction = contents.correction
    if correction is None:
        return None
    return TableSection(
        contents.result.get("table", {}).get("sentence", ""),
        percent(correction.before),
        percent(correction.after),
        percent(float(np.mean(correction.seen))),
        shown(correction.strength, 2),
        plot(
            "table-factor",
            "Factor that multiplies the model, by half angle, for three difference angles.",
            lambda axes: _paint(axes, correction),
        ),
    )


def _paint(axes: Axes, correction: Correction) -> None:
    """Draw the factor's mean over the azimuth and the channels, with one standard error."""
    angles = node_angles(correction.brdf.nodes)
    half = np.degrees(angles.theta_h[:, 0, 0])
    difference = np.degrees(angles.theta_d[0, :, 0])
    logarithm = np.log(np.asarray(correction.brdf.factor, float)).mean(axis=(2, 3))
    error = np.asarray(correction.log_error, float).mean(axis=(2, 3))
    inside = half <= _WIDEST
    drawn = [int(np.argmin(np.abs(difference - wanted))) for wanted in _DRAWN]
    farthest = float(np.exp(np.max(np.abs(logarithm[inside][:, drawn]))))
    reach = float(np.clip(1.1 * farthest, *_REACH))
    for wanted, at, colour in zip(_DRAWN, drawn, SERIES):
        middle, spread = logarithm[inside, at], error[inside, at]
        low, high = (np.clip(np.exp(middle + s * spread), 1 / reach, reach) for s in (-1, 1))
        axes.fill_between(half[inside], low, high, color=colour, alpha=0.2, linewidth=0)
        line = np.clip(np.exp(middle), 1 / reach, reach)
        axes.plot(half[inside], line, color=colour, label=f"difference {wanted:g}°")
    axes.axhline(1, color=INK, linewidth=0.6, linestyle="--")
    axes.set_yscale("log")
    axes.set_ylim(1 / reach, reach)
    ticks = [tick for tick in _TICKS if 1 / reach <= tick <= reach]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks], minor=False)
    axes.set_yticks([], minor=True)
    axes.set_xlabel("half angle [degrees]")
    axes.set_ylabel("corrected / model")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
