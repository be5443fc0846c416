"""The report: one HTML page about one fit, readable without this program and without a network.

``contents``
    what a report is made of, and what a page is
``wording`` ``display`` ``plots``
    numbers as words, radiance as pictures, curves as SVG
``comparison`` ``forecast``
    models side by side on held-out pixels; error bars foreseen beside those achieved
``front`` ``directions``
    the first page, for people who are no experts; where cameras stood, and the largest gap
``account`` ``parameters``
    how the fit ended and what it was made from; the table of parameters and what sigma rests on
``photographs`` ``light`` ``material`` ``residuals`` ``spectra``
    one section's figures a file
``known_light`` ``recovered_light`` ``texture`` ``metallic`` ``brdf_spectrum``
    the pages of a material, a light, a texture, maps of glTF's material and a BRDF's coefficients
``page``
    a page's template and the style ``report.css`` filled with all of it
"""

from jaxrender.pipelines.report.contents import FramePictures, Page
from jaxrender.pipelines.report.page import write_report

__all__ = ["FramePictures", "Page", "write_report"]
