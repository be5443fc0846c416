"""Light from what moves with the view, linear in it once K_s(x), sigma and mu are given."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics import band_limit_of, degrees
from jaxrender.inverse.texture.harmonic_columns import LobeColumns
from jaxrender.inverse.texture.measurements import SiteData
from jaxrender.inverse.texture.site_sums import SiteMaterial, over_sites
from jaxrender.shapes import Array, Float

# Rounds of the light's expected size.
_SIZES = 3


class LightCoefficients(NamedTuple):
    """A recovered light; standard errors are None where they are not known."""

    coefficients: Float[np.ndarray, "coefficient channel"]
    standard_error: Float[np.ndarray, "coefficient channel"] | None


def solve_view_dependent(
    columns: LobeColumns, data: SiteData, guess: SiteMaterial
) -> LightCoefficients:
    """Solve for K_s L_lm with every site's diffuse constant eliminated; with standard errors.

    ``guess`` is the texture in units of the mean K_s, as far as it is known.  Its K_d counts only
    where the surface turns within a site, so that E(n) is no constant there.  Zeros do to begin
    with.
    Coefficients of degree l are expected to be about s / l, where s is learned from the data;
    degree 0 is left free.
    """
    sums = _normal_equations(columns, data, SiteMaterial(*map(jnp.asarray, guess)))
    gram, moment, squares = (np.asarray(a) for a in sums)
    count = gram.shape[1]
    freedom = len(data.site) - len(np.unique(data.site)) - count
    degree = degrees(band_limit_of(count))
    found, errors = [], []
    for channel in range(len(gram)):
        penalty = np.zeros(count)
        for _ in range(_SIZES):
            system = gram[channel] + np.diag(penalty)
            system += 1e-12 * np.trace(system) / count * np.eye(count)
            light = np.linalg.solve(system, moment[channel])
            size = np.mean(((degree * light)[1:]) ** 2)
            penalty = np.where(degree > 0, degree**2 / max(size, 1e-300), 0)
        left = squares[channel] - 2 * light @ moment[channel] + light @ gram[channel] @ light
        scatter = max(left / max(freedom, 1), 1.0)
        found.append(light)
        errors.append(np.sqrt(scatter * np.diag(np.linalg.inv(system))))
    return LightCoefficients(np.stack(found, axis=1), np.stack(errors, axis=1))


@jax.jit
def _normal_equations(
    columns: LobeColumns, data: SiteData, guess: SiteMaterial
) -> tuple[
    Float[Array, "channel coefficient coefficient"],
    Float[Array, "channel coefficient"],
    Float[Array, "channel"],
]:
    """Add up each channel's equations with the sites' weighted means off."""
    weights, radiance = jnp.asarray(data.weights), jnp.asarray(data.radiance)
    site = jnp.asarray(data.site)
    specular = jnp.asarray(guess.ks)[site][:, None] * columns.specular

    def of_channel(inputs: tuple) -> tuple:
        weight, values, kd = inputs
        mixed = specular + kd[site][:, None] * columns.diffuse
        matrix = weight[:, None] * off_site_mean(mixed, weight, data)
        right = weight * off_site_mean(values[:, None], weight, data)[:, 0]
        with jax.default_matmul_precision("highest"):
            return matrix.T @ matrix, matrix.T @ right, jnp.sum(right**2)

    return jax.lax.map(of_channel, (weights.T, radiance.T, jnp.asarray(guess.kd).T))


def off_site_mean(
    values: Float[Array, "sample k"], weight: Float[Array, "sample"], data: SiteData
) -> Float[Array, "sample k"]:
    """Project the constants of every site out."""
    square = weight[:, None] ** 2
    total = over_sites(square, data)
    mean = over_sites(square * values, data) / jnp.where(total > 0, total, 1)
    return values - mean[jnp.asarray(data.site)]
