"""The predicted error bars beside those achieved."""

from typing import Any, NamedTuple

from jaxrender.pipelines.report.contents import Contents
from jaxrender.pipelines.report.wording import numbers, shown

_RGB = ("red", "green", "blue")
# Achieved errors above this many times the forecast say that the model leaves more than noise.
_MUCH_LARGER = 1.5


class ForecastRow(NamedTuple):
    """One number of the material: the standard error forecast, the one achieved, their ratio."""

    name: str
    predicted: str
    achieved: str
    ratio: str


class Forecast(NamedTuple):
    """The rows, what shows least, and the forecast's sentences."""

    rows: tuple[ForecastRow, ...]
    weakest: str
    degree: int
    sentences: tuple[str, ...]
    verdict: str


def forecast(contents: Contents) -> Forecast | None:
    """Lay out the forecast; None where there is none."""
    found = contents.result.get("forecast")
    if not found:
        return None
    rows, ratios = [], []
    for name, predicted in found["standard_error"].items():
        achieved = numbers(contents.result.get("standard_error", {}).get(name))
        expected = numbers(predicted)
        for channel, (one, other) in enumerate(zip(expected, achieved)):
            if not (one > 0 and other > 0):
                continue
            ratios.append(other / one)
            label = f"{name} {_RGB[channel]}" if len(expected) == len(_RGB) else name
            rows.append(ForecastRow(label, shown(one, 2), shown(other, 2), shown(ratios[-1], 3)))
    return Forecast(
        tuple(rows),
        _weakest(found),
        int(found["recoverable_degree"]),
        tuple(str(sentence) for sentence in found["sentences"]),
        _verdict(ratios),
    )


def _weakest(found: dict[str, Any]) -> str:
    """Name the change of the material that shows least in the photographs."""
    pairs = zip(found["unknowns"], numbers(found["weakest"]))
    return ", ".join(f"{name} {amount:+.2f}" for name, amount in pairs if abs(amount) > 0.1)


def _verdict(ratios: list[float]) -> str:
    if not ratios:
        return ""
    if max(ratios) > _MUCH_LARGER:
        return (
            "The achieved errors are larger than noise alone explains: the model, the light or the "
            "geometry is not exact."
        )
    return "The fit is as accurate as the photographs allow."
