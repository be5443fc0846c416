"""In which conventions a capture is given: read off its photographs, before anything is fitted.

``outlines`` finds the object in a photograph without a mask, ``silhouettes`` holds what is seen of
the object, and says how much of it a shape overlaps.  ``framings`` lists the ways in which cameras
and a mesh may be meant, and ``framing_search`` finds the one whose silhouettes overlap.
``orientations`` lists the ways in which a panorama may be meant, and ``orientation_search`` finds
the one whose light leaves least of the photographs unexplained, by ``quick_fit``.
"""

from jaxrender.inverse.conventions.framing_search import FoundFraming, find_framing
from jaxrender.inverse.conventions.framings import Framing
from jaxrender.inverse.conventions.orientation_search import (
    FoundOrientation,
    Known,
    find_orientation,
)
from jaxrender.inverse.conventions.orientations import Orientation
from jaxrender.inverse.conventions.silhouettes import Silhouettes

__all__ = [
    "FoundFraming",
    "FoundOrientation",
    "Framing",
    "Known",
    "Orientation",
    "Silhouettes",
    "find_framing",
    "find_orientation",
]
