"""Variable projection over all sites: sigma and mu, with the whole texture eliminated.

For given sigma and mu every site's material is the exact solution of a small system.  So the
search has two unknowns, whatever the number of texels.  Derivatives go through the elimination
(Golub and Pereyra).  ``shared`` takes one K_s for all sites, as phase 1 of T 6.4.2 does; otherwise
each site has its own, held together by a weak prior.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.models import Columns, LinearisedModel, Model
from jaxrender.inverse.solvers import least_squares, simplex
from jaxrender.inverse.texture.alternation import confidence
from jaxrender.inverse.texture.measurements import SiteData
from jaxrender.inverse.texture.site_sums import SiteMaterial, by_channel, site_sums
from jaxrender.inverse.texture.site_systems import SpecularPrior, solve_freely, solve_sites
from jaxrender.inverse.texture.varying import VaryingSigma
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Bool, Float

# The refinement on an expensive model ends when a step moves no search variable by more than this.
_SETTLED, _STEPS = 1e-4, 8
# Turns in which the thesis's weights follow the sigma and mu that they depend on.
_TURNS = 3


class LobeFit(NamedTuple):
    """Where a search ended: the search variables, the texture there, and what it predicts.

    ``cost`` is half of chi-squared, the prior's part included.
    """

    point: Float[Array, "unknown"]
    material: SiteMaterial
    predicted: Float[Array, "sample channel"]
    cost: Float[Array, ""]
    converged: Bool[Array, ""]


class FreeTextures(NamedTuple):
    """The texture without bounds or prior, the precision of each K_s, and what it predicts."""

    material: SiteMaterial
    precision: Float[Array, "site"]
    predicted: Float[Array, "sample channel"]


class TextureProblem(eqx.Module):
    """What is unknown of the lobe, the prior of K_s, and whether K_s is one for all sites."""

    unknowns: Unknowns | VaryingSigma
    prior: SpecularPrior
    shared: Bool[AnyArray, ""]

    def material(
        self, model: Model, data: SiteData, point: Float[Array, "unknown"]
    ) -> tuple[SiteMaterial, Columns]:
        """Solve for the texture at a point; returned with the columns there."""
        physical = self.unknowns.unpack(point)
        columns = model.columns(physical.numbers)
        return solve_sites(site_sums(data, columns), self.prior, self.shared), columns


def predicted(
    material: SiteMaterial, columns: Columns, data: SiteData
) -> Float[Array, "sample channel"]:
    """Predict the radiance of every observation (T 6.13)."""
    site = jnp.asarray(data.site)
    kd, ks = jnp.asarray(material.kd)[site], by_channel(jnp.asarray(material.ks)[site])
    return kd * columns.diffuse + ks * columns.specular


def residuals(
    point: Float[Array, "unknown"], problem: TextureProblem, model: Model, data: SiteData
) -> tuple[Float[Array, "residual"], tuple[SiteMaterial, Float[Array, "sample channel"]]]:
    """Weighted residuals with the texture eliminated, and what the prior holds against it.

    The texture comes second, with what it predicts.
    """
    material, columns = problem.material(model, data, point)
    radiance = predicted(material, columns, data)
    left = jnp.asarray(data.weights) * (data.radiance - radiance)
    precision = jnp.where(problem.shared, 0, jnp.asarray(problem.prior.precision))
    off = jnp.sqrt(precision) * (material.ks - problem.prior.mean)
    held = [problem.unknowns.steps(point)] if isinstance(problem.unknowns, VaryingSigma) else []
    return jnp.concatenate([left.ravel(), off, *held]), (material, radiance)


def search(
    problem: TextureProblem,
    model: Model,
    data: SiteData,
    starts: Float[AnyArray, "start unknown"],
    method: str = "variable-projection",
) -> LobeFit:
    """Search from every start and keep the best; ``method="simplex"`` is the thesis's."""
    # One after the other: one compiled program serves them all.
    found = [_search(problem, model, data, jnp.asarray(s), method) for s in starts]
    costs = np.array([float(fit.cost) for fit in found])
    return found[int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))]


def refine(problem: TextureProblem, model: Model, data: SiteData, start: LobeFit) -> LobeFit:
    """Continue on an expensive model, linearised anew at each step."""
    fit = start
    for _ in range(_STEPS):
        physical = problem.unknowns.unpack(fit.point)
        near = LinearisedModel.about(model, physical.numbers)
        before, fit = fit, search(problem, near, data, fit.point[None])
        if np.all(np.abs(np.asarray(fit.point) - np.asarray(before.point)) < _SETTLED):
            return fit
    return fit._replace(converged=jnp.zeros((), bool))


def first_phase(
    problem: TextureProblem,
    model: Model,
    data: SiteData,
    exit_cosines: Float[AnyArray, "sample"],
    starts: Float[AnyArray, "start unknown"],
) -> LobeFit:
    """Search as phase 1 of T 6.4.2 does: by simplex, one K_s, squared residuals times W_d."""
    shared = TextureProblem(problem.unknowns, problem.prior, np.asarray(True))
    point = jnp.asarray(starts[0])
    for turn in range(_TURNS):
        physical = problem.unknowns.unpack(point)
        trust = confidence(model.columns(physical.numbers), exit_cosines)
        weights = jnp.broadcast_to(jnp.sqrt(trust.diffuse)[:, None], data.radiance.shape)
        own = SiteData(data.radiance, weights, data.site, data.count)
        fit = search(shared, model, own, starts if turn == 0 else point[None], "simplex")
        point = fit.point
    return fit


@stored(effort="less")
def free_textures(
    unknowns: Unknowns | VaryingSigma,
    model: Model,
    data: SiteData,
    point: Float[Array, "unknown"],
) -> FreeTextures:
    """Solve for the texture without bounds or prior."""
    physical = unknowns.unpack(point)
    columns = model.columns(physical.numbers)
    free = solve_freely(site_sums(data, columns))
    return FreeTextures(free.material, free.precision, predicted(free.material, columns, data))


class LobeInformation(NamedTuple):
    """The inverse covariance of the search variables, the texture being unknown.

    ``scores`` are the part that each observation has in the slope of half chi-squared.
    """

    matrix: Float[Array, "unknown unknown"]
    scores: Float[Array, "sample unknown"]


@stored(effort="less")
def lobe_information(
    problem: TextureProblem, model: Model, data: SiteData, point: Float[Array, "unknown"]
) -> LobeInformation:
    """Compute what the observations tell of the search variables, and what each of them says."""
    with jax.default_matmul_precision("highest"):
        left, along, _ = jax.linearize(
            lambda p: residuals(p, problem, model, data), point, has_aux=True
        )
        jacobian = jax.vmap(along, out_axes=1)(jnp.eye(point.shape[0], dtype=point.dtype))
        count, channels = data.radiance.shape
        each = (left[:, None] * jacobian)[: count * channels]
        scores = jnp.sum(each.reshape(count, channels, -1), axis=1)
        return LobeInformation(jacobian.T @ jacobian, scores)


@stored(effort="less")
def _search(
    problem: TextureProblem,
    model: Model,
    data: SiteData,
    start: Float[Array, "unknown"],
    method: str,
) -> LobeFit:
    solver = {"variable-projection": least_squares, "simplex": simplex}[method]
    size = jnp.sqrt(jnp.sum((jnp.asarray(data.weights) * data.radiance) ** 2))

    def in_own_units(point: Float[Array, "unknown"], args):
        left, found = residuals(point, *args)
        return left / size, found

    with jax.default_matmul_precision("highest"):
        # In units of what is measured, as the solvers ask for.
        solution = solver(in_own_units, start, (problem, model, data), has_aux=True)
    material, radiance = solution.aux
    cost = solution.cost * size**2
    return LobeFit(solution.point, material, radiance, cost, solution.converged)
