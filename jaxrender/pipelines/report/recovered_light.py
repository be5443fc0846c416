"""The page of a recovered light: its pictures, and the parameters round by round."""

from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from jaxrender.brdf import Parametric
from jaxrender.inverse import Factorization
from jaxrender.inverse.factorization import Round
from jaxrender.pipelines.report.comparison import comparison
from jaxrender.pipelines.report.contents import FramePictures, Page, Pictures, Shown, is_diffuse
from jaxrender.pipelines.report.display import data_uri, shrunk, tone_key, tone_mapped
from jaxrender.pipelines.report.light import Circle, circles_on_map
from jaxrender.pipelines.report.plots import INK, SERIES, plot
from jaxrender.pipelines.tasks.light.images import LightImages

_LONGEST_SIDE = 400
# Recovered darkness is not exact: the tone curve does not brighten less than this part of the mean.
_DARKEST = 0.3
# The parameters' plot shows at least this much to either side, per cent.
_LEAST_RANGE = 5.0
# A parameter that moved by less, relative to its value, was known.
_STILL = 1e-9
_KICKERS = {
    "factorize": "Material and light recovered from photographs",
    "lighting": "Light recovered from photographs",
}


class LightPictures(NamedTuple):
    """The images as data URIs, tone-mapped alike, and the sources as circles."""

    whole: str
    slow: str
    deviation: str
    sources: tuple[Circle, ...]


class Path(NamedTuple):
    """The plot of the parameters, if any was unknown, and the plot of the residual."""

    parameters: Markup | None
    residual: Markup


class LightContents(NamedTuple):
    """All that the report of a recovered light shows."""

    title: str
    result: dict[str, Any]
    fit: Factorization
    images: LightImages
    frames: tuple[FramePictures, ...]


def light_page(contents: LightContents) -> Page:
    """Lay out the page."""
    found = contents.fit
    sections = {
        "kicker": _KICKERS[contents.result["task"]],
        "pictures": light_pictures(contents),
        "comparison": comparison(contents),
        "band_limit": contents.result["lighting"]["band_limit"],
        "finer": found.rounds[-1].band_limit > found.rounds[0].band_limit,
        "clusters": len(found.scene.clusters),
        "wide": 0 if found.scene.widths is None else int(np.count_nonzero(found.scene.widths)),
        "diffuse": is_diffuse(contents),
        "identifiable": contents.result["lighting"]["sentence"],
        "path": path_plots(contents),
    }
    caption = "The recovered light, all around: the zenith is at the top."
    first = Pictures(Shown(sections["pictures"].whole, caption))
    return Page("light.html.j2", contents, sections, first)


def light_pictures(contents: LightContents) -> LightPictures:
    """Draw the light; the tone curve is that of its slow part, since sources are much brighter."""
    key = tone_key(contents.images.slow, _DARKEST)
    whole, slow, deviation = (
        data_uri(tone_mapped(shrunk(image, _LONGEST_SIDE), key)) for image in contents.images[:3]
    )
    return LightPictures(whole, slow, deviation, circles_on_map(contents.fit.scene.sources))


def path_plots(contents: LightContents) -> Path:
    """Plot the end of each round, relative to the final values."""
    rounds = contents.fit.rounds
    steps = np.arange(len(rounds))
    moved = _moved(rounds, contents.fit.brdf)

    def label(axes: Axes) -> None:
        axes.set_xticks(steps, [str(one.sources) for one in rounds])
        axes.set_xlabel("number of sources, round by round; the last is refined")
        axes.yaxis.set_major_locator(MaxNLocator(5))

    def paint_parameters(axes: Axes) -> None:
        for (name, values), colour in zip(moved.items(), SERIES):
            axes.plot(steps, 100 * np.asarray(values), color=colour, marker="o", ms=3, label=name)
        # The first round, without any source, may be far off: it does not set the scale.
        later = [abs(value) for values in moved.values() for value in values[1:]]
        limit = max(_LEAST_RANGE, 120 * max(later, default=0.0))
        axes.set_ylim(-limit, limit)
        axes.set_ylabel("difference from the final value, %")
        axes.legend()
        label(axes)

    def paint_residual(axes: Axes) -> None:
        axes.semilogy(steps, [100 * one.relative_rms for one in rounds], color=INK, marker="o")
        axes.set_ylabel("unexplained, % rms")
        label(axes)
        axes.set_yscale("log")

    shown = ", ".join(f"{one.sources}: {100 * one.relative_rms:.3g} %" for one in rounds)
    drawn = None
    if moved:
        described = f"Parameters by number of sources, {shown}"
        drawn = plot("path-parameters", described, paint_parameters)
    return Path(
        drawn,
        plot("path-residual", f"Residual by number of sources: {shown}", paint_residual),
    )


def _moved(rounds: tuple[Round, ...], brdf: Parametric) -> dict[str, list[float]]:
    """Compare each parameter with its last value; known ones are left out."""
    last = rounds[-1]
    width = "sigma" if brdf.shape.name == "sigma" else "lobe width"
    # mu - 1 is what a model's own second number is, where that is no index.
    second = "mu - 1" if brdf.index.offset == 0 else brdf.index.name
    paths = {
        width: [one.sigma for one in rounds],
        "ks share": [float(np.mean(one.share)) for one in rounds],
        second: [one.mu - 1 for one in rounds if np.isfinite(last.mu)],
    }
    return {
        name: [value / path[-1] - 1 for value in path]
        for name, path in paths.items()
        if path and np.ptp(path) > _STILL * abs(path[-1])
    }
