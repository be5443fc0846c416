"""The input of every task (``Evidence``), and its result (``Recovery``)."""

from __future__ import annotations

import abc
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jaxrender.geometry import Shape
from jaxrender.inverse import KnownLight, Observations
from jaxrender.inverse.photographs import Photograph
from jaxrender.io.netcdf import Group
from jaxrender.pipelines.result import Result
from jaxrender.shapes import Float

if TYPE_CHECKING:
    from jaxrender.pipelines.report import FramePictures, Page


class Evidence(NamedTuple):
    """What a recovery starts from: photographs of a known shape, and the light if it is known.

    ``pool`` are all usable pixels.  ``observations`` are those of them that the fit uses.
    """

    photographs: list[Photograph]
    shape: Shape
    light: KnownLight | None
    pool: Observations
    observations: Observations


class Recovery(abc.ABC):
    """A finished recovery: it can write everything that a result folder holds."""

    photographs: list[Photograph]

    @abc.abstractmethod
    def result(self) -> Result:
        """Sum up what was found."""

    @abc.abstractmethod
    def arrays(self) -> dict[str, Group]:
        """Lay out the groups of ``result.nc``."""

    @abc.abstractmethod
    def predict(self) -> list[Float[np.ndarray, "row column channel"]]:
        """Render every photograph again."""

    @abc.abstractmethod
    def write_images(self, folder: Path) -> None:
        """Write the light and all other images except the photographs."""

    @abc.abstractmethod
    def page(self, title: str, result: dict[str, Any], frames: tuple[FramePictures, ...]) -> Page:
        """Lay out the report."""
