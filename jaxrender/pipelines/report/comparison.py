"""The models that were compared on held-out pixels, as a table."""

from typing import Any, NamedTuple

from jaxrender.pipelines.report.contents import Contents
from jaxrender.pipelines.report.wording import counted, numbers, percent, shown

_NOT_OF_THE_MATERIAL = ("fresnel", "masking")


class ComparedModel(NamedTuple):
    """One model: its material in words, its error on the held-out pixels, and the verdict."""

    name: str
    material: str
    relative_rms: str
    chi_squared: str
    behind: str
    verdict: str


class ComparedModels(NamedTuple):
    """All models, the best first, and the number of held-out samples."""

    rows: tuple[ComparedModel, ...]
    held_out: str


def comparison(contents: Contents) -> ComparedModels | None:
    """Lay out the ranking; None where only one model was fitted."""
    found = contents.result.get("comparison")
    if not found:
        return None
    rows = tuple(_row(one, number == 0) for number, one in enumerate(found["ranking"]))
    return ComparedModels(rows, counted(found["held_out"]))


def _row(one: dict[str, Any], best: bool) -> ComparedModel:
    behind = f"{shown(one['behind'], 3)} ± {shown(one['behind_error'], 2)}"
    verdict = "explains them worse" if one["told_apart"] else "explains them as well"
    return ComparedModel(
        str(one["model"]),
        _material(one["brdf"]),
        percent(one["relative_rms"]),
        shown(one["chi_squared"], 4),
        "" if best else behind,
        "the result above" if best else verdict,
    )


def _material(brdf: dict[str, Any]) -> str:
    """Write a material in one line; spaces separate the channels."""
    parts = []
    for name, value in brdf.items():
        if name in _NOT_OF_THE_MATERIAL:
            continue
        text = value if isinstance(value, str) else " ".join(shown(x, 3) for x in numbers(value))
        parts.append(f"{name} {text}")
    return ", ".join(parts)
