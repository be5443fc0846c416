"""A task as a run knows it, and what all fits of a few unknown numbers have in common."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import BRDF, Parametric, material_named
from jaxrender.errors import InputError
from jaxrender.geometry import Shape
from jaxrender.inverse import KnownLight, Observations
from jaxrender.inverse.brdf import check_enough
from jaxrender.inverse.elimination import Problem
from jaxrender.inverse.leverage import draw, leverage, sharpness
from jaxrender.pipelines.clock import Clock
from jaxrender.pipelines.config import RunConfig
from jaxrender.pipelines.progress import Progress
from jaxrender.pipelines.result import FinishedRun
from jaxrender.pipelines.scene import fault_of, unknowns_of
from jaxrender.pipelines.subject import Subject, UniformSubject
from jaxrender.pipelines.tasks.recovery import Evidence, Recovery


def material_of_run(run: FinishedRun) -> Parametric:
    """Make the material of a finished run; ``InputError`` where it holds none."""
    if "brdf" not in run.summary:
        raise InputError(f"{run.folder}: a result of task {run.config.task} holds no material")
    return material_named(run.summary["brdf"]["model"], run.summary["brdf"])


class Task(NamedTuple):
    """What a run asks of a task, in this order, and what a finished run of it can be used as.

    ``draw`` picks the samples out of all usable pixels; ``check`` refuses evidence that nothing can
    be found from, by ``InputError``; ``would`` says what a dry run would do; ``recover`` does it.
    ``brdf`` is the one BRDF that a finished run holds, or ``InputError``; ``subject`` is what can
    be rendered of it.
    """

    draw: Callable[[RunConfig, Observations, KnownLight | None], Observations]
    check: Callable[[RunConfig, Evidence], None]
    would: Callable[[RunConfig, Evidence], str]
    recover: Callable[[RunConfig, Evidence, Clock, Progress], Recovery]
    brdf: Callable[[FinishedRun], BRDF] = material_of_run
    subject: Callable[[FinishedRun, Shape], Subject] = lambda run, shape: UniformSubject(
        material_of_run(run)
    )


def draw_samples(config: RunConfig, pool: Observations, light: KnownLight | None) -> Observations:
    """Draw samples where the leverage is high, or the specular part is sharp."""
    weight = sharpness(pool) if light is None else leverage(pool, light)
    return draw(pool, weight, config.sample_count, config.samples.seed).observations


def check_samples(config: RunConfig, evidence: Evidence) -> None:
    """Refuse samples that no fit of the unknown numbers can be made from."""
    observations, photographs = evidence.observations, evidence.photographs
    drawn = config.samples.count
    usable = sum(int(np.count_nonzero(p.selection.usable)) for p in photographs)
    problem = Problem.of(unknowns_of(config, len(photographs)), observations.radiance.shape[1])
    with fault_of(f"samples.count is {drawn}, and {usable} pixels are usable"):
        check_enough(observations, problem)
    if config.solve.refine == "exact" and config.refine_count < observations.count:
        refined = config.solve.refine_samples
        with fault_of(f"solve.refine_samples is {refined}; give more, or refine: off"):
            check_enough(observations.take(np.arange(config.refine_count)), problem)
    unseen = set(range(len(photographs))) - set(observations.frame.tolist())
    if config.solve.free_exposure and unseen:
        name = photographs[min(unseen)].frame.image_path
        raise InputError(
            f"{name}: none of its pixels is among the {observations.count} samples drawn, so "
            "solve.free_exposure cannot fit its exposure; raise samples.count"
        )


def would_fit(config: RunConfig, evidence: Evidence) -> str:
    """Name the unknown numbers that a fit would find."""
    unknowns = unknowns_of(config, len(evidence.photographs))
    free = [*unknowns.free_amplitudes, *unknowns.free_numbers]
    return (
        f"fit {', '.join(filter(None, free)) or 'nothing'} to "
        f"{evidence.observations.count} samples of {len(evidence.photographs)} photographs"
    )
