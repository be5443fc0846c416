"""What a report is made of: pictures, what every page shows something of, and a page."""

from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from markupsafe import Markup

from jaxrender.inverse import BRDFFit, Factorization, KnownLight
from jaxrender.inverse.brdf_table import Correction
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


@runtime_checkable
class Contents(Protocol):
    """What every page shows.  ``result`` is the content of result.json; any key may be absent.

    ``fit`` is None where the result has all there is.
    """

    @property
    def title(self) -> str:
        """The name of the run."""
        ...

    @property
    def result(self) -> dict[str, Any]:
        """The content of result.json."""
        ...

    @property
    def fit(self) -> BRDFFit | Factorization | None:
        """The fit itself, for what the result does not have."""
        ...

    @property
    def frames(self) -> tuple[FramePictures, ...]:
        """The photographs that are shown."""
        ...


class Shown(NamedTuple):
    """A picture of the first page: a data URI or a drawing, and what it shows."""

    picture: str | Markup
    caption: str

    @property
    def is_drawing(self) -> bool:
        """Whether it is SVG."""
        return isinstance(self.picture, Markup)


class Pictures(NamedTuple):
    """What a page brings to the first one: what was recovered, is uncertain, is missing."""

    recovered: Shown | None = None
    sure: Shown | None = None
    missing: Shown | None = None


class MaterialContents(NamedTuple):
    """All that the report of a material under known light shows."""

    title: str
    result: dict[str, Any]
    fit: BRDFFit
    light: KnownLight
    frames: tuple[FramePictures, ...]
    correction: Correction | None = None


class Page(NamedTuple):
    """A page: its template, what it is made of, and what fills the sections that are its own.

    ``first`` are the pictures that it brings to the first page.
    """

    template: str
    contents: Contents
    sections: dict[str, Any]
    first: Pictures = Pictures()


def is_lambertian(contents: Contents) -> bool:
    """Whether the model has no specular lobe."""
    return contents.result.get("brdf", {}).get("model") == "lambertian"


def is_diffuse(contents: Contents) -> bool:
    """Whether the material has one lobe alone, whatever that is."""
    brdf = contents.result.get("brdf", {})
    return "kd" in brdf and "ks" not in brdf
