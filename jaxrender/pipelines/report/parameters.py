"""The table of parameters, the fits of other models, and the evidence for sigma."""

import math
from typing import Any, NamedTuple

import numpy as np

from jaxrender.catalogue import MODELS, Model
from jaxrender.inverse.conditioning import GRAZING_COSINE
from jaxrender.pipelines.report.contents import Contents, MaterialContents, is_lambertian
from jaxrender.pipelines.report.display import hex_colour
from jaxrender.pipelines.report.wording import MISSING, counted, is_number, numbers, percent, shown
from jaxrender.shapes import Float

_RGB = ("red", "green", "blue")
# What the kinds of a bank's lobes are called, and those whose weight is a BRDF in 1/sr.
_KINDS = {
    "lambertian": "Lambertian base",
    "burley": "Burley's diffuse curve",
    "ggx": "GGX facets",
    "beckmann": "Beckmann facets",
    "retro": "towards the light",
}
_DIFFUSE = ("lambertian", "burley")
# Amplitudes that stand for the colour of a base, and what makes an albedo of them.
_ALBEDOS = {"kd": np.pi, "base_color": 1.0}


class Line(NamedTuple):
    """One number of a parameter, ready to show."""

    channel: str
    value: str
    interval: str
    error: str
    frequency: str
    bias: str
    albedo: str


class Parameter(NamedTuple):
    """One parameter: its lines, and whether it is identifiable."""

    letter: str
    index: str
    meaning: str
    lines: tuple[Line, ...]
    swatch: str | None
    verdict: str
    reasons: tuple[str, ...]
    sensitive: str


class LobeRow(NamedTuple):
    """One lobe of many: its shape, its weight in each channel, and its albedo head-on.

    ``bar`` is the albedo in per cent of the largest.
    """

    name: str
    width: str
    index: str
    weights: tuple[str, ...]
    share: str
    bar: float


class VariantRow(NamedTuple):
    """One other model that was fitted: its choices, its values, and what the data say of it."""

    fresnel: str
    masking: str
    chi_squared: str
    values: tuple[str, ...]
    verdict: str


class Variants(NamedTuple):
    """The other models, and the parameters of their columns."""

    names: tuple[str, ...]
    rows: tuple[VariantRow, ...]


class EvidenceBar(NamedTuple):
    """One standard error of sigma: ``width`` in per cent of the largest, None if there is none."""

    name: str
    error: str
    width: float | None


class Evidence(NamedTuple):
    """The evidence for sigma, or for the number that sets the width."""

    sentence: str
    bars: tuple[EvidenceBar, ...]
    letter: str = "σ"


def model_of(contents: Contents) -> Model:
    """Find the model that was fitted; the thesis's where the result does not say."""
    lambertian = contents.fit is not None and is_lambertian(contents)
    named = contents.result.get("brdf", {}).get("model")
    return MODELS[named or ("lambertian" if lambertian else "microfacet")]


def parameters(contents: Contents) -> tuple[Parameter, ...]:
    """List the numbers of the material in the order of its model; none without one."""
    given = contents.result.get("brdf", {})
    if given.get("model", "lambertian") not in MODELS:
        # Coefficients belong to no model.
        return ()
    own = model_of(contents)
    names = [number.name for number in own.numbers if number.name in given]
    if not names and contents.fit is not None:
        names = own.names("amplitude", "searched")
    return tuple(_parameter(contents, name) for name in names)


def lobes(contents: Contents) -> tuple[LobeRow, ...]:
    """List the lobes of a material that is a sum of many, in the order of their widths."""
    every = contents.result.get("brdf", {}).get("lobes", ())
    weights = [np.array(lobe["weight"], float) for lobe in every]
    albedos = [
        float(np.mean(weight)) * (np.pi if lobe["kind"] in _DIFFUSE else 1)
        for lobe, weight in zip(every, weights)
    ]
    return tuple(
        LobeRow(
            _KINDS[lobe["kind"]],
            shown(lobe["width"]) if "width" in lobe else MISSING,
            shown(lobe["mu"]) if "mu" in lobe else MISSING,
            tuple(shown(value, 2) for value in weight),
            percent(albedo),
            100 * albedo / max(albedos),
        )
        for lobe, weight, albedo in zip(every, weights, albedos)
        if albedo > 0
    )


def _parameter(contents: Contents, name: str) -> Parameter:
    result = contents.result
    number = model_of(contents).number(name)
    meaning = number.meaning
    lines = _lines(contents, name)
    verdict = {True: "yes", False: "no", None: "fixed"}[_flag(result, "identifiable", name)]
    if not lines:
        meaning, verdict = "none: a metal reflects the same at all angles", MISSING
    reasons = [reason for reason in result.get("reasons", ()) if _is_about(str(reason), name)]
    sensitive = {True: "yes", False: "no", None: MISSING}[_flag(result, "model_sensitive", name)]
    albedo = _ALBEDOS.get(name, 0) * np.array(_values(contents, "value", name))
    coloured = name in _ALBEDOS and albedo.size and _is_absolute(result)
    swatch = hex_colour(albedo) if coloured else None
    return Parameter(
        number.letter, number.index, meaning, lines, swatch, verdict, tuple(reasons), sensitive
    )


def _lines(contents: Contents, name: str) -> tuple[Line, ...]:
    values = _values(contents, "value", name)
    intervals = _intervals(contents, name)
    errors = _values(contents, "error", name)
    frequency = contents.result.get("frequency", {})
    before = numbers(frequency.get("brdf", {}).get(name))
    bias = numbers(frequency.get("bias", {}).get(name))
    has_albedo = name in _ALBEDOS and _is_absolute(contents.result)
    return tuple(
        Line(
            _channel(k, len(values)),
            shown(value),
            _span(_at(intervals[:, 0], k), _at(intervals[:, 1], k)),
            shown(_at(errors, k), 2),
            shown(_at(before, k)),
            percent(_at(bias, k), sign=True),
            shown(_ALBEDOS[name] * value, 3) if has_albedo else "",
        )
        for k, value in enumerate(values)
    )


def _span(low: float | None, high: float | None) -> str:
    if is_number(low) and not is_number(high):
        return f"at least {shown(low)}"
    return f"{shown(low)} to {shown(high)}"


def _values(contents: Contents, what: str, name: str) -> list[float]:
    """Look a parameter up in the result, or in the fit where the result does not have it."""
    result, fitted = contents.result, contents.fit and contents.fit.parameters
    key = {"value": "brdf", "interval": "interval90", "error": "standard_error"}[what]
    if name in result.get(key, {}):
        return numbers(result[key][name])
    if fitted is None or name not in ("kd", "ks", *fitted.value.numbers):
        return []
    parts = {"value": [fitted.value], "error": [fitted.standard_error]}
    pair = parts.get(what, [fitted.lower, fitted.upper])
    found = np.stack([np.asarray(part.of(name), float) for part in pair], -1)
    return found.ravel().tolist()


def _intervals(contents: Contents, name: str) -> Float[np.ndarray, "line 2"]:
    """List the intervals; an end that is nowhere (null in the result) is no number."""
    stated = contents.result.get("interval90", {}).get(name)
    if stated is None:
        return np.array(_values(contents, "interval", name)).reshape(-1, 2)
    # None becomes NaN.
    return np.array(stated, float).reshape(-1, 2)


def _is_absolute(result: dict[str, Any]) -> bool:
    """Whether reflectances have a scale of their own, not that of a gauge."""
    return result.get("task") != "factorize"


def _flag(result: dict[str, Any], key: str, name: str) -> bool | None:
    flag = result.get(key, {}).get(name)
    return None if flag is None else bool(flag)


def _at(values, k: int) -> float | None:
    """Pick a channel's number, or the one that all channels share."""
    if not len(values):
        return None
    return float(values[k] if k < len(values) else values[0])


def _channel(k: int, count: int) -> str:
    if count == 1:
        return ""
    return _RGB[k] if count == len(_RGB) else f"channel {k + 1}"


def _is_about(reason: str, name: str) -> bool:
    return reason.split(" ", 1)[0].rstrip(":") == name


def variants(contents: MaterialContents) -> Variants | None:
    """List the refits under other models; None where there are none."""
    found = contents.result.get("variants") or []
    if not found:
        return None
    own = model_of(contents).numbers
    names = tuple(n.name for n in own if any(numbers(v.get(n.name)) for v in found))
    rows = tuple(
        VariantRow(
            str(variant.get("fresnel", MISSING)),
            str(variant.get("masking", MISSING)),
            _chi_squared(variant.get("chi_squared")),
            tuple(
                ", ".join(shown(x, 3) for x in numbers(variant.get(name))) or MISSING
                for name in names
            ),
            _verdict_on(variant),
        )
        for variant in found
    )
    return Variants(tuple(n.letter + n.index for n in own if n.name in names), rows)


def _verdict_on(variant: dict[str, Any]) -> str:
    if variant.get("preferred"):
        return "better than the fit"
    return "rejected" if variant.get("rejected") else "not rejected"


def _chi_squared(difference: Any) -> str:
    """Write a difference of chi-squared: as a count where it is large."""
    large = is_number(difference) and abs(difference) >= 100
    return counted(round(difference)) if large else shown(difference, 3)


def evidence(contents: MaterialContents) -> Evidence | None:
    """Compare the standard errors of sigma; None where there is no sigma to speak of."""
    model, own = model_of(contents), contents.fit.evidence
    # The first number that is searched for is the lobe's width, or what stands for it.
    shape = next(iter(model.names("searched")), "")
    known = shape and _flag(contents.result, "identifiable", shape) is not None
    if is_lambertian(contents) or not known or own is None:
        return None
    letter = model.number(shape).letter
    given = contents.result.get("evidence") or {**own._asdict(), "sentence": own.sentence()}
    names = {
        "all": "all samples",
        "without_grazing": f"without grazing views (exit cosine below {GRAZING_COSINE:g})",
        "spectrum": "detail of the light alone (Gaussian transfer)",
    }
    errors = {name: given.get(key) for key, name in names.items()}
    largest = max([0.0, *(e for error in errors.values() for e in numbers(error))])
    bars = tuple(_bar(name, error, largest) for name, error in errors.items())
    return Evidence(str(given.get("sentence", "")).replace(" %", "\u00a0%"), bars, letter)


def _bar(name: str, error: Any, largest: float) -> EvidenceBar:
    if not is_number(error):
        return EvidenceBar(name, "no information", None)
    return EvidenceBar(name, percent(error), 100 * error / largest if largest > 0 else 0.0)


def in_degrees(contents: Contents) -> str | None:
    """Say the roughness as an angle."""
    if "sigma" not in contents.result.get("brdf", {"sigma": None}):
        return None
    values = [] if is_lambertian(contents) else _values(contents, "value", "sigma")
    return f"{shown(math.degrees(values[0]), 2)}°" if values else None
