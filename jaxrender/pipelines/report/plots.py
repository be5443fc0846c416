"""Line plots as inline SVG that takes its colours and its font from the page.

matplotlib is used through ``Figure`` alone: pyplot would bring windows and a global state.  Colours
are stand-ins that turn into CSS variables afterwards, so one drawing serves light, dark and print.
The same data give the same bytes: ids are salted with the figure's name, and no date is written.
"""

import io
import re
from collections.abc import Callable
from typing import Any

from markupsafe import Markup, escape
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Stand-ins that occur nowhere else in a drawing, and the CSS variables they become.
INK, MUTED, GRID = "#010203", "#020304", "#030405"
SERIES = ("#040506", "#050607", "#060708")
_VARIABLES = {INK: "--ink", MUTED: "--muted", GRID: "--grid"} | {
    colour: f"--series-{number}" for number, colour in enumerate(SERIES, 1)
}
# Inches, of which the page makes what its column allows.
_SIZE = (5.0, 3.0)
_PLACE = (0.125, 0.155, 0.855, 0.715)
_SMALL_SIZE, _SMALL_PLACE = (3.1, 2.3), (0.19, 0.2, 0.77, 0.67)
_STYLE = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 8,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "text.color": INK,
    "legend.frameon": False,
    "legend.borderaxespad": 0.3,
    "legend.columnspacing": 1.4,
    "legend.handlelength": 1.8,
    "lines.linewidth": 1.6,
}


def small_plot(name: str, description: str, paint: Callable[[Axes], None]) -> Markup:
    """Draw a plot for a narrow column, where its letters stay legible."""
    return plot(name, description, paint, _SMALL_SIZE, _SMALL_PLACE)


def plot(
    name: str,
    description: str,
    paint: Callable[[Axes], None],
    size: tuple[float, float] = _SIZE,
    place: tuple[float, float, float, float] = _PLACE,
) -> Markup:
    """Draw one pair of axes; ``description`` is what a screen reader says instead."""
    stream = io.StringIO()
    style: dict[Any, Any] = {**_STYLE, "svg.hashsalt": name}
    with rc_context(style):
        figure = Figure(figsize=size)
        paint(figure.add_axes(place))
        figure.savefig(stream, format="svg", transparent=True, metadata={"Date": None})
    return _for_page(stream.getvalue(), name, description)


def _for_page(svg: str, name: str, description: str) -> Markup:
    """Keep of a stand-alone SVG file what belongs inside a page."""
    svg = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>", "", svg, flags=re.DOTALL)
    view_box = re.search(r'viewBox="([0-9. ]+)"', svg)
    body = re.search(r"<svg[^>]*>(.*)</svg>", svg, flags=re.DOTALL)
    assert view_box is not None
    assert body is not None
    inside = body[1].replace("xlink:href=", "href=")
    # Ids are unique within one drawing only.
    inside = re.sub(r'\bid="', f'id="{name}-', inside)
    inside = inside.replace('href="#', f'href="#{name}-').replace("url(#", f"url(#{name}-")
    inside = re.sub(r"font-family: [^;\"]*;? ?", "", inside)
    for colour, variable in _VARIABLES.items():
        inside = inside.replace(colour, f"var({variable})")
    inside = re.sub(r"\n\s*", " ", inside)
    return Markup(
        f'<svg class="plot" role="img" aria-label="{escape(description)}" '
        f'viewBox="{view_box[1]}">{inside}</svg>'
    )
