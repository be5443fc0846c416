"""A result as a table for the terminal."""

from typing import Any

from jaxrender.catalogue import MODELS

_SOURCES_SHOWN = 3


def _gauge(result: dict[str, Any]) -> str:
    """Say what tells the scale of the light from that of the material."""
    amplitudes = MODELS[result["brdf"]["model"]].names("amplitude")
    fixed = [name for name in amplitudes if name not in result["identifiable"]]
    return f"{fixed[0]} tells it, which is fixed" if fixed else "it makes the mean of kd + ks 1"


def summary_of(result: dict[str, Any]) -> str:
    """Lay out the summary as a table for the terminal."""
    sensitive = result.get("model_sensitive", {})
    lines = [f"outcome: {result['outcome']} ({result['meaning']})"]
    lines += [f"  {reason}" for reason in result["reasons"]]
    width = max([8, *map(len, result["interval90"])])
    lines.append(f"{'':{width}}{'value':>30}   {'90 % interval':<36}")
    for name, interval in result["interval90"].items():
        value = _shown(result["brdf"][name])
        pairs = interval if isinstance(interval[0], list) else [interval]
        span = "  ".join(map(_span, pairs))
        known = result["identifiable"].get(name)
        remark = "" if known is None else ("" if known else "not identifiable")
        remark = "fixed" if known is None else remark
        remark += " model sensitive" if sensitive.get(name) else ""
        lines.append(f"{name:{width}}{value:>30}   {span:<36} {remark}".rstrip())
    if "spectrum" in result:
        lines += _summary_of_spectrum(result["spectrum"])
    if "texture" in result:
        lines += _summary_of_texture(result)
    if result["task"] in ("factorize", "lighting"):
        lines += _summary_of_light(result["lighting"])
    residual = result["residual"]
    lines.append(
        f"residual {100 * residual['relative_rms']:.2f} % rms of {residual['samples']} samples"
        f", noise {100 * result['noise']['relative']:.2f} % + {result['noise']['floor']:.3g}"
    )
    if "calibration" in result:
        lines.append(f"freed: {', '.join(result['calibration']['free'])}")
    if "scale" in result:
        lines.append(f"scale of the light {result['scale']:.4g}; {_gauge(result)}")
    if "frequency" in result:
        bias = result["frequency"]["bias"]
        moved = ", ".join(f"{name} {_percent(value)}" for name, value in bias.items())
        lines.append(f"bias of the frequency fit: {moved}")
    if "evidence" in result:
        lines.append(result["evidence"]["sentence"])
    if "table" in result:
        lines.append(result["table"]["sentence"])
    if "interreflection" in result:
        lines.append(result["interreflection"]["sentence"])
    seconds = result.get("seconds", {})
    spent = ", ".join(f"{name} {value:.2f}" for name, value in seconds.items())
    lines.append(f"seconds: {spent}")
    return "\n".join(lines)


def _summary_of_light(light: dict[str, Any]) -> list[str]:
    """Describe the recovered light."""
    sources = light["directional"]
    noun = "source" if len(sources) == 1 else "sources"
    lines = [f"light: degrees to {light['band_limit']}, and {len(sources)} {noun}"]
    lines += [
        f"  from {_shown(one['direction'])}, irradiance {_shown(one['irradiance'])}"
        for one in sources[:_SOURCES_SHOWN]
    ]
    if len(sources) > _SOURCES_SHOWN:
        lines.append(f"  and {len(sources) - _SOURCES_SHOWN} weaker ones")
    lines += [
        f"  {len(one['members'])} of them are a cluster, {one['width_degrees']:.2g} degrees wide: "
        f"from {_shown(one['direction'])}, irradiance {_shown(one['irradiance'])} in all; "
        "each of them is hardly known"
        for one in light.get("clusters", [])
    ]
    if "sentence" in light:
        lines.append(light["sentence"])
    return [*lines, f"gauge: {light['gauge']}"]


def _summary_of_spectrum(spectrum: dict[str, Any]) -> list[str]:
    """Give the number of coefficients, and the error of the lobe at each order."""
    lines = [
        f"{spectrum['unknowns']} coefficients to order {spectrum['order']}, of which the "
        f"photographs determine {spectrum['determined']:.0f}"
    ]
    lines += [
        f"  order {one['order']}: {100 * one['relative_rms']:.2f} % unexplained, standard error "
        f"of the lobe {100 * one['lobe_relative_error']:.2g} %"
        for one in spectrum["orders"]
    ]
    return lines


def _summary_of_texture(result: dict[str, Any]) -> list[str]:
    """Give the number of sites that were seen and marked, the median error, and what is a map."""
    texture = result["texture"]
    if "base_color_marked" in texture:
        return _summary_of_metallic(texture)
    lines = [
        f"{texture['sentence']}: {texture['seen']} seen, {texture['unseen']} not; marked: kd "
        f"{texture['kd_marked']}, ks {texture['ks_marked']}",
        f"median error of kd: {100 * texture['median_relative_error_kd']:.2g} %",
    ]
    if "ks_colour_marked" in texture:
        lines.append(f"ks of each channel; its colour is marked: {texture['ks_colour_marked']}")
    if "sigma_range" in texture:
        low, high = texture["sigma_range"]
        marked = f", marked: {texture['sigma_marked']}" if "sigma_marked" in texture else ""
        lines.append(f"sigma of most sites: {low:.3g} to {high:.3g}{marked}")
    if "tilt_degrees" in texture:
        lines.append(
            f"normals: tilted by {texture['tilt_degrees']:.2g} degrees (median), standard error "
            f"{texture['normal_error_degrees']:.2g}, marked: {texture['normal_marked']}"
        )
    if "ambiguity" in result:
        lines.append(f"not identifiable: {result['ambiguity']}")
    return lines


def _summary_of_metallic(texture: dict[str, Any]) -> list[str]:
    """Do the same of glTF's material."""
    lines = [
        f"{texture['sentence']}: {texture['seen']} seen, {texture['unseen']} not; marked: "
        f"base_color {texture['base_color_marked']}",
        f"median error of base_color: {100 * texture['median_relative_error_base_color']:.2g} %",
    ]
    for name in ("roughness", "metallic"):
        if f"{name}_range" in texture:
            low, high = texture[f"{name}_range"]
            lines.append(
                f"{name} of most sites: {low:.3g} to {high:.3g}, standard error "
                f"{texture[f'{name}_error']:.2g}, marked: {texture[f'{name}_marked']}"
            )
    if "metals" in texture:
        lines.append(f"metal: {100 * texture['metals']:.3g} % of the sites that are not marked")
    return lines


def _span(pair: list) -> str:
    low, high = pair
    # An interval without an end has none in JSON.
    endless = high is None and low is not None
    return f"at least {_shown(low)}" if endless else f"{_shown(low)}-{_shown(high)}"


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return " ".join(_shown(item) for item in value)
    if value is None:
        return "n/a"
    return value if isinstance(value, str) else f"{value:.4g}"


def _percent(value: Any) -> str:
    if isinstance(value, list):
        return "/".join(_percent(item) for item in value)
    return "n/a" if value is None else f"{100 * value:+.2f} %"
