"""The page of a recovered light: its pictures, and the path that the parameters took."""

from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from jaxrender.pipelines.report.contents import LightContents
from jaxrender.pipelines.report.display import data_uri, shrunk, tone_key, tone_mapped
from jaxrender.pipelines.report.light import Circle, circles_on_map
from jaxrender.pipelines.report.plots import INK, SERIES, plot

_LONGEST_SIDE = 400
# The parameters' plot shows at least this much to either side, per cent.
_LEAST_RANGE = 5.0


class LightPictures(NamedTuple):
    """Both images as data URIs, tone-mapped alike, and the sources as circles."""

    whole: str
    slow: str
    sources: tuple[Circle, ...]


class Path(NamedTuple):
    """The parameters and the residual as sources were added."""

    parameters: Markup
    residual: Markup


def light_pictures(contents: LightContents) -> LightPictures:
    """Draw the light; the tone curve is that of its slow part, which lamps would drown."""
    whole, slow = contents.images
    key = tone_key(slow)
    return LightPictures(
        data_uri(tone_mapped(shrunk(whole, _LONGEST_SIDE), key)),
        data_uri(tone_mapped(shrunk(slow, _LONGEST_SIDE), key)),
        circles_on_map(contents.fit.scene.sources),
    )


def path_plots(contents: LightContents) -> Path:
    """Plot where each round ended, relative to where all ended."""
    rounds = contents.fit.rounds
    steps = np.arange(len(rounds))
    last = rounds[-1]
    brdf = contents.fit.brdf
    width = "sigma" if brdf.shape.name == "sigma" else "lobe width"
    moved = {
        width: [one.sigma / last.sigma - 1 for one in rounds],
        "ks share": [float(np.mean(one.share) / np.mean(last.share)) - 1 for one in rounds],
    }
    if np.isfinite(last.mu):
        # mu - 1 is what a model's own second number is, where that is no index.
        second = "mu - 1" if brdf.index.offset == 0 else brdf.index.name
        moved[second] = [(one.mu - 1) / (last.mu - 1) - 1 for one in rounds]

    def label(axes: Axes) -> None:
        axes.set_xticks(steps, [str(one.sources) for one in rounds])
        axes.set_xlabel("sources, round by round; last: refined")
        axes.yaxis.set_major_locator(MaxNLocator(5))

    def paint_parameters(axes: Axes) -> None:
        for (name, values), colour in zip(moved.items(), SERIES):
            axes.plot(steps, 100 * np.asarray(values), color=colour, marker="o", ms=3, label=name)
        # The first round, without any lamp, may be far off: it is not to set the scale.
        later = [abs(value) for values in moved.values() for value in values[1:]]
        limit = max(_LEAST_RANGE, 120 * max(later, default=0.0))
        axes.set_ylim(-limit, limit)
        axes.set_ylabel("off the final value, %")
        axes.legend()
        label(axes)

    def paint_residual(axes: Axes) -> None:
        axes.semilogy(steps, [100 * one.relative_rms for one in rounds], color=INK, marker="o")
        axes.set_ylabel("unexplained, % rms")
        label(axes)
        axes.set_yscale("log")

    shown = ", ".join(f"{one.sources}: {100 * one.relative_rms:.3g} %" for one in rounds)
    return Path(
        plot("path-parameters", f"Parameters by number of sources, {shown}", paint_parameters),
        plot("path-residual", f"Residual by number of sources: {shown}", paint_residual),
    )
