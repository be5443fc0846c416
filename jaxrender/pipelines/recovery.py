"""What every task hands back to a run: a result as data, files, pictures, a report's contents."""

import abc
from pathlib import Path
from typing import Any

import numpy as np

from jaxrender.inverse.photographs import Photograph
from jaxrender.shapes import Float


class Recovery(abc.ABC):
    """A finished recovery with all that its result folder is made from."""

    photographs: list[Photograph]

    @abc.abstractmethod
    def result(self) -> dict[str, Any]:
        """Build the summary of ``result.json``."""

    @abc.abstractmethod
    def predict(self) -> list[Float[np.ndarray, "row column channel"]]:
        """Render every photograph again."""

    @abc.abstractmethod
    def write(self, folder: Path) -> None:
        """Write the arrays, and the light as images."""

    @abc.abstractmethod
    def contents(self, title: str, result: dict[str, Any], frames: tuple) -> Any:
        """Gather what the report shows."""
