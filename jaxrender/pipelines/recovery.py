"""The input of every task (``Evidence``), and its result (``Recovery``)."""

import abc
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrender.geometry import Shape
from jaxrender.inverse import KnownLight, Observations
from jaxrender.inverse.photographs import Photograph
from jaxrender.io.netcdf import Group
from jaxrender.pipelines.result import Result
from jaxrender.shapes import Float


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
    """A finished recovery with all that its result folder is made from."""

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
        """Write the light as images, and whatever else is one."""

    @abc.abstractmethod
    def contents(self, title: str, result: dict[str, Any], frames: tuple) -> Any:
        """Gather what the report shows."""
