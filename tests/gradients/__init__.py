"""The page of gradients: every public function by every array argument, at random and at the edges.

``page`` says what a row is, ``checker`` checks it, and ``listing`` finds what is on no row; one
list of rows stands here for each package.
``experiments/gradients.py`` prints what is found, the tests demand it.
"""

from . import brdf, harmonics, lighting, reflection, spectra
from .checker import DOUBLE, SINGLE, Found, check
from .listing import unlisted
from .page import Chapter, Row

CHAPTERS = {
    "harmonics": Chapter(harmonics.ROWS, harmonics.EXCEPTIONS),
    "spectra": Chapter(spectra.ROWS, spectra.EXCEPTIONS),
    "reflection": Chapter(reflection.ROWS, reflection.EXCEPTIONS),
    "brdf": Chapter(brdf.ROWS, brdf.EXCEPTIONS),
    "lighting": Chapter(lighting.ROWS, lighting.EXCEPTIONS),
}

__all__ = ["CHAPTERS", "DOUBLE", "SINGLE", "Chapter", "Found", "Row", "check", "unlisted"]
