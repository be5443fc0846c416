"""Several panoramas on one page, each with its own tone curve."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from jaxrender.pipelines.report.display import shrunk, tone_key, tone_mapped
from jaxrender.shapes import Float

_COLUMNS = 2
# Width of the page, and of a picture in texels.
_INCHES, _LONGEST = 11.0, 512


def write_contact_sheet(
    path: Path, pictures: Mapping[str, Float[np.ndarray, "_ _ channel"]], title: str
) -> None:
    """Draw the pictures in reading order, with their names, as a PNG."""
    rows = -(-len(pictures) // _COLUMNS)
    figure = Figure(figsize=(_INCHES, 0.6 + rows * _INCHES / _COLUMNS * 0.58), layout="constrained")
    figure.suptitle(title)
    for place, (name, picture) in enumerate(pictures.items()):
        axes = figure.add_subplot(rows, _COLUMNS, place + 1)
        # Few texels filter the light well and look coarse; smoothed, they look like what they are.
        # Where a sharp lobe rings they are below zero, of which there is no logarithm.
        lit = np.maximum(picture, 0)
        shown = tone_mapped(shrunk(lit, _LONGEST), tone_key(lit))
        axes.imshow(shown, interpolation="bicubic", aspect="equal")
        axes.set_title(name, fontsize=10)
        axes.set_axis_off()
    figure.savefig(path, dpi=110)
