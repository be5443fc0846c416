"""A fit's result as files: ``result.json`` for the summary, ``result.nc`` for the arrays.

Every task states the same facts (``Result``), and adds keys and arrays of its own.  ``result.json``
holds values, 90 % intervals, what is identifiable and what depends on the model, residuals, the
light, a forecast, and the seconds.  ``result.nc`` holds samples, how many ``pixels`` each stands
for, and coefficients; its dimensions have names, and its arrays have units and a meaning.

Beside them a result folder holds the light and its slow part, the predicted and residual
photographs (all EXR), the resolved ``config.yaml``, and ``report.html``, which works offline.
"""

import hashlib
import json
import math
import platform
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrender import __version__
from jaxrender.errors import InputError
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Outcome
from jaxrender.inverse.diagnosis import Diagnosis
from jaxrender.inverse.misfit import Misfit
from jaxrender.inverse.photographs import Photograph
from jaxrender.io.jsonfiles import read_json
from jaxrender.io.netcdf import Format
from jaxrender.pipelines.config import RunConfig, load_run_config

RESULT, ARRAYS = "result.json", "result.nc"
ARRAYS_FORMAT = Format("jaxrender result", 1, "jaxrender fit --force")
_LIBRARIES = ("jax", "equinox", "optimistix", "lineax", "numpy", "scipy", "OpenImageIO", "embreex")


class Result(NamedTuple):
    """What every task says of what it found; ``own`` are the keys that one task adds.

    ``brdf`` holds the model's name and its parameters; intervals, errors and whether they are
    identifiable go by the parameters' names.  The residual is of ``samples``, relative to their
    radiance; ``misfit`` the part of it that is no noise, where that is known.  ``correlations`` are
    those of the ``numbers`` that were free, as a ``matrix``.
    """

    task: str
    outcome: Outcome
    reasons: Sequence[str]
    brdf: dict[str, Any]
    interval90: dict[str, Any]
    standard_error: dict[str, Any]
    identifiable: dict[str, bool]
    relative_rms: float
    samples: int
    noise: NoiseModel
    lighting: dict[str, Any]
    photographs: list[Photograph]
    own: dict[str, Any]
    misfit: Misfit | None = None
    correlations: dict[str, Any] | None = None

    def document(self, provenance: dict[str, Any], seconds: dict[str, float]) -> dict[str, Any]:
        """Lay out what ``result.json`` holds; None for what JSON has no number for."""
        return _finite(
            {
                "task": self.task,
                "outcome": self.outcome.value,
                "meaning": self.outcome.sentence,
                "reasons": list(self.reasons),
                "brdf": self.brdf,
                "interval90": self.interval90,
                "standard_error": self.standard_error,
                **({} if self.correlations is None else {"correlations": self.correlations}),
                "identifiable": self.identifiable,
                "residual": {
                    "relative_rms": self.relative_rms,
                    "samples": self.samples,
                    **_misfit(self.misfit),
                },
                "noise": {
                    "relative": float(self.noise.relative),
                    "floor": float(self.noise.floor),
                    "rounding": _rounding_of(self.photographs),
                },
                "lighting": self.lighting,
                "pixels": _pixels_of(self.photographs),
                **self.own,
                "provenance": provenance,
                "seconds": seconds,
            }
        )


def causes_of(diagnosis: tuple[Diagnosis, ...], keys: Mapping[str, str]) -> list[dict[str, Any]]:
    """Lay out what would explain a misfit, each with the key that makes up for it, or None."""
    return [
        {
            "cause": one.cause,
            "sentence": one.sentence,
            "explains": one.explains,
            "bic": one.bic,
            "free": keys.get(one.cause),
        }
        for one in diagnosis
    ]


def _misfit(misfit: Misfit | None) -> dict[str, Any]:
    """Say how much of the residual is no noise; nothing where nobody knows."""
    if misfit is None:
        return {}
    found: dict[str, Any] = {"rms": misfit.rms, "share": misfit.share}
    if misfit.correlation is not None:
        found["correlation"] = misfit.correlation
    return {"misfit": found | {"noise": misfit.noise.relative}}


def provenance_of(inputs: list[Path], seed: int) -> dict[str, Any]:
    """Say what the result was made with and from."""
    return {
        "jaxrender": __version__,
        "python": platform.python_version(),
        "libraries": {name: metadata.version(name) for name in _LIBRARIES},
        "machine": platform.machine(),
        "seed": seed,
        "inputs": {path.name: _digest(path) for path in inputs},
    }


def write_json(path: Path, document: dict[str, Any]) -> None:
    """Write strict JSON."""
    path.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def read_result(folder: Path) -> dict[str, Any]:
    """Read the summary of a finished run; ``InputError`` where there is none or it is damaged."""
    path = folder / RESULT
    if not path.is_file():
        raise InputError(f"{folder}: holds no finished result (no {RESULT}); run fit first")
    try:
        found = read_json(path)
    except InputError as error:
        raise InputError(
            f"{error}; where that cannot be, make the result anew with fit --force"
        ) from None
    if not isinstance(found, dict):
        raise InputError(f"{path}: no object of results; make the result anew with fit --force")
    return found


class FinishedRun(NamedTuple):
    """A finished run: its folder, its config, and its summary as ``result.json`` holds it."""

    folder: Path
    config: RunConfig
    summary: dict[str, Any]


def read_run(folder: Path) -> FinishedRun:
    """Read a finished run; ``InputError`` where there is none or it is damaged."""
    summary = read_result(folder)
    return FinishedRun(folder, load_run_config(folder / "config.yaml"), summary)


def _pixels_of(photographs: list[Photograph]) -> dict[str, Any]:
    """Count the usable pixels, and those that each rule removed."""
    removed: dict[str, int] = {}
    for photograph in photographs:
        for rule, count in photograph.selection.removed.items():
            removed[rule] = removed.get(rule, 0) + int(count)
    usable = sum(int(np.count_nonzero(p.selection.usable)) for p in photographs)
    # From which stored value on each photograph was left out; None where nothing was.
    levels = [float(p.saturation.min()) for p in photographs]
    return {
        "photographs": len(photographs),
        "usable": usable,
        "removed": removed,
        "saturation": levels,
    }


def _rounding_of(photographs: list[Photograph]) -> float:
    """The standard deviation that the rounding of stored values adds to a usual pixel."""
    return float(np.median([p.rounding for p in photographs])) if photographs else 0.0


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _finite(value: Any) -> Any:
    """Replace what JSON has no number for by None."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return bool(value) if isinstance(value, np.bool_) else value
