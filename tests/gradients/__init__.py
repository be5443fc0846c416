"""The page of gradients: every public function by every array argument, at random and at the edges.

``page`` says what a row is and checks it; one list of rows stands here for each package.
``experiments/gradients.py`` prints what is found, the tests demand it.
"""

from . import brdf, harmonics, lighting, reflection, spectra
from .page import DOUBLE, SINGLE, Chapter, Found, Row, check, unlisted

CHAPTERS = {
    "harmonics": Chapter(harmonics.ROWS, harmonics.EXCEPTIONS),
    "spectra": Chapter(spectra.ROWS, spectra.EXCEPTIONS),
    "reflection": Chapter(reflection.ROWS, reflection.EXCEPTIONS),
    "brdf": Chapter(brdf.ROWS, brdf.EXCEPTIONS),
    "lighting": Chapter(lighting.ROWS, lighting.EXCEPTIONS),
}

__all__ = ["CHAPTERS", "DOUBLE", "SINGLE", "Chapter", "Found", "Row", "check", "unlisted"]
