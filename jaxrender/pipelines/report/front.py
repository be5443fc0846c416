"""The first page, for people who are no experts: five questions, each with one picture.

What was recovered, how sure that is, what could not be found, what is wrong with the capture, and
what to photograph next.  It says nothing that the experts' sections behind it do not also hold.
"""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from jaxrender.pipelines.report.contents import Contents, Pictures, Shown
from jaxrender.pipelines.report.directions import Gap, gap_among, views_plot
from jaxrender.pipelines.report.freed import faults_absorbed
from jaxrender.pipelines.report.parameters import model_of
from jaxrender.pipelines.report.photographs import Gallery
from jaxrender.pipelines.report.plots import INK, MUTED, SERIES, small_plot
from jaxrender.pipelines.report.wording import counted, is_number, numbers, percent, shown

# A number with a wider 90 % interval than this, to either side, is not known well.
_WELL_KNOWN = 0.05
# From this part of the object's pixels on, what a rule left out is worth a sentence.
_MANY = 0.02
# From this part of chi squared on, the photographs hold more than the model and noise.
_MISFIT = 0.05
# Models whose sigma is the slope of facets: a lobe is twice as wide as their normals are spread.
_OF_FACETS = ("microfacet", "ggx", "beckmann")
# What each kind of number needs, by the name of the number.
_NEEDS = {
    "kd": "photographs of the matt parts, away from the highlights",
    "base_color": "photographs of the matt parts, away from the highlights",
    "ks": "a small bright lamp, so that its highlight stands out from the matt part",
    "sigma": "a small bright lamp: the edge of its highlight shows how rough the surface is",
    "roughness": "a small bright lamp: the edge of its highlight shows how rough the surface is",
    "exponent": "a small bright lamp: the edge of its highlight shows how rough the surface is",
    "mu": "views that graze the surface, with the light behind the object",
    "metallic": "lights of several colours, or views that graze the surface",
}
_IN_GENERAL = "light from another direction, and views of parts that few photographs show"


class Card(NamedTuple):
    """One question: its answer in sentences, and its picture."""

    question: str
    sentences: tuple[str, ...]
    shown: Shown | None


class _Known(NamedTuple):
    """How well one number is known: half its 90 % interval, relative to its value."""

    name: str
    words: str
    reach: float


def front(contents: Contents, pictures: Pictures, photographs: Gallery) -> tuple[Card, ...]:
    """Answer the five questions."""
    views = np.asarray(contents.result.get("views") or np.zeros((0, 3)), float)
    gap = gap_among(views, np.asarray(contents.result.get("faces", np.zeros((0, 3))), float))
    return (
        Card("What was recovered", _recovered(contents), pictures.recovered),
        Card("How sure that is", _sure(contents), pictures.sure or _reaches(contents, photographs)),
        Card("What could not be found", _missing(contents), _missing_shown(contents, pictures)),
        Card("What is wrong with the capture", _wrong(contents), _worst(photographs)),
        Card("What to photograph next", _next(contents, gap), _views(views, gap)),
    )


def _recovered(contents: Contents) -> tuple[str, ...]:
    result = contents.result
    brdf, said = result.get("brdf", {}), []
    if "texture" in result:
        seen = counted(result["texture"].get("seen"))
        said.append(f"The colour of each place of the surface, at {seen} places.")
    if "spectrum" in result:
        said.append("How the surface reflects, from and to each direction. No model was assumed.")
    elif brdf:
        said += _material(brdf, _knows_scale(contents))
    lighting = result.get("lighting", {})
    if result.get("task") in ("factorize", "lighting"):
        lamps = len(lighting.get("directional", ()))
        each = "one lamp" if lamps == 1 else f"{counted(lamps)} lamps"
        said.append(f"The light: a smooth part, and {each if lamps else 'no lamps'}.")
    return tuple(said)


def _material(brdf: dict[str, Any], absolute: bool) -> list[str]:
    """Say what a material looks like."""
    said = []
    name = "kd" if "kd" in brdf else "base_color"
    albedo = np.array(numbers(brdf.get(name))) * (np.pi if name == "kd" else 1.0)
    if albedo.size and absolute:
        each = " (red, green, blue: {})".format(", ".join(percent(a) for a in albedo))
        rest = each if albedo.size == 3 else ""
        part = "The matt part" if "ks" in brdf else "The surface"
        said.append(f"{part} sends back {percent(float(albedo.mean()))} of the light{rest}.")
    if brdf.get("model", "microfacet") in _OF_FACETS and is_number(brdf.get("sigma")):
        spread = np.degrees(2 * brdf["sigma"])
        look = "like a mirror" if spread < 2 else "glossy" if spread < 20 else "satin"
        said.append(
            f"It is {look}: the surface blurs what it mirrors by about {shown(spread, 2)} degrees."
        )
    if not said:
        said.append("The numbers of the material, listed below.")
    return said


def _knows_scale(contents: Contents) -> bool:
    return contents.result.get("lighting", {}).get("gauge", "given") == "given"


def _known(contents: Contents) -> list[_Known]:
    """List the numbers that have an interval, the best known first."""
    brdf = contents.result.get("brdf", {})
    meanings: dict[str, str] = {}
    # Coefficients have no model, and no numbers with a name.
    if brdf and "spectrum" not in contents.result:
        meanings = {number.name: number.meaning for number in model_of(contents).numbers}
    found = []
    for name, interval in contents.result.get("interval90", {}).items():
        values, ends = numbers(brdf.get(name)), numbers(interval)
        pairs = np.reshape(ends, (-1, 2)) if len(ends) == 2 * len(values) else np.zeros((0, 2))
        if len(values) != len(pairs) or not values:
            continue
        reach = [
            (high - low) / 2 / abs(value)
            for value, (low, high) in zip(values, pairs.tolist())
            if value
        ]
        if reach:
            found.append(_Known(name, meanings.get(str(name), str(name)), max(reach)))
    return sorted(found, key=lambda one: one.reach)


def _sure(contents: Contents) -> tuple[str, ...]:
    known = _known(contents)
    said = []
    if known:
        said.append("Each number has a range that holds the truth in nine of ten such captures.")
        last = known[-1]
        said.append(f"The least certain is {_named(last)}: within {percent(last.reach)}.")
        if last.reach <= _WELL_KNOWN:
            said.append("All of these numbers are known well.")
    texture = contents.result.get("texture", {})
    error = texture.get(f"median_relative_error_{_colour(texture)}")
    if is_number(error):
        said.append(f"At the median place the colour is known within {percent(1.645 * error)}.")
    outcome = contents.result.get("outcome")
    if outcome == "not_converged":
        said.append("The search stopped before it was done: do not trust the numbers yet.")
    if outcome == "misfit":
        said.append("The photographs hold something that the model lacks: the ranges allow for it.")
    return tuple(said) or ("The sections below say how well the photographs are explained.",)


def _colour(texture: dict[str, Any]) -> str:
    """Name the colour of a texture's places."""
    return "base_color" if "base_color_marked" in texture else "kd"


def _named(known: _Known) -> str:
    words = known.words.partition(":")[0]
    return known.name if words == known.name else f"{known.name} ({words})"


def _missing(contents: Contents) -> tuple[str, ...]:
    result = contents.result
    said = [str(reason) for reason in result.get("reasons") or ()]
    unnamed = [
        name
        for name, found in result.get("identifiable", {}).items()
        if found is False and not any(name in reason for reason in said)
    ]
    said += [f"{name}: the photographs do not determine it" for name in unnamed]
    if result.get("ambiguity"):
        said.append(str(result["ambiguity"]))
    elif not _knows_scale(contents):
        said.append("how bright the light is: a dim light on a bright object looks the same")
    texture = result.get("texture", {})
    if texture.get("unseen"):
        said.append(f"{counted(texture['unseen'])} places that no photograph shows")
    marked = texture.get(f"{_colour(texture)}_marked")
    if marked:
        said.append(f"the colour of {counted(marked)} places is unreliable")
    lighting = str(result.get("lighting", {}).get("sentence", ""))
    if lighting and not lighting.startswith("all degrees"):
        said.append(lighting)
    return tuple(_sentence(one) for one in said) or ("Nothing that was asked for is missing.",)


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:] + ("" if text.endswith(".") else ".")


def _wrong(contents: Contents) -> tuple[str, ...]:
    result, said = contents.result, faults_absorbed(contents)
    causes = result.get("diagnosis", [])[:2]
    for one in causes:
        said.append(
            f"If {one['sentence']}, that explains {percent(one['explains'])} of what is left over."
        )
    misfit = result.get("residual", {}).get("misfit", {})
    if not causes and is_number(misfit.get("share")) and misfit["share"] > _MISFIT:
        said.append(
            f"The photographs differ from the model by {percent(misfit.get('rms'))} more than "
            "their noise. No single cause explains it."
        )
    pixels = result.get("pixels", {})
    removed, usable = pixels.get("removed", {}), pixels.get("usable", 0)
    whole = usable + sum(removed.values())
    for rule, why in {
        "saturated": "too bright for the camera",
        "black": "black",
        "invalid": "broken",
    }.items():
        if whole and removed.get(rule, 0) / whole > _MANY:
            said.append(f"{percent(removed[rule] / whole)} of the object's pixels are {why}.")
    if said:
        return tuple(said)
    noise = percent(result.get("noise", {}).get("relative"))
    if not misfit:
        # Not every task compares what is left over with the noise.
        left = percent(result.get("residual", {}).get("relative_rms"))
        return (
            f"Nobody looked for faults here. What is left over is {left}, and the noise {noise}.",
            "A pattern in the picture is a fault; even grain is none.",
        )
    return (f"Nothing that the photographs show. What is left over is noise of {noise}.",)


def _next(contents: Contents, gap: Gap | None) -> tuple[str, ...]:
    result, said = contents.result, []
    diagnosis = [one for one in result.get("diagnosis", []) if one.get("free")]
    if diagnosis:
        said.append(
            f"First mend the capture, or let the fit allow for it: set {diagnosis[0]['free']}."
        )
    if result.get("pixels", {}).get("removed", {}).get("saturated", 0):
        said.append("Add photographs with a shorter exposure, for the highlights.")
    known = _known(contents)
    identifiable = result.get("identifiable", {})
    poor = [one for one in known if identifiable.get(one.name) is False] or known[-1:]
    for one in poor[:1]:
        said.append(f"For {_named(one)}: {_NEEDS.get(one.name, _IN_GENERAL)}.")
    if gap is not None:
        said.append(
            f"No camera stood within {gap.radius:.0f} degrees of azimuth {gap.azimuth:.0f}, "
            f"elevation {gap.elevation:.0f} degrees: a view from there may show the most."
        )
    said.append("To rank new views by what they add: jaxrender analyze config.yaml --suggest views")
    return tuple(said)


def _reaches(contents: Contents, photographs: Gallery) -> Shown | None:
    """Draw how far each number may be off, or how far each photograph is."""
    known = _known(contents)
    if not known:
        return _misses(photographs)

    def paint(axes: Axes) -> None:
        reach = [100 * one.reach for one in known]
        axes.barh([one.name for one in known], reach, color=SERIES[0], height=0.55)
        axes.axvline(100 * _WELL_KNOWN, color=MUTED, linewidth=0.9, linestyle=(0, (1.5, 2)))
        axes.set_xlim(0, 1.15 * max(*reach, 100 * _WELL_KNOWN))
        axes.set_xlabel("may be off by, to either side [%]")
        axes.grid(visible=False, axis="y")

    told = ", ".join(f"{one.name} {percent(one.reach)}" for one in known)
    drawn = small_plot("front-sure", f"How far each number may be off: {told}", paint)
    return Shown(drawn, "Half of each 90 % range. Left of the dotted line a number is known well.")


def _misses(photographs: Gallery) -> Shown | None:
    rows = [(frame.name, frame.rms) for frame in photographs.frames if frame.rms is not None]
    if not rows:
        return None

    def paint(axes: Axes) -> None:
        names, off = zip(*((name, 100 * rms) for name, rms in rows))
        axes.barh(names, off, color=SERIES[0], height=0.55)
        axes.set_xlabel("prediction is off by [%]")
        axes.grid(visible=False, axis="y")

    told = ", ".join(f"{name} {percent(rms)}" for name, rms in rows)
    drawn = small_plot("front-sure", f"How far each prediction is off: {told}", paint)
    return Shown(drawn, "How far the prediction is off in the photographs that are shown below.")


def _missing_shown(contents: Contents, pictures: Pictures) -> Shown | None:
    """Draw which numbers are known only together."""
    given = contents.result.get("correlations")
    if pictures.missing is not None or given is None or len(given["numbers"]) < 2:
        return pictures.missing
    names = [str(number) for number in given["numbers"]]
    strength = np.abs(np.array(given["matrix"], float))

    def paint(axes: Axes) -> None:
        axes.grid(visible=False)
        places = np.arange(len(names))
        across, down = np.meshgrid(places, places)
        below = across < down
        axes.scatter(
            across[below], down[below], s=160 * strength[below], color=SERIES[1], linewidths=0
        )
        axes.set_xticks(places, names, rotation=45, ha="right")
        axes.set_yticks(places, names)
        axes.set_xlim(-0.7, len(names) - 0.3)
        axes.set_ylim(len(names) - 0.3, 0.3)
        axes.tick_params(colors=INK)

    drawn = small_plot(
        "front-missing", "How much each pair of numbers is known only together", paint
    )
    return Shown(
        drawn,
        "A large dot: the photographs tell this pair well together, and each alone less well.",
    )


def _worst(photographs: Gallery) -> Shown | None:
    """Show the residual of the photograph that is explained worst."""
    worst = photographs.worst
    if worst is None:
        return None
    return Shown(
        worst.residual,
        f"Photograph {worst.name} less its prediction. Even grain is noise; a pattern is a fault. "
        f"Full colour is {photographs.limit:g} % of the mean.",
    )


def _views(views: np.ndarray, gap: Gap | None) -> Shown | None:
    if gap is None:
        return None
    caption = "Where the cameras stood, seen from the object. The ring is the largest gap."
    return Shown(views_plot(views, gap), caption)
