"""The account of a run: its outcome, the quality of the fit, the seconds, and the provenance."""

from typing import Any, NamedTuple

from jaxrender.inverse import Outcome
from jaxrender.pipelines.progress import MEANINGS
from jaxrender.pipelines.report.contents import Contents, MaterialContents
from jaxrender.pipelines.report.wording import counted, is_number, percent, seconds, shown

_HEADLINES = {
    "converged": ("Converged", "good"),
    "misfit": ("More than the model", "warn"),
    "not_converged": ("Not converged", "bad"),
    "at_bound": ("At a bound", "warn"),
    "not_identifiable": ("Not identifiable", "warn"),
}


class Ending(NamedTuple):
    """The outcome of the fit: headline, meaning and reasons; ``tone`` is good, warn or bad."""

    headline: str
    tone: str
    sentence: str
    reasons: tuple[str, ...]


class Figure(NamedTuple):
    """One number with its name and a remark."""

    name: str
    value: str
    remark: str


class Timing(NamedTuple):
    """One stage; ``width`` is its part of the longest in per cent."""

    name: str
    meaning: str
    seconds: str
    width: float


class Timings(NamedTuple):
    """All stages and their sum."""

    stages: tuple[Timing, ...]
    total: str


def ending(contents: Contents) -> Ending:
    """Say how the fit ended."""
    outcome, reasons = (contents.result.get(key) for key in ("outcome", "reasons"))
    if contents.fit is not None:
        outcome = outcome or contents.fit.outcome.value
        reasons = contents.fit.reasons if reasons is None else reasons
    outcome = str(outcome)
    headline, tone = _HEADLINES.get(outcome, (outcome, "warn"))
    known = {item.value: item.sentence for item in Outcome}
    return Ending(headline, tone, known.get(outcome, ""), tuple(str(r) for r in reasons or ()))


def figures(contents: Contents) -> tuple[Figure, ...]:
    """Gather the numbers that say how well the material explains the photographs."""
    result = contents.result
    residual, noise = result.get("residual", {}), result.get("noise", {})
    error, samples = residual.get("relative_rms"), residual.get("samples")
    relative, floor = noise.get("relative"), noise.get("floor")
    found = [
        Figure("Unexplained", percent(error), f"rms of {counted(samples)} samples"),
        Figure("Noise", percent(relative), f"of the radiance, and a floor of {shown(floor, 2)}"),
    ]
    if noise.get("rounding"):
        remark = "of radiance, by the rounding of stored values: the least floor"
        found.append(Figure("Rounding", shown(noise["rounding"], 2), remark))
    misfit = residual.get("misfit", {})
    if is_number(misfit.get("rms")):
        remark = f"of the radiance; {percent(misfit.get('share'))} of χ²"
        found.append(Figure("Above the noise", percent(misfit["rms"]), remark))
    before = result.get("frequency", {}).get("residual", {}).get("relative_rms")
    if is_number(before):
        found.append(Figure("Before refinement", percent(before), "rms, frequency fit"))
    pixels = result.get("pixels", {})
    if is_number(pixels.get("usable")):
        remark = f"in {counted(pixels.get('photographs'))} photographs"
        found.append(Figure("Usable pixels", counted(pixels["usable"]), remark))
    return tuple(found)


class Explanation(NamedTuple):
    """One cause of a misfit; ``width`` is its part of the misfit in per cent."""

    sentence: str
    cause: str
    explains: str
    width: float
    bic: str
    key: str


def explanations(contents: Contents) -> tuple[Explanation, ...]:
    """List what would explain the rest, the best first."""
    return tuple(
        Explanation(
            str(one["sentence"]),
            str(one["cause"]),
            percent(one["explains"]),
            100 * float(one["explains"]),
            counted(round(one["bic"])),
            str(one["free"] or ""),
        )
        for one in contents.result.get("diagnosis", [])
    )


def removed_pixels(contents: Contents) -> tuple[tuple[str, str], ...]:
    """List how many pixels each rule left out."""
    removed = contents.result.get("pixels", {}).get("removed", {})
    return tuple((str(rule), counted(count)) for rule, count in removed.items())


def timings(contents: Contents) -> Timings | None:
    """List the seconds of each stage; None where they were not measured."""
    spent = contents.result.get("seconds") or {}
    spent = {str(name): float(value) for name, value in spent.items() if is_number(value)}
    if not spent:
        return None
    longest = max(*spent.values(), 1e-9)
    stages = tuple(
        Timing(name, MEANINGS.get(name, ""), seconds(value), 100 * max(value, 0) / longest)
        for name, value in spent.items()
    )
    return Timings(stages, seconds(sum(spent.values())))


def provenance(contents: Contents) -> tuple[tuple[str, str], ...]:
    """Flatten the provenance to pairs of a dotted name and a value."""
    return tuple(_flat(contents.result.get("provenance", {}), ""))


def _flat(value: Any, name: str) -> list[tuple[str, str]]:
    if isinstance(value, dict):
        dotted = f"{name} · " if name else ""
        return [pair for key, item in value.items() for pair in _flat(item, f"{dotted}{key}")]
    if isinstance(value, list | tuple):
        return [(name, ", ".join(str(item) for item in value))]
    return [(name, str(value))]


def split_of(contents: MaterialContents) -> dict[str, Any] | None:
    """Gather the numbers of the split from the result or the fit; None without an environment."""
    result, prepared = contents.result, contents.fit.light
    given = result.get("split") or result.get("lighting", {}).get("split")
    if given or prepared.split is None:
        return given
    needed = prepared.needed
    return {
        "sources": int(prepared.split.sources.directions.shape[0]),
        "slow_energy": prepared.split.slow_energy,
        "sigma": prepared.split.sigma,
        "error": None if needed is None else needed.error,
        "error_without": None if needed is None else needed.error_without,
    }
