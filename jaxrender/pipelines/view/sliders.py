"""The sliders of a material: its amounts and its width, each with its value and its 90 % band."""

import math
from typing import Any, NamedTuple

import numpy as np

from jaxrender.brdf import BRDF, Parametric
from jaxrender.catalogue import MODELS
from jaxrender.pipelines.view.material_table import MaterialTable

_CHANNELS = ("red", "green", "blue")
# A slider of an amount goes so far above the largest value; of a black one it ends here.
_ABOVE, _OF_BLACK = 3.0, 0.3


class Slider(NamedTuple):
    """One slider: what it changes, where it starts and ends, and the band of what was found.

    ``part`` is ``base``, ``lobe`` or ``width``; the width is (value / scale)^(1 / power).
    """

    id: str
    label: str
    meaning: str
    part: str
    channels: tuple[int, ...]
    value: float
    lowest: float
    highest: float
    band: tuple[float, float] | None
    logarithmic: bool = False
    scale: float = 1.0
    power: float = 1.0
    fitted: bool = True


def sliders_of(brdf: BRDF, table: MaterialTable, summary: dict[str, Any]) -> tuple[Slider, ...]:
    """List the sliders of a material; bands are those of ``interval90``, where it has them."""
    bands = summary.get("interval90", {})
    meanings = _meanings(summary)
    found: list[Slider] = []
    for part, name, amount in (
        ("base", table.base_name, table.base),
        ("lobe", table.lobe_name, table.lobe),
    ):
        if name is not None:
            found += _amounts(part, name, amount, bands.get(name), meanings)
    if table.roughness_name is not None and isinstance(brdf, Parametric):
        found.append(_roughness(brdf, table, bands.get(table.roughness_name), meanings))
    return tuple(found)


def _amounts(
    part: str,
    name: str,
    amount: np.ndarray,
    band: Any,
    meanings: dict[str, str],
) -> list[Slider]:
    """Make a slider for each channel, or one where all channels are alike."""
    highest = 1.0 if name == "metallic" else _ABOVE * float(amount.max()) or _OF_BLACK
    meaning = meanings.get(name, "all lobes, times this" if name == "lobes" else "")
    grey = part == "lobe" and bool(np.ptp(amount) == 0)
    groups = [(0, 1, 2)] if grey else [(0,), (1,), (2,)]
    found = []
    for channels in groups:
        own = "" if grey else f", {_CHANNELS[channels[0]]}"
        identity = f"{part}-{channels[0]}"
        value = float(amount[channels[0]])
        found.append(
            Slider(
                identity,
                name + own,
                meaning,
                part,
                channels,
                value,
                0.0,
                highest,
                _band(band, None if grey else channels[0]),
            )
        )
    return found


def _roughness(
    brdf: Parametric, table: MaterialTable, band: Any, meanings: dict[str, str]
) -> Slider:
    name = brdf.shape.name
    ends = sorted(float(brdf.shape.of_width(table.widths[k])) for k in (0, -1))
    value = float(np.asarray(getattr(brdf, name)))
    return Slider(
        "width",
        name,
        meanings.get(name, ""),
        "width",
        (),
        value,
        ends[0],
        ends[1],
        _band(band, None),
        True,
        float(brdf.shape.scale),
        float(brdf.shape.power),
    )


def _band(band: Any, channel: int | None) -> tuple[float, float] | None:
    """Read an interval of one number, or that of a channel; None where it is not known."""
    rows = np.array(band, object)
    if channel is not None and rows.ndim == 2 and len(rows) > channel:
        rows = rows[channel]
    if rows.ndim == 2 and len(rows) >= 1:
        rows = rows[0]
    if rows.ndim != 1 or len(rows) != 2 or any(end is None for end in rows):
        return None
    low, high = (float(end) for end in rows)
    return (low, high) if math.isfinite(low) and math.isfinite(high) else None


def _meanings(summary: dict[str, Any]) -> dict[str, str]:
    """Say what each number of the model means."""
    model = MODELS.get(summary.get("brdf", {}).get("model", ""))
    if model is None:
        return {}
    return {one.name: one.meaning for one in model.numbers}
