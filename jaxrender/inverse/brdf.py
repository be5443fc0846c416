"""A BRDF from photographs under known light (T 6.4.2), from the frequency view to the exact one.

1. *Rough*: the light is split at a small roughness, and the dual model fitted from many starts.
2. *Frequency fit*: the light is split again at the roughness found, as finely as the dual model
   needs it, and the samples fitted again; the noise is estimated and the samples reweighted by it.
3. *Refinement*: Levenberg-Marquardt on the exact integral over a stratified subset, starting from
   there.  How far it moves each parameter is the bias of the frequency fit, and is reported.
4. *Account*: intervals from the full covariance, what is identifiable, where sigma comes from, and
   what would be different under a slightly different model.

On a concave shape the frequency view is T 6.12, with transfer vectors and the visibilities of R and
of the sources, and the exact one asks for every node of the light whether a sample sees it.  Light
that bounces from one part of the object to another is in neither, and joins the exact one where it
is asked for (``settings.interreflection``, T 6.6).
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.geometry import Shape
from jaxrender.inverse.account import account_for, judge
from jaxrender.inverse.conditioning import SigmaEvidence
from jaxrender.inverse.elimination import Problem
from jaxrender.inverse.interreflection import Bounced, WithBounced, fit_with_bounces
from jaxrender.inverse.known_light import KnownLight, PreparedLight, exact_nodes, prepare_light
from jaxrender.inverse.models import ExactModel, TabulatedModel
from jaxrender.inverse.observations import Observations, stratified_subset
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
from jaxrender.inverse.unknowns import MicrofacetUnknowns
from jaxrender.reflection import DualLight, Shadows, roughness_table
from jaxrender.shapes import Float

# The roughness that the light is split at in the rough first pass.
_ROUGH_SIGMA = 0.06
# The table of the second pass reaches this factor beyond the roughness found by the first.
_TABLE_REACH = 1.8
# The light is split anew when the fit ends this far (in log sigma) from where it was split.
_SPLIT_AGAIN = 0.25
_SPLITS = 3
# Under shadows the environment is condensed to cells this narrow: each is a ray for every sample.
SHADOWED_ANGLE_PER_SIGMA = 1 / 4

Stage = Callable[[str], AbstractContextManager]


class BRDFFit(NamedTuple):
    """A recovered material with all that is known about how well it is known."""

    brdf: Glossy
    outcome: Outcome
    parameters: Uncertain
    identifiable: dict[str, bool]
    evidence: SigmaEvidence
    frequency: Stop
    exact: Stop | None
    light: PreparedLight
    reasons: tuple[str, ...]
    bounced: Bounced | None = None

    @property
    def final(self) -> Stop:
        """The refined fit where there is one, else the frequency fit."""
        return self.frequency if self.exact is None else self.exact

    @property
    def bias(self) -> dict[str, Float[np.ndarray, "..."]]:
        """How far the refinement moved each parameter, relative to its refined value."""
        if self.exact is None:
            return {}
        before, after = values_of(self.frequency), values_of(self.exact)
        return {
            name: np.asarray(getattr(before, name)) / np.asarray(getattr(after, name)) - 1
            for name in ("kd", "ks", "sigma", "mu")
        }


def fit_brdf(
    observations: Observations,
    light: KnownLight,
    unknowns: MicrofacetUnknowns,
    variant: Glossy,
    settings: FitSettings = DEFAULTS,
    stage: Stage = lambda name: nullcontext(),
    *,
    shape: Shape | None = None,
) -> BRDFFit:
    """Recover kd, ks, the width sigma and mu of a glossy model from samples of reflected light.

    ``variant`` tells the model: of a microfacet the distribution, the Fresnel angle, the masking
    and, by ``mu=None``, a metal; its numbers do not matter.  One without an index wants
    ``unknowns.mu`` to be None.  ``stage`` is entered with the name of each step.  ``shape`` is
    asked for shadows where it is concave, and then the observations must have places.  Raises
    ``ValueError`` for fewer samples than unknowns.
    """
    problem = Problem.of(unknowns, observations.radiance.shape[1])
    check_enough(observations, problem)
    shape = concave(shape)
    if shape is not None:
        with stage("shadows"):
            observations = with_transfer(observations, shape, light.diffuse_degrees)

    def shadows(light: DualLight) -> Shadows | None:
        if shape is None:
            return None
        with stage("shadows"):
            return shadows_of(shape, observations, light)

    found = _rough_fit(observations, light, (problem, variant), settings, (shadows, stage))
    for _ in range(_SPLITS):
        at = _sigma(found)
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
                _table_range(unknowns, at),
                transfer=settings.transfer,
                shadows=darkened,
            )
        with stage("solve"):
            begin = Begin(settings.noise, None, np.asarray(found.fit.solution.point)[None])
            found = fit_in_rounds(problem, TabulatedModel(table), observations, begin, settings)
        if abs(np.log(_sigma(found) / at)) < _SPLIT_AGAIN:
            break
    exact, bounced = None, None
    if settings.refine:
        exact, bounced = _refine(found, light, variant, settings, (shape, stage))
    final = found if exact is None else exact
    with stage("account"):
        account = account_for(final, variant, prepared, settings, shape)
        outcome, identifiable, reasons = judge(final, account, variant.shape)
    return BRDFFit(
        _material(final, variant),
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


def _rough_fit(
    observations: Observations,
    light: KnownLight,
    sought: tuple[Problem, Glossy],
    settings: FitSettings,
    helpers: tuple[Callable[[DualLight], Shadows | None], Stage],
) -> Stop:
    """Find the neighbourhood of the answer from many starts."""
    (problem, variant), (shadows, stage) = sought, helpers
    unknowns = problem.unknowns
    if unknowns.sigma.free:
        sigma = max(unknowns.sigma.lower, min(_ROUGH_SIGMA, unknowns.sigma.upper))
        reach = (unknowns.sigma.lower, unknowns.sigma.upper)
    else:
        sigma = float(unknowns.unpack(jnp.asarray(unknowns.starts(1)[0])).sigma)
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
        return fit_in_rounds(problem, TabulatedModel(table), observations, begin, settings)


def _refine(
    frequency: Stop,
    light: KnownLight,
    variant: Glossy,
    settings: FitSettings,
    where: tuple[Shape | None, Stage],
) -> tuple[Stop, Bounced | None]:
    """Continue on the exact integral over a stratified subset, and with bounces if asked."""
    shape, stage = where
    with stage("refine"):
        some, predicted = stratified_subset(
            frequency.observations, frequency.fit.predicted, settings.refine_samples, settings.seed
        )
        cells = None if shape is None else SHADOWED_ANGLE_PER_SIGMA
        nodes = exact_nodes(light, np.asarray(some.frame), _sigma(frequency), cells)
    seen = None
    if shape is not None:
        with stage("shadows"):
            seen = nodes_seen(shape, some, nodes)
    with stage("refine"):
        model = ExactModel(variant, some.samples, nodes, seen)
        stop = descend(frequency, model, some, predicted, settings)
    if shape is None or not settings.interreflection:
        return stop, None

    def refit(before: Stop, bounced: Float[np.ndarray, "sample channel"]) -> Stop:
        at = np.asarray(before.fit.predicted)
        return descend(before, WithBounced(model, bounced), some, at, settings)

    with stage("interreflection"):
        return fit_with_bounces(stop, (shape, light), refit)


def _sigma(stop: Stop) -> float:
    return float(stop.problem.unknowns.unpack(stop.fit.solution.point).sigma)


def _material(stop: Stop, variant: Glossy) -> Glossy:
    found = values_of(stop)
    mu = None if variant.mu is None else float(found.mu)
    lobe = variant.with_roughness(float(found.sigma), mu)
    return lobe.with_amplitudes(np.asarray(found.kd), np.asarray(found.ks))


def _table_range(unknowns: MicrofacetUnknowns, sigma: float) -> tuple[float, float]:
    if not unknowns.sigma.free:
        return sigma, 1.01 * sigma
    low = max(unknowns.sigma.lower, sigma / _TABLE_REACH)
    return low, min(unknowns.sigma.upper, sigma * _TABLE_REACH)


def check_enough(observations: Observations, problem: Problem) -> None:
    """Raise ``ValueError`` for fewer measurements than the unknowns need."""
    measured = observations.radiance.size
    unknown = len(problem.unknowns.names) + problem.mix.shape[1]
    if measured < max(10, 2 * unknown):
        raise ValueError(
            f"{observations.count} samples cannot determine {unknown} unknowns: "
            "use more photographs, a lower samples.min_cosine, or a smaller capture.erode"
        )
