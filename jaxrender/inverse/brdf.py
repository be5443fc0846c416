"""A BRDF from photographs under known light (T 6.4.2), from the frequency view to the exact one.

1. *Rough*: the light is split at a small roughness, and the dual model fitted from many starts.
2. *Frequency fit*: the light is split again at the roughness found, as finely as the dual model
   needs it, and the samples fitted again; the noise is estimated and the samples reweighted by it.
3. *Refinement*: Levenberg-Marquardt on the exact integral over a draw of the samples, starting from
   there.  The draw grows until two halves of it agree.  How far the refinement moves each parameter
   is the bias of the frequency fit, and is reported.
4. *Account*: intervals from the full covariance, what is identifiable, where sigma comes from, and
   what would be different under a slightly different model.

On a concave shape the frequency view is T 6.12, with transfer vectors and the visibilities of R and
of the sources, and the exact one asks for every node of the light whether a sample sees it.  Light
that bounces from one part of the object to another is in neither, and joins the exact one where it
is asked for (``settings.interreflection``, T 6.6).

A material whose lobe is not about the reflected direction has no frequency view: there a coarse fit
by the integral takes the place of the first two steps (``coarse_fit``).
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Glossy, Parametric
from jaxrender.geometry import Shape
from jaxrender.inverse.account import account_for, error_bars, judge
from jaxrender.inverse.bounds import checked_at_bound
from jaxrender.inverse.coarse_fit import fit_coarsely, material_of, width_of
from jaxrender.inverse.conditioning import WidthEvidence
from jaxrender.inverse.elimination import MANY, THINNING, Few, Problem
from jaxrender.inverse.interreflection import Bounced, WithBounced, fit_with_bounces
from jaxrender.inverse.known_light import (
    KnownLight,
    PreparedLight,
    exact_nodes,
    prepare_light,
    undivided,
)
from jaxrender.inverse.leverage import draw, leverage, width_range
from jaxrender.inverse.models import ExactModel, TabulatedModel
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.passes import (
    DEFAULTS,
    Begin,
    FitSettings,
    Stop,
    descend,
    fit_in_rounds,
    values_of,
)
from jaxrender.inverse.shadowing import concave, nodes_seen, shadows_of, with_transfer
from jaxrender.inverse.uncertainty import Uncertain
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.lighting import LightNodes
from jaxrender.reflection import DualLight, FrameNodes, Shadows, roughness_table
from jaxrender.shapes import Float

# The roughness that the light is split at in the rough first pass.
_ROUGH_SIGMA = 0.06
# The table of the second pass reaches this factor beyond the roughness found by the first.
_TABLE_REACH = 1.8
# The light is split anew when the fit ends this far (in log sigma) from where it was split.
_SPLIT_AGAIN = 0.25
_SPLITS = 3
# A draw whose halves disagree grows by this factor.
_GROWTH = 3
# Pairs of a sample and a node of the light: a draw has so many without asking, and grows to so
# many; and to no more than so many samples.
_LITTLE_WORK, _MOST_WORK, _MOST_DRAWN = 5e4, 4e8, 100_000
# Under shadows the environment is condensed to cells this narrow: each is a ray for every sample.
SHADOWED_ANGLE_PER_SIGMA = 1 / 4

Stage = Callable[[str], AbstractContextManager]


class BRDFFit(NamedTuple):
    """A recovered material with all that is known about how well it is known."""

    brdf: Parametric
    outcome: Outcome
    parameters: Uncertain
    identifiable: dict[str, bool]
    evidence: WidthEvidence | None
    frequency: Stop
    exact: Stop | None
    light: PreparedLight
    reasons: tuple[str, ...]
    bounced: Bounced | None = None

    @property
    def final(self) -> Stop:
        """The refined fit where there is one, else the frequency fit (or the coarse one)."""
        return self.frequency if self.exact is None else self.exact

    @property
    def bias(self) -> dict[str, Float[np.ndarray, "..."]]:
        """How far the refinement moved each parameter, relative to its refined value."""
        if self.exact is None:
            return {}
        before, after = values_of(self.frequency), values_of(self.exact)
        return {
            name: np.asarray(before.of(name)) / np.asarray(after.of(name)) - 1
            for name in ("kd", "ks", *after.numbers)
        }


def fit_brdf(
    observations: Observations,
    light: KnownLight,
    unknowns: Unknowns,
    variant: Parametric,
    settings: FitSettings = DEFAULTS,
    stage: Stage = lambda name: nullcontext(),
    *,
    shape: Shape | None = None,
    pool: Observations | None = None,
) -> BRDFFit:
    """Recover kd, ks and the numbers of any parametric model from reflected light.

    ``variant`` tells the model: of a microfacet the distribution, the Fresnel angle, the masking
    and, by ``mu=None``, a metal; its numbers do not matter.  ``stage`` is entered with the name of
    each step.  ``shape`` is asked for shadows where it is concave, and then the observations must
    have places.  ``pool`` are all pixels that the observations were drawn from: the refinement
    draws from it.  Raises
    ``ValueError`` for fewer samples than unknowns, and where light is to bounce off a base that is
    not Lambertian.
    """
    problem = Problem.of(unknowns, observations.radiance.shape[1])
    check_enough(observations, problem)
    shape = concave(shape)
    sought, helpers = (problem, variant), (shape, stage)
    if isinstance(variant, Glossy) and variant.has_frequency_view:
        found, prepared = _frequency_fit(observations, light, (problem, variant), settings, helpers)
        choice, predicted = found.observations, np.asarray(found.fit.predicted)
    else:
        if settings.interreflection:
            raise ValueError(
                "interreflection is that of a Lambertian base, which this model has not: leave "
                "solve.interreflection out, or choose a glossy model"
            )
        with stage("solve"):
            found, choice, predicted = fit_coarsely(observations, light, sought, settings, shape)
        with stage("split"):
            prepared = undivided(light, observations, settings.band_limit)
    exact, bounced = None, None
    if settings.refine:
        begin = (found, choice, predicted) if pool is None else (found, pool, None)
        exact, bounced = _refine(begin, light, variant, settings, helpers)
    final = found if exact is None else exact
    with stage("account"):
        account = account_for(final, variant, prepared, settings, shape)
        outcome, identifiable, reasons = judge(final, account, variant)
    return BRDFFit(
        material_of(final, variant),
        outcome,
        account.parameters,
        identifiable,
        account.evidence,
        found,
        exact,
        prepared,
        reasons,
        bounced,
    )


def _frequency_fit(
    observations: Observations,
    light: KnownLight,
    sought: tuple[Problem, Glossy],
    settings: FitSettings,
    helpers: tuple[Shape | None, Stage],
) -> tuple[Stop, PreparedLight]:
    """Split the light and fit the dual model, again until both are made for one roughness."""
    (problem, variant), (shape, stage) = sought, helpers
    if shape is not None:
        with stage("shadows"):
            observations = with_transfer(observations, shape, light.diffuse_degrees)

    def shadows(light: DualLight) -> Shadows | None:
        if shape is None:
            return None
        with stage("shadows"):
            return shadows_of(shape, observations, light)

    few = _few(observations, light, sought, settings)
    where = (shadows, stage, few)
    found, prepared = _rough_fit(observations, light, sought, settings, where), None
    for _ in range(_SPLITS):
        at = _sigma(found, variant)
        with stage("split"):
            brdf = variant.with_roughness(at, None).as_metal()
            prepared = prepare_light(
                light,
                observations,
                brdf,
                settings.split,
                settings.band_limit,
                transfer=settings.split_transfer,
            )
        darkened = shadows(prepared.dual)
        with stage("table"):
            table = roughness_table(
                variant,
                observations.samples,
                prepared.dual,
                _table_range(problem.unknowns, variant, at),
                transfer=settings.transfer,
                shadows=darkened,
            )
        with stage("solve"):
            begin = Begin(settings.noise, None, np.asarray(found.fit.solution.point)[None])
            model = TabulatedModel(variant, table)
            found = fit_in_rounds(problem, model, observations, begin, settings, few)
        if abs(np.log(_sigma(found, variant) / at)) < _SPLIT_AGAIN:
            break
    assert prepared is not None
    return found, prepared


def _rough_fit(
    observations: Observations,
    light: KnownLight,
    sought: tuple[Problem, Glossy],
    settings: FitSettings,
    helpers: tuple[Callable[[DualLight], Shadows | None], Stage, Few | None],
) -> Stop:
    """Find the neighbourhood of the answer from many starts."""
    (problem, variant), (shadows, stage, few) = sought, helpers
    unknowns = problem.unknowns
    told = unknowns[variant.shape.name]
    if told.free:
        reach = width_range(unknowns, variant)
        sigma = max(reach[0], min(_ROUGH_SIGMA, reach[1]))
    else:
        sigma = variant.shape.width_of(told.first(0.0))
        reach = (sigma, sigma * 1.01)
    split = "rough" if settings.split == "auto" else settings.split
    brdf = variant.with_roughness(sigma, None)
    with stage("rough"):
        dual = prepare_light(light, observations, brdf, split, settings.band_limit).dual
    darkened = shadows(dual)
    with stage("rough"):
        table = roughness_table(
            variant,
            observations.samples,
            dual,
            reach,
            transfer=settings.transfer,
            shadows=darkened,
        )
        begin = Begin(settings.noise, None, unknowns.starts(settings.starts))
        return fit_in_rounds(
            problem, TabulatedModel(variant, table), observations, begin, settings, few
        )


def _few(
    observations: Observations,
    light: KnownLight,
    sought: tuple[Problem, Glossy],
    settings: FitSettings,
) -> Few | None:
    """Choose the samples that a search among many begins with."""
    if observations.count < MANY:
        return None
    problem, variant = sought
    told = leverage(observations, light, width_range(problem.unknowns, variant))
    some, index = draw(observations, told, observations.count // THINNING, settings.seed)
    return Few(index, some.pixels / observations.pixels[index])


def _refine(
    found: tuple[Stop, Observations, Float[np.ndarray, "sample channel"] | None],
    light: KnownLight,
    variant: Parametric,
    settings: FitSettings,
    where: tuple[Shape | None, Stage],
) -> tuple[Stop, Bounced | None]:
    """Continue on the exact integral over a draw of the samples, and with bounces if asked.

    ``found`` is where a quicker fit ended, samples to choose from, and what it predicts of them; of
    a pool of pixels nothing is predicted. The draw grows until two halves of it agree within their
    errors, until it holds all samples, or until it becomes too much work.
    """
    (quick, choice, expected), (shape, stage) = found, where
    told = leverage(choice, light, width_range(quick.problem.unknowns, variant))
    count, before = settings.refine_samples, quick
    if expected is None:
        # Where the light is a few sources, many samples cost as little as few under an environment.
        nodes = exact_nodes(light, np.zeros(0, int), width_of(quick, variant))
        count = max(count, int(_LITTLE_WORK / _nodes_a_sample(nodes)))
    while True:
        with stage("refine"):
            some, index = draw(choice, told, count, settings.seed)
            cells = None if shape is None else SHADOWED_ANGLE_PER_SIGMA
            nodes = exact_nodes(light, np.asarray(some.frame), width_of(before, variant), cells)
        seen = None
        if shape is not None:
            with stage("shadows"):
                seen = nodes_seen(shape, some, nodes)
        with stage("refine"):
            model = ExactModel(variant, some.samples, nodes, seen)
            begin = before.onward(None if expected is None else expected[index])
            stop = descend(quick.problem, model, some, begin, settings)
            stop = checked_at_bound(stop, model, settings)
            work = some.count * _nodes_a_sample(nodes)
            largest = min(choice.count, _MOST_DRAWN)
            grown = some.count >= largest or _GROWTH * work > _MOST_WORK
            if grown or error_bars(stop, settings).disagreement <= 1:
                break
        count, before = min(_GROWTH * count, largest), stop
    if shape is None or not settings.interreflection:
        return stop, None

    def refit(before: Stop, bounced: Float[np.ndarray, "sample channel"]) -> Stop:
        at = np.asarray(before.fit.predicted)
        brighter = WithBounced(model, bounced)
        return descend(before.problem, brighter, some, before.onward(at), settings)

    with stage("interreflection"):
        return fit_with_bounces(stop, shape, light, refit)


def _nodes_a_sample(nodes: tuple[LightNodes | FrameNodes, ...]) -> int:
    return sum(part.directions.shape[-2] for part in nodes)


def _sigma(stop: Stop, variant: Parametric) -> float:
    return float(material_of(stop, variant).sigma)


def _table_range(unknowns: Unknowns, variant: Parametric, sigma: float) -> tuple[float, float]:
    if not unknowns[variant.shape.name].free:
        return sigma, 1.01 * sigma
    low, high = width_range(unknowns, variant)
    return max(low, sigma / _TABLE_REACH), min(high, sigma * _TABLE_REACH)


def check_enough(observations: Observations, problem: Problem) -> None:
    """Raise ``ValueError`` for fewer measurements than the unknowns need."""
    measured = observations.radiance.size
    unknown = len(problem.unknowns.names) + problem.mix.shape[1]
    if measured < max(10, 2 * unknown):
        raise ValueError(
            f"{observations.count} samples cannot determine {unknown} unknowns: "
            "use more photographs, a lower samples.min_cosine, or a smaller capture.erode"
        )
