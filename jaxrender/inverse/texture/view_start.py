"""Where the search for light, K_s and roughness begins: one K_s for all sites, then in turn."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics import degrees
from jaxrender.inverse.models import Columns
from jaxrender.inverse.solvers import least_squares
from jaxrender.inverse.texture.harmonic_columns import HarmonicColumns, LobeColumns, diffuse_under
from jaxrender.inverse.texture.measurements import SiteData
from jaxrender.inverse.texture.site_sums import SiteMaterial, SiteSums, site_sums
from jaxrender.inverse.texture.site_systems import (
    SpecularPrior,
    site_errors,
    solve_freely,
    solve_sites,
)
from jaxrender.inverse.texture.specular_prior import spread_of
from jaxrender.inverse.texture.view_dependent import off_site_mean, solve_view_dependent
from jaxrender.inverse.texture.view_search import State
from jaxrender.shapes import AnyArray, Array, Float

# Light and K_s(x) in turn.
_TURNS = 4


class Guess(NamedTuple):
    """Where a search begins: light and K_s, K_d in units of the mean K_s, and that mean."""

    state: State
    kd: Float[np.ndarray, "site channel"]
    mean: float


class SpreadSolution(NamedTuple):
    """The material of sites with its standard errors, and the spread that K_s shows."""

    material: SiteMaterial
    errors: SiteMaterial
    prior: SpecularPrior


@eqx.filter_jit
def with_one_ks(
    columns_at: HarmonicColumns, data: SiteData, start: Float[AnyArray, "unknown"]
) -> Float[Array, "unknown"]:
    """Search sigma and mu with light and diffuse constants eliminated, one K_s for all sites.

    K_s varies, so that this is but where to begin.
    """
    degree = jnp.asarray(degrees(columns_at.band_limit), jnp.asarray(data.radiance).dtype)

    def residuals(point: Float[Array, "unknown"], data: SiteData) -> Float[Array, "residual"]:
        columns = columns_at(point).specular
        weights, radiance = jnp.asarray(data.weights), jnp.asarray(data.radiance)

        def of_channel(inputs: tuple) -> Float[Array, "sample"]:
            weight, values = inputs
            matrix = weight[:, None] * off_site_mean(columns, weight, data)
            right = weight * off_site_mean(values[:, None], weight, data)[:, 0]
            gram = matrix.T @ matrix
            ridge = 1e-7 * jnp.trace(gram) / gram.shape[0] * jnp.diag(degree**2 + 1e-3)
            light = jax.scipy.linalg.solve(gram + ridge, matrix.T @ right, assume_a="pos")
            return right - matrix @ light

        left = jax.lax.map(of_channel, (weights.T, radiance.T)).ravel()
        return left / jnp.sqrt(jnp.sum((weights * radiance) ** 2))

    with jax.default_matmul_precision("highest"):
        return least_squares(residuals, jnp.asarray(start), data).point


def in_turn(data: SiteData, columns: LobeColumns, point: Float[np.ndarray, "unknown"]) -> Guess:
    """Find light and texture in turn at one sigma and mu."""
    kd, ks = np.zeros((data.count, data.radiance.shape[1])), np.ones(data.count)
    for _ in range(_TURNS):
        light = solve_view_dependent(columns, data, SiteMaterial(kd, ks)).coefficients
        guess = guess_sites(data, columns, State(point, light, ks))
        kd, ks = guess.kd, guess.state.ks
    return guess


def guess_sites(data: SiteData, columns: LobeColumns, state: State) -> Guess:
    """Solve the sites under a light."""
    light = jnp.asarray(state.light)
    lit = Columns(diffuse_under(columns.diffuse, light), columns.specular @ light)
    found = solve_with_spread([site_sums(data, lit)])
    material, mean = found.material, _mean_of(found.prior)
    ks = np.where(material.ks > 0, material.ks / mean, 1)
    state = State(state.point, state.light * mean, ks)
    return Guess(state, np.asarray(material.kd) / mean, mean)


def solve_with_spread(parts: list[SiteSums]) -> SpreadSolution:
    """Solve sites, their K_s held together by the spread that they show."""
    sums = SiteSums(*(jnp.concatenate(each) for each in zip(*parts)))
    free, precision = solve_freely(sums)
    prior = spread_of(np.asarray(free.ks), np.asarray(precision))
    material, errors = solve_sites(sums, prior), site_errors(sums, prior)
    material, errors = (SiteMaterial(*map(np.asarray, part)) for part in (material, errors))
    return SpreadSolution(material, errors, prior)


def _mean_of(prior: SpecularPrior) -> float:
    """Look the mean K_s over the sites up; ``ValueError`` where there is no specular lobe."""
    if not (prior.precision > 0 and prior.mean > 0):
        raise ValueError(
            "no site's radiance changes with the view as a specular lobe would: the object is "
            "diffuse, or its photographs are from one side; treat it as diffuse"
        )
    return float(prior.mean)
