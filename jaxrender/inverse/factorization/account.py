"""Material and light of a factorization in a stated gauge, with error bars.

The covariance is that of least squares over all unknowns together.  It is (J' W J + Lambda)^-1
times the mean squared weighted residual and the loss's ``variance_factor``.  A sample that stands
for c pixels is measured only once.  So J' C W J + Lambda stands between two of these inverses
(``projection.scatter``); W has c in it.  It is widened by what photographs, and samples that
reflect the same part of the light, leave unexplained together (``clusters``).  Then it is carried
over to parameters and light in their own units.  A gauge that depends on what was found adds its
part to both.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy.linalg

from jaxrender.harmonics import band_limit_of, degrees
from jaxrender.inverse.clusters import Clusters, widened
from jaxrender.inverse.factorization.blocks import in_blocks
from jaxrender.inverse.factorization.crowds import with_grain
from jaxrender.inverse.factorization.gauges import GAUGES, carried, gauge_factors, in_gauge
from jaxrender.inverse.factorization.joint import unknown_count
from jaxrender.inverse.factorization.projection import (
    Drawn,
    Scatter,
    System,
    reduced_system,
    scatter,
)
from jaxrender.inverse.factorization.recovered_scene import RecoveredScene
from jaxrender.inverse.factorization.response import specular_share
from jaxrender.inverse.factorization.slopes import tangent_frames
from jaxrender.inverse.factorization.source_clusters import SourceCluster, centred, grouped
from jaxrender.inverse.factorization.source_nodes import widths_of
from jaxrender.inverse.factorization.state import (
    State,
    Task,
    free_unknowns,
    in_deviations,
    measured,
    response_of,
)
from jaxrender.inverse.intervals import Uncertain
from jaxrender.inverse.weights import variance_factor
from jaxrender.lighting import DirectionalSources
from jaxrender.shapes import AnyArray, Bool, Float, Int

# The prior variance of an unknown's logarithm: it matters only where the data are silent.
_PRIOR_VARIANCE = 4.0


class Account(NamedTuple):
    """Material and light of a factorization, in one gauge."""

    parameters: Uncertain
    scene: RecoveredScene


def account_of(task: Task, state: State, gauge: str) -> Account:
    """Put material and light into a gauge, with their errors.

    Raises ``ValueError`` for a gauge that is not in ``GAUGES``.
    """
    if gauge not in GAUGES:
        raise ValueError(f"gauge={gauge!r}: choose one of {', '.join(GAUGES)}")
    grain = with_grain(task, state)
    response, data = response_of(task, grain.state), measured(task, grain.state)
    blocks = in_blocks(response, data._replace(penalty=grain.penalty))
    system = reduced_system(blocks, grain.state.guess)
    solved = system.solved
    left = np.asarray(data.weights) * (task.radiance - np.asarray(solved.predicted))
    free = free_unknowns(task, state)
    used = int(np.count_nonzero(free)) + data.radiance.shape[1] * (
        response.slow_count + int(np.count_nonzero(state.active))
    )
    variance = float(np.sum(left**2)) / max(left.size - used, 1)
    variance *= variance_factor(in_deviations(task, state, solved).left, task.settings.loss)
    inverse = _inverse(system, grain.free(free), grain.state)
    together, group = Clusters.of(task.observations).both
    drawn = Drawn(task.observations.shares, group)
    spread = scatter(blocks, grain.state.guess, drawn, system)
    exact = _joint_covariance(system, spread, inverse, _prior(grain.state), variance)
    moves = _moves(system, spread, inverse)[: len(together.cell)]
    whole = widened(exact, together.covariance(moves))
    if state.joint is not None and grain.count < len(grain.state.active):
        light, own = np.asarray(state.joint.solved.light), grain.kept(*solved.light.shape)
        moved = grain.moved(system, inverse, light)
        exact, whole = (one[np.ix_(own, own)] for one in (exact, whole + np.outer(moved, moved)))
    else:
        light = np.asarray(solved.light)
    covariance = whole[: len(free), : len(free)]
    unknown = np.concatenate([np.ravel(part) for part in (*state.guess[:3], light.T)])
    # Of the nonlinear unknowns the directions of sources move no number that the gauge changes.
    kept = np.r_[: len(unknown) - light.size, len(covariance) : len(whole)]
    variant = task.response.variant
    parameters, lit = in_gauge(unknown, whole[np.ix_(kept, kept)], variant, gauge, light.shape)
    if_exact, _ = in_gauge(unknown, exact[np.ix_(kept, kept)], variant, gauge, light.shape)
    parameters = parameters._replace(if_exact=if_exact)
    alone = np.sqrt(np.diag(whole)[len(covariance) :]).reshape(light.T.shape).T
    determined = _determined(np.asarray(data.penalty)[: response.slow_count], alone, variance)
    factor = gauge_factors(np.asarray(specular_share(state.guess)), light[0], gauge)
    scene = _scene(state, light / factor, covariance, lit, determined)
    clusters = _clusters(state, light / factor, whole, lit, factor)
    aside = scene.direction_error.copy()
    for one in clusters:
        aside[one.members] = np.maximum(aside[one.members], one.width)
    return Account(parameters, scene._replace(clusters=clusters, direction_error=aside))


def _prior(state: State) -> Float[np.ndarray, "unknown"]:
    """Say what is expected of the nonlinear unknowns (1 / variance), hardly anything.

    A source is not much wider than the lobe that shows it: else it is found as several.
    """
    prior = np.full(unknown_count(state.guess), 1 / _PRIOR_VARIANCE)
    if state.guess.variance is not None:
        prior[-len(state.active) :] = np.exp(-4 * float(state.guess.sigma))
    return prior


def _inverse(
    system: System, free: Bool[np.ndarray, "unknown"], state: State
) -> Float[np.ndarray, "unknown unknown"]:
    """Invert the reduced curvature over what is free, with a prior so wide that it never shows."""
    curvature = np.asarray(system.curvature)[np.ix_(free, free)]
    found = np.zeros_like(np.asarray(system.curvature))
    found[np.ix_(free, free)] = np.linalg.inv(curvature + np.diag(_prior(state)[free]))
    return found


def _joint_covariance(
    system: System,
    spread: Scatter,
    inverse: Float[np.ndarray, "unknown unknown"],
    prior: Float[np.ndarray, "unknown"],
    variance: float,
) -> Float[np.ndarray, "number number"]:
    """Put nonlinear unknowns and the light, channel by channel, together.

    The light's error is that of its own equations, less its answer to the other unknowns.
    """
    blocks = [inverse @ (np.asarray(spread.own) + np.diag(prior)) @ inverse]
    mixed, answers = [], []
    parts = (system.solved.normal, system.across, spread.light, spread.both)
    for factor, across, own, both in zip(*map(np.asarray, parts)):
        root = np.linalg.inv(factor)
        normal = root.T @ root
        blocks.append(normal @ own @ normal)
        mixed.append(normal @ both @ inverse)
        answers.append(normal @ across)
    alone = np.asarray(scipy.linalg.block_diag(*blocks))
    first = len(inverse)
    alone[first:, :first] = np.concatenate(mixed)
    alone[:first, first:] = alone[first:, :first].T
    together = np.eye(len(alone))
    together[first:, :first] = -np.concatenate(answers)
    return variance * together @ alone @ together.T


def _moves(
    system: System, spread: Scatter, inverse: Float[np.ndarray, "unknown unknown"]
) -> Float[np.ndarray, "group number"]:
    """Say how far what each group of samples leaves moves nonlinear unknowns and the light."""
    own = np.asarray(spread.slopes) @ inverse
    found = [own]
    parts = (system.solved.normal, system.across, spread.rights)
    for factor, across, right in zip(*map(np.asarray, parts)):
        root = np.linalg.inv(factor)
        normal = root.T @ root
        found.append((right - own @ across.T) @ normal)
    return np.concatenate(found, axis=1)


def parameter_slopes(
    task: Task, state: State, gauge: str
) -> tuple[Float[np.ndarray, "parameter unknown"], Float[np.ndarray, "parameter channel part"]]:
    """Differentiate material and light in the gauge by the nonlinear unknowns, and by the light.

    The parameters of the material come first, then the light, channel by channel, and then how far
    every source moves along either axis of its tangent frame, and how wide it is if it has a width.
    """
    assert state.joint is not None
    light = np.asarray(state.joint.solved.light)
    unknown = np.concatenate([np.ravel(part) for part in (*state.guess[:3], light.T)])
    slopes = np.asarray(carried(unknown, task.response.variant, gauge, light.shape)[1])
    by_material, by_light = np.split(slopes, [len(unknown) - light.size], axis=1)
    steps = np.eye(unknown_count(state.guess) - len(by_material[0]))
    by_light = np.pad(by_light, ((0, len(steps)), (0, 0)))
    return np.asarray(scipy.linalg.block_diag(by_material, steps)), by_light.reshape(
        -1, *light.T.shape
    )


def widened_light(
    task: Task,
    state: State,
    scene: RecoveredScene,
    gauge: str,
    shifts: Float[np.ndarray, "row cause"],
) -> RecoveredScene:
    """Let the errors of the light reach as far as causes shift it, a column each.

    The rows are those of ``parameter_slopes`` after the material's.
    """
    assert state.joint is not None
    light = np.asarray(state.joint.solved.light)
    share = np.asarray(specular_share(state.guess))
    order = _brightest_first(state, light / gauge_factors(share, light[0], gauge))
    slow = len(light) - len(state.active)
    sources = len(state.active)
    of_light, steps, _ = np.split(shifts, [light.size, light.size + 2 * sources])
    own = of_light.reshape(*light.T.shape, -1)[:, np.r_[:slow, slow + order]]
    frames = np.asarray(tangent_frames(jnp.asarray(state.guess.directions)))[order]
    moves = np.einsum("sxa,asc->sxc", frames, steps.reshape(2, sources, -1)[:, order])
    aside = np.sqrt(scene.direction_error**2 + np.sum(moves**2, axis=(1, 2)))
    energies = np.asarray(scene.sources.irradiance, float).sum(axis=1)
    return scene._replace(
        covariance=scene.covariance + own @ np.swapaxes(own, 1, 2),
        direction_error=aside,
        clusters=tuple(
            _widened(one, moves[one.members], own[:, slow + one.members], energies[one.members])
            for one in scene.clusters
        ),
    )


def _widened(
    cluster: SourceCluster,
    moves: Float[np.ndarray, "member 3 cause"],
    changes: Float[np.ndarray, "channel member cause"],
    energies: Float[np.ndarray, "member"],
) -> SourceCluster:
    """Let the errors of a cluster reach as far as its members move and change together."""
    moved = np.einsum("m,mxc->xc", energies / energies.sum(), moves)
    changed = np.sum(changes.sum(axis=1) ** 2, axis=1)
    return cluster._replace(
        direction_error=float(np.sqrt(cluster.direction_error**2 + np.sum(moved**2))),
        irradiance_error=np.sqrt(cluster.irradiance_error**2 + changed),
    )


def _scene(
    state: State,
    light: Float[np.ndarray, "part channel"],
    covariance: Float[np.ndarray, "unknown unknown"],
    lit: Float[np.ndarray, "channel part channel part"],
    determined: Float[np.ndarray, "degree"],
) -> RecoveredScene:
    slow = light.shape[0] - len(state.active)
    order = _brightest_first(state, light)
    directions, energies = np.asarray(state.guess.directions)[order], light[slow:][order]
    sources = len(state.active)
    aside = np.diag(covariance)[light.shape[1] + 2 :][: 2 * sources]
    first, second = np.split(aside, 2)
    kept = np.r_[:slow, slow + order]
    return RecoveredScene(
        light[:slow],
        DirectionalSources(directions, energies),
        np.einsum("cpcq->cpq", lit)[:, kept[:, None], kept],
        np.sqrt(first + second)[order],
        determined,
        widths=widths_of(state.guess.variance, state.guess.sigma, sources)[order],
    )


def _brightest_first(
    state: State, light: Float[np.ndarray, "part channel"]
) -> Int[np.ndarray, "source"]:
    active = np.flatnonzero(state.active)
    energies = light[len(light) - len(state.active) :][active].sum(axis=1)
    return active[np.argsort(-energies)]


def _clusters(
    state: State,
    light: Float[np.ndarray, "part channel"],
    whole: Float[np.ndarray, "number number"],
    lit: Float[np.ndarray, "channel part channel part"],
    factor: Float[AnyArray, "channel"],
) -> tuple[SourceCluster, ...]:
    """Sum up the sources that the lobe does not tell apart, with the errors of their sums.

    ``light`` and its covariance ``lit`` are in the gauge of ``factor``; ``whole`` is the covariance
    of nonlinear unknowns and of the light before that.
    """
    parts, channels = light.shape
    sources, order = len(state.active), _brightest_first(state, light)
    directions = np.asarray(state.guess.directions)
    frames = np.asarray(tangent_frames(directions))
    unknowns = len(whole) - channels * parts
    found = []
    for members in grouped(directions[order], float(np.exp(state.guess.sigma))):
        among, count = order[members], len(members)
        at = parts - sources + among
        # Energies of all channels together, and steps to both sides, from the unknowns.
        taken = np.zeros((3 * count, len(whole)))
        for channel in range(channels):
            taken[range(count), unknowns + channel * parts + at] = 1 / factor[channel]
        taken[range(count, 2 * count), channels + 2 + among] = 1
        taken[range(2 * count, 3 * count), channels + 2 + sources + among] = 1
        energies = light[at]
        variance = np.einsum("cpcq->c", lit[:, at][:, :, :, at])
        where = taken @ whole @ taken.T
        centre = centred(directions[among], energies.sum(axis=1), frames[among], where)
        total = SourceCluster(members, *centre, energies.sum(axis=0), np.sqrt(variance))
        found.append(total)
    return tuple(found)


def _determined(
    penalty: Float[np.ndarray, "coefficient channel"],
    errors: Float[np.ndarray, "part channel"],
    variance: float,
) -> Float[np.ndarray, "degree"]:
    """Compute 1 less the variance that is left, relative to the variance expected (1 / penalty)."""
    left = np.clip(penalty * errors[: len(penalty)] ** 2 / variance, 0, 1).mean(axis=1)
    degree = degrees(band_limit_of(len(left)))
    return 1 - np.bincount(degree, left) / np.bincount(degree)
