"""What a report is made of: a result as data, the fit itself, the light, and some pictures."""

from typing import Any, NamedTuple

import numpy as np

from jaxrender.inverse import BRDFFit, Factorization, KnownLight
from jaxrender.shapes import Bool, Float


class FramePictures(NamedTuple):
    """One photograph and its prediction, both in linear radiance.

    ``predicted`` is zero where the object is not seen; ``covered`` is where it is seen, ``usable``
    the part of it that the fit could draw its samples from.
    """

    name: str
    photograph: Float[np.ndarray, "row column channel"]
    predicted: Float[np.ndarray, "row column channel"]
    usable: Bool[np.ndarray, "row column"]
    covered: Bool[np.ndarray, "row column"]


class ReportContents(NamedTuple):
    """All that a report shows.  ``result`` is the content of result.json; any key may be absent."""

    title: str
    result: dict[str, Any]
    fit: BRDFFit
    light: KnownLight
    frames: tuple[FramePictures, ...]

    @property
    def is_lambertian(self) -> bool:
        """Whether the material was fitted without a specular lobe."""
        return self.result.get("brdf", {}).get("model") == "lambertian"


Panorama = Float[np.ndarray, "row column channel"]


class LightContents(NamedTuple):
    """All that the report of a recovered light shows.

    ``images`` are the whole light and its slow part.
    """

    title: str
    result: dict[str, Any]
    fit: Factorization
    images: tuple[Panorama, Panorama]
    frames: tuple[FramePictures, ...]

    @property
    def is_lambertian(self) -> bool:
        """Never: such a material has no gloss to see the light in."""
        return False


Contents = ReportContents | LightContents
