"""Lights and BRDFs that show themselves in a notebook: ``%load_ext jaxrender``.

What a fit returns has a picture of its own, with or without this.
"""

from typing import Any

from jaxrender.brdf import BRDF
from jaxrender.lighting import Light
from jaxrender.pipelines.plots import png_of_plot


def load_ipython_extension(ipython: Any) -> None:
    """Let IPython draw every light and every BRDF that ends a cell."""
    pictures = ipython.display_formatter.formatters["image/png"]
    for kind in (Light, BRDF):
        pictures.for_type(kind, png_of_plot)


def unload_ipython_extension(ipython: Any) -> None:
    """Let them be printed as text again."""
    pictures = ipython.display_formatter.formatters["image/png"]
    for kind in (Light, BRDF):
        pictures.pop(kind, None)
