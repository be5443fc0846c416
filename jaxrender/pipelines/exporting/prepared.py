"""An export that may begin, and one that is done."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from jaxrender.io.exports import Part

LACKED = "the model of the material, which the format lacks"


class Written(NamedTuple):
    """The files of an export, and remarks on their accuracy."""

    parts: tuple[Part, ...]
    remarks: tuple[str, ...] = ()


class Prepared(NamedTuple):
    """An export that may begin: what would be lost, and what writes it."""

    losses: tuple[str, ...]
    write: Callable[[Path], Written]
