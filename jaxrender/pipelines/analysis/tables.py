"""Forecasts as text for a terminal."""

from functools import partial

import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.forecast import JointForecast, LightForecast, MaterialForecast
from jaxrender.inverse.intervals import Uncertain
from jaxrender.inverse.next_best import Suggestion
from jaxrender.inverse.posedness import RECOVERABLE
from jaxrender.pipelines.analysis.forecast import ConfigAnalysis, Options

_CHANNELS = ("red", "green", "blue")
_DEGREES_SHOWN = (*range(9), 10, 12, 14, 16, 18, 20)


def text_of(found: ConfigAnalysis, options: Options) -> str:
    """Write an analysis as text and tables."""
    parts = [_heading(found)]
    impossible = found.impossible
    brdf = found.supposition.supposed.brdf
    sections = (
        ("material", "Material, light known", partial(_material, brdf=brdf), found.material),
        ("light", "Light, material known", _light, found.light),
        ("joint", "Both unknown", partial(_joint, brdf=brdf), found.joint),
    )
    for key, title, write, forecast in sections:
        parts.append(_section(title, impossible.get(key), write, forecast))
    if options.suggest is not None:
        parts.append(_suggestions(found, options))
    return "\n\n".join(parts)


def _heading(found: ConfigAnalysis) -> str:
    situation, supposed = found.foreseen.situation, found.supposition.supposed
    brdf, light = supposed.brdf, situation.light
    lit = []
    for image in light.images:
        height, width = image.grid.shape
        lit.append(f"an environment of {height} x {width}")
    sources = len(light.directional.directions)
    if sources:
        lit.append(f"{sources} directional source{'s' if sources > 1 else ''}")
    if light.per_frame is not None:
        lit.append("sources of single photographs")
    guess = "" if found.prospect.light_given else " (supposed: the config gives none)"
    cosines = np.asarray(found.prospect.situation.samples.exit_cosines)
    diffuse = not np.any(np.asarray(brdf.lobe_amplitude))
    shown = zip(brdf.amplitude_names, np.asarray(brdf.amplitudes))
    material = [f"{n} {_values(value)}" for n, value in shown if n in brdf.bases or not diffuse]
    if not diffuse:
        material += [f"{name} {float(value):.3g}" for name, value in brdf.numbers.items()]
        if brdf.has_index() and brdf.mu is None:
            material.append(f"{brdf.index.name} none (metal)")
    lines = [
        f"{len(found.prospect.cameras)} photographs, not read; {len(cosines):,} samples, "
        f"of which {len(situation.frame):,} for the last step; exit cosines from "
        f"{cosines.min():.2f} to {cosines.max():.2f}",
        f"light: {' and '.join(lit)}{guess}",
        f"supposed: {', '.join(material)}; noise {_noise(supposed.noise)}",
        f"          ({found.supposition.source})",
    ]
    if not found.prospect.shape.is_convex():
        lines.append("the shape is not convex; the forecast leaves out its shadows on itself")
    return "\n".join(lines)


def _section(title: str, reason: str | None, write, forecast) -> str:
    if forecast is None:
        return f"{title}\n  {reason}"
    return "\n".join([title, *write(forecast), *(f"  - {s}" for s in forecast.sentences)])


def _material(forecast: MaterialForecast, brdf: Parametric) -> list[str]:
    lines = _parameters(forecast.parameters, forecast.identifiable, brdf)
    values = forecast.singular_values
    if not values.size:
        return lines
    named = [
        f"{name} {amount:+.2f}"
        for name, amount in zip(forecast.unknowns, forecast.weakest)
        if abs(amount) > 0.1
    ]
    return [
        *lines,
        f"  singular values (noise per relative change): {_listed(values)}",
        f"  least visible change: {', '.join(named)}",
    ]


def _joint(forecast: JointForecast, brdf: Parametric) -> list[str]:
    lines = _parameters(forecast.parameters, forecast.identifiable, brdf)
    return [
        *lines,
        f"  singular values without light and {forecast.sources} sources: "
        f"{_listed(forecast.singular_values)}",
        *(f"  not identifiable, {line}" for line in forecast.gauge),
    ]


def _parameters(
    parameters: Uncertain, identifiable: dict[str, bool], brdf: Parametric
) -> list[str]:
    # A channel's name may follow.
    width = max(11, *(len(name) + 6 * (name in brdf.amplitude_names) for name in identifiable), 0)
    lines = [
        f"  {'':{width}s} {'supposed':>9s} {'standard error':>15s} {'90 % interval':>20s}   "
        "identifiable"
    ]
    for name, known in identifiable.items():
        # Value, bounds and error; the covariance is for machines.
        rows = zip(*(np.ravel(np.asarray(part.of(name))) for part in parameters[:4]))
        shown = list(rows)
        same = name not in brdf.amplitude_names or (len({f"{r}" for r in shown}) == 1)
        for channel, (value, low, high, error) in enumerate(shown[:1] if same else shown):
            title = name if same else f"{name} {_CHANNELS[channel]}"
            span = f"{low:.4g} .. {high:.4g}"
            lines.append(
                f"  {title:{width}s} {value:9.4g} {error:15.2g} {span:>20s}   "
                f"{'yes' if known else 'no'}"
            )
    return lines


def _light(forecast: LightForecast) -> list[str]:
    limit = len(forecast.size) - 1
    lines = [
        f"  {'degree':>6s} {'light':>9s} {'its error':>10s} {'relative':>9s} "
        f"{'singular values':>19s}   recoverable"
    ]
    errors = forecast.relative_error
    for degree in sorted({*(d for d in _DEGREES_SHOWN if d <= limit), limit}):
        values = forecast.singular_values(degree)
        known = bool(errors[degree] < RECOVERABLE)
        lines.append(
            f"  {degree:6d} {forecast.size[degree]:9.3g} {forecast.report.noise[degree]:10.2g} "
            f"{_relative(errors[degree]):>9s} {f'{values.max():.3g} .. {values.min():.2g}':>19s}   "
            f"{'yes' if known else 'no'}"
        )
    return lines


def _suggestions(found: ConfigAnalysis, options: Options) -> str:
    views = options.suggest == "views"
    aim = "the worst parameter" if options.aim == "worst" else options.aim
    names = list(found.suggestions[0].errors)
    lines = [
        f"One more photograph, best first (to know {aim} better)",
        f"  {'':4s}{'camera towards' if views else 'source towards':24s} "
        + " ".join(f"{name:>8s}" for name in names),
    ]
    if found.material is not None:
        now = [found.present[name] for name in names]
        lines.append(f"  {'':4s}{'now':24s} " + " ".join(f"{_relative(e):>8s}" for e in now))
    for number, one in enumerate(found.suggestions):
        lines.append(
            f"  {number + 1:2d}. {_direction(one)} {_errors(one, names)}{_seen(found, one)}"
        )
    lines.append(
        "  (relative standard errors; directions as seen from the object"
        + (
            ", at the present distance)"
            if views
            else "; as bright as the present light on average)"
        )
    )
    return "\n".join(lines)


def _direction(one: Suggestion) -> str:
    x, y, z = one.direction
    return f"{f'({x:+.2f}, {y:+.2f}, {z:+.2f})':24s}"


def _errors(one: Suggestion, names: list[str]) -> str:
    return " ".join(f"{_relative(one.errors[name]):>8s}" for name in names)


def _seen(found: ConfigAnalysis, one: Suggestion) -> str:
    return "" if one.frame is None else f"  photographed as {found.prospect.names[one.frame]}"


def _relative(error: float) -> str:
    if not error < 10:
        return "nothing"
    return f"{100 * error:.0f} %" if error >= 1 else f"{100 * error:.2g} %"


def _values(values) -> str:
    texts = [f"{value:.3g}" for value in np.ravel(np.asarray(values))]
    return texts[0] if len(set(texts)) == 1 else " ".join(texts)


def _listed(values: np.ndarray) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


def _noise(noise: NoiseModel) -> str:
    floor = float(noise.floor)
    return f"{100 * float(noise.relative):.3g} %" + (
        f" and a floor of {floor:.3g}" if floor else ""
    )
