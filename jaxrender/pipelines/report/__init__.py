"""The report: one HTML page about one fit, readable without this program and without a network.

``contents``
    what a report is made of
``wording`` ``display`` ``plots``
    numbers as words, radiance as pictures, curves as SVG
``comparison`` ``forecast``
    models side by side on held-out pixels; error bars foreseen beside those achieved
``account`` ``parameters``
    how the fit ended and what it was made from; the table of parameters and what sigma rests on
``photographs`` ``light`` ``material`` ``residuals`` ``spectra``
    one section's figures a file
``recovered_light``
    the page of a light that was recovered: its pictures, and the path of the parameters
``texture`` ``brdf_spectrum``
    the pages of a texture, and of a BRDF's coefficients
``page``
    the template ``report.html.j2`` and the style ``report.css`` filled with all of it
"""

from jaxrender.pipelines.report.contents import (
    FramePictures,
    LightContents,
    ReportContents,
    SpectrumContents,
    TextureContents,
)
from jaxrender.pipelines.report.page import write_report

__all__ = [
    "FramePictures",
    "LightContents",
    "ReportContents",
    "SpectrumContents",
    "TextureContents",
    "write_report",
]
