"""What estimates of every kind have in common: they print themselves, and save themselves."""

import abc
import json
from pathlib import Path
from typing import Any

import numpy as np

from jaxrender.errors import InputError
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.own_words import plain
from jaxrender.io.atomic import replacing
from jaxrender.shapes import Float


class AnyEstimate(abc.ABC):
    """What a fit found, by name, and how well it is known.

    ``values`` are arrays by name; ``standard_error`` and ``interval90`` have the names whose errors
    are known.  The last axis of an interval is lowest and highest.  ``identifiable`` says of a free
    number whether the photographs tell it.  ``noise`` is that of the photographs, ``relative_rms``
    what is left unexplained beside them.
    """

    values: dict[str, Float[np.ndarray, "..."]]
    standard_error: dict[str, Float[np.ndarray, "..."]]
    interval90: dict[str, Float[np.ndarray, "..."]]
    identifiable: dict[str, bool]
    outcome: Outcome
    reasons: tuple[str, ...]
    noise: NoiseModel
    relative_rms: float

    @property
    @abc.abstractmethod
    def title(self) -> str:
        """Name what was fitted."""

    @abc.abstractmethod
    def _write(self, folder: Path) -> dict[str, Any]:
        """Write files of this kind of estimate; return what ``estimate.json`` says besides."""

    @property
    def _maps(self) -> tuple[str, ...]:
        """Name the values that are saved as files of their own and not in ``estimate.json``."""
        return ()

    def __str__(self) -> str:
        """Print a table of the numbers, and what is to be known about them."""
        rows = [f"{self.title}: {self.outcome.sentence}", *self._rows()]
        rows.append(f"  residual {100 * self.relative_rms:.3g} %")
        return "\n".join([*rows, *(f"  {reason}" for reason in self.reasons)])

    def _rows(self) -> list[str]:
        """List the rows of the table."""
        return [self._row(name) for name in self.values if name not in self._maps]

    def save(self, folder: str | Path) -> Path:
        """Write ``estimate.json`` and the files of this kind of estimate; return the folder.

        The JSON holds the numbers by their names, with errors and intervals, and how the fit ended.
        Files of an earlier estimate are replaced.  Raises ``InputError`` where the folder cannot
        be written to.
        """
        folder = Path(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            more = self._write(folder)
            with replacing(folder / "estimate.json") as aside:
                content = json.dumps(self._plain() | more, indent=1, allow_nan=False)
                aside.write_text(content + "\n", encoding="utf-8")
        except OSError as error:
            raise InputError(
                f"{folder}: cannot be written to: {error.strerror}; choose another folder"
            ) from None
        return folder

    def _row(self, name: str) -> str:
        note = "" if self.identifiable.get(name, True) else "  not identifiable"
        span = ""
        if name in self.interval90:
            low, high = (_shown(self.interval90[name][..., end]) for end in (0, 1))
            span = f"  90 %: {low} to {high}"
        return f"  {name:<12} {_shown(self.values[name])}{span}{note}"

    def _plain(self) -> dict[str, Any]:
        """Lay out the numbers and the account of them."""
        numbers = {
            key: {
                name: finite(plain(value))
                for name, value in getattr(self, key).items()
                if name not in self._maps
            }
            for key in ("values", "standard_error", "interval90")
        }
        return {
            "model": self.title,
            "outcome": self.outcome.value,
            "meaning": self.outcome.sentence,
            "reasons": list(self.reasons),
            **numbers,
            "identifiable": self.identifiable,
            "relative_rms": float(self.relative_rms),
            "noise": {"relative": float(self.noise.relative), "floor": float(self.noise.floor)},
        }


def finite(value: Any) -> Any:
    """Replace what JSON has no number for by None, in lists too."""
    if isinstance(value, list):
        return [finite(item) for item in value]
    return value if np.isfinite(value) else None


def _shown(values: float | Float[np.ndarray, "..."]) -> str:
    return " ".join(f"{value:.4g}" for value in np.ravel(values))
