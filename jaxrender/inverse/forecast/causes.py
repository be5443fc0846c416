"""Why a parameter is not identifiable, found by trying the remedies.

A cause is what goes away with its remedy.  A source adds detail to the light, a ring of cameras
adds views.  Grazing samples add what a cut by exit cosine took away; more samples average the
noise.  Each is added to the Fisher information of the photographs, and those that help are named.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Glossy, Parametric
from jaxrender.geometry import SurfaceSamples, fibonacci_sphere
from jaxrender.inverse.elimination import Problem
from jaxrender.inverse.forecast.information import Reading, frame_grams, reading_of
from jaxrender.inverse.forecast.situation import Foreseen, Situation, foresee
from jaxrender.inverse.forecast.spectrum import highest_identifiable_degree, mean_irradiance
from jaxrender.inverse.intervals import IDENTIFIABLE_WITHIN, NORMAL_90
from jaxrender.inverse.known_light import KnownLight
from jaxrender.lighting import DirectionalSources
from jaxrender.shapes import Float

# Half a 90 % interval in standard errors: a relative error that is just identifiable.
_IDENTIFIABLE = IDENTIFIABLE_WITHIN / NORMAL_90
# A remedy helps when it leaves less than this part of the error.
_HELPS = 0.5
# A remedy has samples down to this exit cosine; above the second a capture has none that graze.
_GRAZING, _NONE_GRAZING = 0.15, 0.3
# The most times as many samples that are advised.
_MOST_SAMPLES = 30
# Samples of a remedy's photographs, and the cells of their light in units of sigma.
_SAMPLES, _CELL = 240, 0.5
_VIEWS = 6


class _Trial(NamedTuple):
    """What would help, and the relative errors that it leaves; None where it leaves just enough."""

    mend: str
    errors: dict[str, np.ndarray] | None = None


class Remedy(NamedTuple):
    """A possible cause of why the photographs fail, and its remedy.

    ``grams`` is the Fisher information of the photographs that the remedy adds.
    """

    cause: str
    mend: str
    grams: Float[np.ndarray, "frame channel column column"]


def causes_of(foreseen: Foreseen, problem: Problem, lost: list[str]) -> tuple[str, ...]:
    """Say of each parameter that is not identifiable why, and what would make it so."""
    if not lost:
        return ()
    reading, own = reading_of(problem, foreseen), frame_grams(foreseen)
    present = reading.errors(reading.information(own)).relative
    found = _remedies(foreseen)
    mended = [reading.errors(reading.information(np.concatenate([own, r.grams]))) for r in found]
    groups: dict[tuple[int, ...], list[str]] = {}
    sentences = []
    for name in lost:
        if name not in present:
            named = _named(name, foreseen.supposed.brdf)
            sentences.append(f"{named} is not identifiable: what shows of it is supposed to be 0")
            continue
        after = [float(errors.relative[name]) for errors in mended]
        enough = max(_IDENTIFIABLE, min(after))
        limit = min(enough, _HELPS * float(present[name]))
        helpful = [i for i in range(len(found)) if after[i] <= limit]
        groups.setdefault(tuple(helpful), []).append(name)
    for helpful, names in groups.items():
        named = {name: _named(name, foreseen.supposed.brdf) for name in names}
        sentences.append(_sentence(named, present, [found[i].cause for i in helpful]))
        tried = [_Trial(found[i].mend, mended[i].relative) for i in helpful]
        times = [_samples_needed(reading, own, name) for name in names]
        if None not in times:
            more = max(filter(None, times))
            count = len(foreseen.situation.frame)
            tried.append(_Trial(f"{more} times as many samples as these {count:,}"))
        if tried:
            sentences.append(_advice(names, tried))
    return tuple(sentences)


_NAMED = {"sigma": "roughness", "mu": "refractive index"}


def _named(name: str, brdf: Parametric) -> str:
    """Name a parameter in words for a glossy material, by its own name for any other."""
    return _NAMED.get(name, name) if isinstance(brdf, Glossy) else name


def _remedies(foreseen: Foreseen) -> list[Remedy]:
    samples, frame, light = foreseen.situation
    shared = light.of_frame(0)
    outgoing = np.stack([_mean(np.asarray(samples.outgoing)[frame == f]) for f in np.unique(frame)])
    lowest = float(np.min(np.asarray(samples.exit_cosines)))
    found = []

    def add(cause: str, mend: str, samples: SurfaceSamples, light: KnownLight) -> None:
        count = len(samples.normals)
        situation = Situation(samples, np.zeros(count, int), light)
        grams = frame_grams(foresee(situation, foreseen.supposed, angle_per_sigma=_CELL))
        # As many samples as a photograph has now, for each photograph.
        found.append(Remedy(cause, mend, grams * (len(frame) / count)))

    towards = outgoing.mean(axis=0) + np.array([0.3, 0.2, 0.4])
    source = DirectionalSources(_unit(towards)[None], mean_irradiance(shared)[None])
    with_source = KnownLight(
        shared.environment,
        DirectionalSources(
            np.concatenate([shared.directional.directions, source.directions]),
            np.concatenate([shared.directional.irradiance, source.irradiance]),
        ),
    )
    every = SurfaceSamples(
        *(a[:: max(1, len(frame) // _SAMPLES)] for a in map(np.asarray, samples))
    )
    degree = highest_identifiable_degree(foreseen)
    about = "no energy" if degree < 2 else "too little energy"
    above = f"this light has {about} above degree {degree} that would show above the noise"
    add(above, "a source", every, with_source)
    if lowest > _NONE_GRAZING:
        cut = f"every sample's exit cosine is above {lowest:.2f}, so that no grazing angle shows it"
        grazing = _seen(outgoing, (_GRAZING, lowest))
        add(cut, f"samples down to exit cosine {_GRAZING:g}", grazing, shared)
    if len(outgoing) < _VIEWS:
        few = f"too few views ({len(outgoing)})"
        ring = _seen(fibonacci_sphere(_VIEWS), (max(lowest, _GRAZING), 1.0))
        add(few, "views from all around", ring, shared)
    return found


def _sentence(named: dict[str, str], errors: dict, causes: list[str]) -> str:
    listed = [f"{word} ({_spread(float(errors[name]))})" for name, word in named.items()]
    words = " and ".join([", ".join(listed[:-1]), listed[-1]] if listed[1:] else listed)
    causes = causes or ["too few or too noisy samples"]
    verb = "are" if listed[1:] else "is"
    return f"{words} {verb} not identifiable: {', and '.join(causes)}"


def _advice(names: list[str], tried: list[_Trial]) -> str:
    """Name what would help, with the error that it leaves of the worst parameter."""
    words = []
    for mend, errors in tried:
        left = None if errors is None else max(float(errors[name]) for name in names)
        words.append(mend if left is None else f"{mend} (to {_percent(left)})")
    return f"what would help: {', or '.join(words)}"


def _samples_needed(reading: Reading, own: np.ndarray, name: str) -> int | None:
    """Find how many times as many samples a parameter needs; None beyond ``_MOST_SAMPLES``."""
    for times in (2, 3, 5, 10, 20, _MOST_SAMPLES):
        errors = reading.errors(reading.information(times * own))
        if float(errors.relative[name]) <= _IDENTIFIABLE:
            return times
    return None


def _seen(outgoing: Float[np.ndarray, "view 3"], cosines: tuple[float, float]) -> SurfaceSamples:
    """Make samples of a ball, as cameras in some directions see it between two exit cosines."""
    normals = fibonacci_sphere(8 * _SAMPLES // max(1, len(outgoing)) + 64)
    seen = normals @ outgoing.T
    which, view = np.nonzero((seen >= cosines[0]) & (seen <= cosines[1]))
    step = max(1, len(which) // _SAMPLES)
    return SurfaceSamples(normals[which[::step]], outgoing[view[::step]])


def _mean(vectors: np.ndarray) -> Float[np.ndarray, "3"]:
    return _unit(np.asarray(vectors, float).mean(axis=0))


def _unit(vector: np.ndarray) -> Float[np.ndarray, "3"]:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)


def _spread(error: float) -> str:
    # Beyond its own size an error is what the bounds of the search leave open.
    return f"+- {_percent(error)}" if error < 1 else "nothing known"


def _percent(error: float) -> str:
    return f"{100 * error:.2g} %" if error < 1 else f"{100 * error:.0f} %"
