"""The contents of a report: a result as data, the fit itself, the light, and pictures."""

from typing import Any, NamedTuple

import numpy as np

from jaxrender.inverse import BRDFFit, Factorization, KnownLight
from jaxrender.inverse.brdf_spectrum import BRDFSpectrum
from jaxrender.pipelines.light.images import LightImages
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

    @property
    def is_diffuse(self) -> bool:
        """Whether the material has one lobe alone, whatever that is."""
        return _is_diffuse(self.result)


Panorama = Float[np.ndarray, "row column channel"]


class LightContents(NamedTuple):
    """All that the report of a recovered light shows."""

    title: str
    result: dict[str, Any]
    fit: Factorization
    images: LightImages
    frames: tuple[FramePictures, ...]

    @property
    def is_lambertian(self) -> bool:
        """Whether the object is Lambertian."""
        return self.result["brdf"]["model"] == "lambertian"

    @property
    def is_diffuse(self) -> bool:
        """Whether the material has one lobe alone, whatever that is."""
        return _is_diffuse(self.result)


class TextureContents(NamedTuple):
    """All that the report of a recovered texture shows.

    ``maps`` are kd, ks, kd_error, ks_error (NaN where unknown) and marks, None where sites are
    vertices; ``light`` the coefficients of a light that was recovered as well.
    """

    title: str
    result: dict[str, Any]
    maps: dict[str, Panorama] | None
    light: Float[np.ndarray, "coefficient channel"] | None
    frames: tuple[FramePictures, ...]

    @property
    def fit(self) -> None:
        """None: the result has all there is."""

    @property
    def is_lambertian(self) -> bool:
        """Whether the model has no specular lobe."""
        return self.result["brdf"]["model"] == "lambertian"


class SpectrumContents(NamedTuple):
    """All that the report of a BRDF's coefficients shows: fits of several orders, the last asked.

    ``light_energy`` is that of each degree of the light.
    """

    title: str
    result: dict[str, Any]
    orders: tuple[BRDFSpectrum, ...]
    light_energy: Float[np.ndarray, "degree"]
    frames: tuple[FramePictures, ...]

    @property
    def fit(self) -> None:
        """None: the result has all there is."""

    @property
    def is_lambertian(self) -> bool:
        """Never: no model is supposed."""
        return False


Contents = ReportContents | LightContents | TextureContents | SpectrumContents


def _is_diffuse(result: dict[str, Any]) -> bool:
    brdf = result.get("brdf", {})
    return "kd" in brdf and "ks" not in brdf
