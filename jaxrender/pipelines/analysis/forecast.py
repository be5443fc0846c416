"""``jaxrender analyze CONFIG``: forecasts of every recovery, and the best next photograph."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from jaxrender.errors import InputError
from jaxrender.inverse.candidate_views import candidate_views
from jaxrender.inverse.forecast import (
    Foreseen,
    JointForecast,
    LightForecast,
    MaterialForecast,
    forecast_joint,
    forecast_light,
    forecast_material,
    foresee,
    foresee_draw,
    problem_of,
)
from jaxrender.inverse.next_best import (
    Suggestion,
    present_errors,
    suggest_sources,
    suggest_views,
)
from jaxrender.pipelines.analysis.prospect import Prospect, prospect_of
from jaxrender.pipelines.analysis.supposed import Supposition, supposition_of
from jaxrender.pipelines.config import RunConfig
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.scene import fault_of, unknowns_of

# Light is condensed to cells of so many sigma where a fit would not use the exact integral.
_COARSE = 0.25

Found = TypeVar("Found")


class Options(NamedTuple):
    """What is asked of an analysis; ``suggest`` is views, sources or nothing."""

    suppose: tuple[str, ...] = ()
    noise: float | None = None
    band_limit: int | None = None
    figure: Path | None = None
    suggest: str | None = None
    aim: str = "worst"
    count: int = 5


class ConfigAnalysis(NamedTuple):
    """The forecasts of one config; None where a recovery cannot be made at all, and why.

    ``suggestions`` are what one more photograph should be, best first, and ``present`` the errors
    without it, from the same samples.
    """

    prospect: Prospect
    supposition: Supposition
    foreseen: Foreseen
    material: MaterialForecast | None
    light: LightForecast | None
    joint: JointForecast | None
    impossible: dict[str, str]
    suggestions: tuple[Suggestion, ...]
    present: dict[str, float]
    text: str


ALL = Options()


def analyze_config(
    config: RunConfig, options: Options = ALL, progress: Progress | None = None
) -> ConfigAnalysis:
    """Predict the errors that the photographs of a config will allow.

    Raises ``InputError`` for what a fit would refuse, photographs apart, for a supposed material
    outside the bounds of the search, and for options that make no sense.
    """
    from jaxrender.pipelines.analysis.figure import draw
    from jaxrender.pipelines.analysis.tables import text_of

    _check(options)
    progress = progress or SilentProgress()
    with progress.stage("trace"):
        prospect = prospect_of(config, progress)
    supposition = supposition_of(config, prospect.recipe, options.suppose, options.noise)
    with progress.stage("foresee"):
        foreseen = _foreseen(config, prospect, supposition)
    impossible: dict[str, str] = {}
    unknowns = unknowns_of(config, len(prospect.cameras))
    with progress.stage("forecast"):
        material = None
        if prospect.light_given:
            split = config.lighting.split
            with fault_of("brdf"):
                material = forecast_material(foreseen, unknowns, split)
        else:
            impossible["material"] = "the config gives no light: it is unknown, too (see below)"
        at = (prospect.situation, supposition.supposed)
        light = _tried("light", impossible, lambda: forecast_light(*at, options.band_limit))
        joint = _tried("joint", impossible, lambda: forecast_joint(*at))
    suggestions: tuple[Suggestion, ...] = ()
    present: dict[str, float] = {}
    if options.suggest is not None:
        with progress.stage("suggest"), fault_of(f"--suggest {options.suggest}"):
            present, suggestions = _suggestions(config, prospect, supposition, options)
    found = ConfigAnalysis(
        prospect,
        supposition,
        foreseen,
        material,
        light,
        joint,
        impossible,
        suggestions,
        present,
        "",
    )
    if options.figure is not None:
        draw(options.figure, found)
    return found._replace(text=text_of(found, options))


def _check(options: Options) -> None:
    if options.count < 1:
        raise InputError(f"--count {options.count}: ask for 1 suggestion or more")
    if options.band_limit is not None and options.band_limit < 1:
        raise InputError(f"--band-limit {options.band_limit}: look at degree 1 or more")


def _foreseen(config: RunConfig, prospect: Prospect, supposition: Supposition) -> Foreseen:
    """Predict the samples that the last step of the fit would use."""
    return foresee_draw(prospect.pool, supposition.supposed, *_last_step(config))


def _last_step(config: RunConfig) -> tuple[int, int, float | None]:
    """Tell how many samples the last step takes, by which seed, under light in which cells."""
    refined = config.solve.refine == "exact"
    count = config.refine_count if refined else config.sample_count
    return count, config.samples.seed, None if refined else _COARSE


def _tried(name: str, impossible: dict[str, str], forecast: Callable[[], Found]) -> Found | None:
    try:
        return forecast()
    except ValueError as error:
        impossible[name] = str(error)
        return None


def _suggestions(
    config: RunConfig, prospect: Prospect, supposition: Supposition, options: Options
) -> tuple[dict[str, float], tuple[Suggestion, ...]]:
    """Rank photographs, whose samples are spread alike over those that are there and the new."""
    foreseen = foresee(prospect.situation, supposition.supposed, *_last_step(config))
    unknowns = unknowns_of(config, len(np.unique(foreseen.situation.frame)))
    problem = problem_of(unknowns, foreseen.supposed.brdf)
    present = present_errors(foreseen, problem)
    if options.suggest == "sources":
        return present, suggest_sources(foreseen, problem, None, options.aim, options.count)
    views = candidate_views(prospect.cameras, prospect.shape, config.samples.min_cosine)
    return present, suggest_views(foreseen, problem, views, options.aim, options.count)
