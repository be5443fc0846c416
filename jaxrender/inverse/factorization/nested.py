"""The thesis's own factorization: a simplex over K_s and mu around inverse lighting (T 6.4.4).

For every guess of the material the light is the least-squares solution of T 6.15 or 6.16 with F
alone, l* = 12.  The guess is judged by the root mean square of what is left; K_d + K_s = 1.  Each
channel is fitted by itself and has its own K_s and mu, so that the simplex has two unknowns.
Roughness plays no part here: it follows from a source in the recovered light (``roughness``).

``factor_gram`` works on binned sums, so a guess costs the same for any number of pixels.  Its twin
``factor_samples`` forms every row again for every guess.  The light found is the true light as the
lobe filters it, cut at l*.  It is the same for the specular part, the diffuse part and every exit
angle.  Light of a directional source is not, which biases K_s and mu by tens of per cent.
``factorize`` has no such bias.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import INDEX_BOUNDS, Microfacet, normalised_fresnel
from jaxrender.inverse.factorization.gauges import GAUGES, gauge_factors
from jaxrender.inverse.factorization.gram import BinnedGram
from jaxrender.inverse.factorization.roughness import (
    Filter,
    Region,
    SourceRoughness,
    roughness_from_source,
)
from jaxrender.inverse.solvers import Solution, simplex
from jaxrender.shapes import AnyArray, Array, Float

# l* of T 6.15: of the order of 1 / sigma of most materials.
BAND_LIMIT = 12
# The simplex's residual is the relative root mean square in per cent, a number of order one.
_RESIDUAL_UNIT = 100.0
# Light that the photographs do not determine is held at 0 by this part of the information.
_RIDGE = 1e-12


class Start(NamedTuple):
    """Where the search begins; ``mu=None`` for metals, F = 1."""

    share: float = 0.3
    mu: float | None = 1.5


DEFAULT_START = Start()


class Inner(NamedTuple):
    """The light of one channel for a guess of the material, and sum r^2 / sum B^2."""

    light: Float[Array, "coefficient"]
    left: Float[Array, ""]


class Nested(NamedTuple):
    """Material and filtered light in a gauge of ``GAUGES``; ``mu`` is None for a metal.

    ``relative_rms`` is sqrt(sum r^2 / sum B^2), weighted as the samples were; ``steps`` those of
    the simplex, all channels together.
    """

    kd: Float[np.ndarray, "channel"]
    ks: Float[np.ndarray, "channel"]
    mu: Float[np.ndarray, "channel"] | None
    light: Float[np.ndarray, "coefficient channel"]
    relative_rms: Float[np.ndarray, "channel"]
    steps: int
    converged: bool
    gauge: str

    def roughness(
        self, region: Region | None = None, filtered_by: Filter | None = None
    ) -> SourceRoughness:
        """Measure sigma by a source in the light; ``ValueError`` where there is none."""
        return roughness_from_source(self.light, region, filtered_by)

    def brdf(self, sigma: float) -> Microfacet:
        """Make the material, the roughness being known; of mu the channels' mean."""
        mu = None if self.mu is None else float(np.mean(self.mu))
        return Microfacet(self.kd, self.ks, sigma, mu)


class Rows(NamedTuple):
    """All samples at once, for the twin: Y~_lm(x), V(R) Y_lm(R), exit cosines, B and weights."""

    diffuse: Float[AnyArray, "sample coefficient"]
    mirrored: Float[AnyArray, "sample coefficient"]
    exit_cosines: Float[AnyArray, "sample"]
    radiance: Float[AnyArray, "sample channel"]
    weights: Float[AnyArray, "sample channel"]


def factor_gram(
    gram: BinnedGram, start: Start = DEFAULT_START, gauge: str = "per-channel"
) -> Nested:
    """Find K_s, mu and the light from binned sums.

    Raises ``ValueError`` for a start out of range, another gauge, or sums without energy.
    """
    channels = (gram.of_channel(c) for c in range(gram.moments.shape[2]))
    arrays = (jax.tree.map(jnp.asarray, channel) for channel in channels)
    return _factor(light_of_gram, list(arrays), start, gauge)


def factor_samples(rows: Rows, start: Start = DEFAULT_START, gauge: str = "per-channel") -> Nested:
    """Find the same from the samples themselves: the readable twin."""
    geometry, (radiance, weights) = rows[:3], map(np.asarray, rows[3:])
    channels = [
        Rows(*map(jnp.asarray, (*geometry, radiance[:, [c]], weights[:, [c]])))
        for c in range(radiance.shape[1])
    ]
    return _factor(light_of_samples, channels, start, gauge)


def light_of_gram(gram: BinnedGram, share: Float[Array, ""], mu: Float[Array, ""] | None) -> Inner:
    """Solve for one channel's light; the cost does not depend on the number of samples."""
    fresnel = normalised_fresnel(mu, jnp.asarray(gram.nodes))
    passed = jnp.broadcast_to(fresnel[:, None], (len(fresnel), gram.band_limit + 1))
    sums, moment, energy, _ = gram.equations(passed, (1 - share)[None], share[None])
    ridge = _RIDGE * jnp.trace(sums[0]) * jnp.eye(moment.shape[1], dtype=moment.dtype)
    factor = jnp.linalg.cholesky(sums[0] + ridge)
    light = jax.scipy.linalg.cho_solve((factor, True), moment[0])
    return Inner(light, jnp.maximum(1 - moment[0] @ light / energy[0], 0))


def light_of_samples(rows: Rows, share: Float[Array, ""], mu: Float[Array, ""] | None) -> Inner:
    """Solve for one channel's light by the weighted rows of every sample (T 6.15)."""
    fresnel = normalised_fresnel(mu, rows.exit_cosines)[:, None]
    weights, measured = rows.weights, (rows.weights * rows.radiance)[:, 0]
    columns = weights * ((1 - share) * rows.diffuse + share * fresnel * rows.mirrored)
    light = jnp.linalg.lstsq(columns, measured)[0]
    return Inner(light, jnp.sum((measured - columns @ light) ** 2) / jnp.sum(measured**2))


def _factor(inner: Callable, channels: list, start: Start, gauge: str) -> Nested:
    if gauge not in GAUGES:
        raise ValueError(f"gauge={gauge!r}: choose one of {', '.join(GAUGES)}")
    share, mu = start
    if not 0 < share < 1 or not (mu is None or INDEX_BOUNDS[0] < mu < INDEX_BOUNDS[1]):
        raise ValueError(
            f"start {start}: give 0 < share < 1, and mu within {INDEX_BOUNDS}, or None for a metal"
        )
    point = [np.log(share / (1 - share))] + ([] if mu is None else [np.log(mu - 1)])
    found = [_search(inner, channel, jnp.asarray(point)) for channel in channels]
    judged = [_judged(inner, channel, one.point) for channel, one in zip(channels, found)]
    light = np.stack([np.asarray(one.light) for one in judged], axis=1)
    if not np.all(np.isfinite(light)):
        raise ValueError("the light has no solution: give samples with radiance above 0")
    materials = [_material(one.point) for one in found]
    shares = np.array([float(share) for share, _ in materials])
    indices = [float(index) for _, index in materials if index is not None]
    factor = gauge_factors(shares, light[0], gauge)
    return Nested(
        (1 - shares) * factor,
        shares * factor,
        np.array(indices) if indices else None,
        light / factor,
        np.sqrt([float(one.left) for one in judged]),
        sum(int(one.steps) for one in found),
        all(bool(one.converged) for one in found),
        gauge,
    )


@eqx.filter_jit
def _search(inner: Callable, data, start: Float[Array, "unknown"]) -> Solution:
    def residuals(point, data):
        left = inner(data, *_material(point)).left
        # Where rounding spoils the factorization of the normal matrix, the guess is a bad one.
        return _RESIDUAL_UNIT * jnp.sqrt(jnp.where(jnp.isfinite(left), left, 1))[None]

    return simplex(residuals, start, data)


@eqx.filter_jit
def _judged(inner: Callable, data, point: Float[Array, "unknown"]) -> Inner:
    return inner(data, *_material(point))


def _material(point: Float[Array, "unknown"]) -> tuple[Float[Array, ""], Float[Array, ""] | None]:
    """Read a point of the search: K_s, and mu where there are two unknowns."""
    low, high = INDEX_BOUNDS
    mu = None if len(point) == 1 else jnp.clip(1 + jnp.exp(point[1]), low, high)
    return jax.nn.sigmoid(point[0]), mu
