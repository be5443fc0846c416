"""The dual model as a table over roughness: what a solver evaluates in a fraction of a millisecond.

For given samples and light the specular column of T 6.9 is a smooth function of log sigma (and,
with the Fresnel ratio at the half angle, of log(mu - 1)).  It is evaluated once by the dual model's
own parts: at equally spaced knots of sigma, which cubic B-splines join, and at a few Chebyshev
nodes of mu, which a polynomial does.  So value and derivative cost four rows of the table for each
node of mu, whatever the number of sources or degrees.
:func:`jaxrender.reflection.dual.dual_columns` is the slow twin.  With ``Shadows`` it is T 6.12.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.brdf import INDEX_BOUNDS, Glossy, normalised_fresnel
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import degree_table
from jaxrender.lighting import LightNodes
from jaxrender.programs import stored
from jaxrender.reflection.dual import SOURCES_AT_ONCE, DualLight, Shadows, filled_up
from jaxrender.reflection.integral import (
    FrameNodes,
    integral_columns,
    integral_columns_by_frame,
)
from jaxrender.reflection.irradiance import irradiance
from jaxrender.reflection.knots import ChebyshevNodes, KnotRange
from jaxrender.reflection.shrm import ViewFilter, mirror_light, reflect_mirror_light
from jaxrender.reflection.transfer import shadowed_irradiance
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int, as_jax, checked
from jaxrender.spectra import transfer_of_samples

# Knots of every table over log sigma: one number, so that few shapes are ever compiled.  Over a
# factor of 1.8 to either side the step is .07, and a cubic spline good to 1e-4 of the lobe's peak.
_SIGMA_KNOTS = 16
# The ratio of half-angle to exit-angle Fresnel is far smoother in log(mu - 1): over all indices the
# polynomial is good to 1.3e-4 of it at the worst angle, and to 1e-5 at most angles.
_MU_NODES = 12

_ONE_NODE = ChebyshevNodes.over(0.0, 0.0, 1)


class RoughnessTable(eqx.Module):
    """The dual model's columns for fixed samples and light, as functions of sigma and mu.

    ``log_scale`` is how large the specular column is at each node of mu; ``spline`` is over that.
    A lobe with Fresnel's factor itself loses four decades from an index of 6 to one of 1.02, which
    no polynomial would follow.
    """

    diffuse: Float[AnyArray, "sample channel"]
    spline: Float[AnyArray, "mu_node sigma_knot sample channel"]
    log_scale: Float[AnyArray, "mu_node"]
    exit_cosines: Float[AnyArray, "sample"]
    log_sigma: KnotRange
    log_mu: ChebyshevNodes

    @checked
    def specular(
        self, sigma: Float[Array, ""], mu: Float[Array, ""] | None
    ) -> Float[Array, "sample channel"]:
        """Look up the column of ks; differentiable in sigma and mu."""
        first, weights = self.log_sigma.locate(jnp.log(sigma))
        mu_weights = jnp.ones(1, weights.dtype)
        if mu is not None:
            mu_weights = self.log_mu.weights(jnp.log(mu - 1))
        mu_weights = mu_weights * jnp.exp(mu_weights @ jnp.asarray(self.log_scale))
        size = (self.log_mu.count, 4, *self.spline.shape[2:])
        zero = jnp.zeros((), int)
        rows = jax.lax.dynamic_slice(self.spline, (zero, first, zero, zero), size)
        both = (mu_weights[:, None] * weights[None, :]).ravel()
        rows = rows.reshape(-1, *rows.shape[2:])
        # Written out, so that it is one pass over the rows together with what follows.
        column = sum(both[k] * rows[k] for k in range(both.shape[0]))
        return column * normalised_fresnel(mu, self.exit_cosines)[:, None]

    @checked
    def take(self, index: Int[np.ndarray, "kept"] | slice) -> "RoughnessTable":
        """Keep the samples of the given indices."""
        parts = (self.diffuse, self.spline, self.exit_cosines)
        if any(isinstance(part, Tracer) for part in parts):
            kept = jnp.asarray
        else:
            # On the host: every number of samples would be some more programs to compile.
            parts, kept = [np.asarray(part) for part in parts], as_jax
        diffuse, spline, exit_cosines = parts
        return RoughnessTable(
            kept(diffuse[index]),
            kept(spline[:, :, index]),
            self.log_scale,
            kept(exit_cosines[index]),
            self.log_sigma,
            self.log_mu,
        )


@checked
def roughness_table(
    brdf: Glossy,
    samples: SurfaceSamples,
    light: DualLight,
    sigma_range: tuple[float, float],
    mu_range: tuple[float, float] = INDEX_BOUNDS,
    transfer: str = "exit-cosine",
    shadows: Shadows | None = None,
) -> RoughnessTable:
    """Tabulate the dual model over a range of sigma (and of mu, where the lobe depends on it).

    A range of mu from one number to the same is of that alone.  Of ``brdf`` only the variant
    counts: metal or dielectric, Fresnel angle, masking, distribution.
    """
    log_sigma = KnotRange.over(np.log(sigma_range[0]), np.log(sigma_range[1]), _SIGMA_KNOTS)
    exit_cosines = jnp.asarray(samples.exit_cosines)
    samples = SurfaceSamples(jnp.asarray(samples.normals), jnp.asarray(samples.outgoing))
    dtype = jnp.result_type(samples.normals)
    light, shadows = filled_up(light, shadows)
    light = jax.tree.map(lambda x: _cast(x, dtype), light)
    shadows = None if shadows is None else _ready(shadows, dtype)
    half = not brdf.fresnel_is_factor
    low, high = np.log(np.asarray(mu_range) - 1).tolist()
    log_mu = ChebyshevNodes.over(low, high, _MU_NODES) if half else _ONE_NODE
    # A Fresnel ratio at the exit angle is a factor of the column, so it stays out of the table.
    variant = brdf if half else brdf.as_metal()
    sigmas = np.exp(log_sigma.values()).astype(dtype)
    mus = (1 + np.exp(log_mu.values())).astype(dtype)
    knots = _Knots(mus, sigmas)
    with jax.default_matmul_precision("highest"):
        columns = _tabulate_slow(variant, samples, light.slow, knots, shadows, transfer)
        for nodes, seen in _blocks(light, shadows):
            columns = _tabulate_fast(variant, samples, nodes, knots, seen, columns)
        scale = jnp.sqrt(jnp.mean(columns.specular**2, axis=(1, 2, 3)))
        # Nothing is lit: any scale will do.
        scale = jnp.where(scale > 0, scale, 1)
        spline = jnp.einsum(
            "bk,mksc,m->mbsc",
            jnp.asarray(log_sigma.spline_from_values(), dtype),
            columns.specular,
            1 / scale,
        )
    return RoughnessTable(columns.diffuse, spline, jnp.log(scale), exit_cosines, log_sigma, log_mu)


class _Knots(NamedTuple):
    """Where the specular column is evaluated."""

    mus: Float[AnyArray, "mu_node"]
    sigmas: Float[AnyArray, "sigma_knot"]


class _Columns(NamedTuple):
    """The diffuse column, and the specular one over exit-angle Fresnel at each knot."""

    diffuse: Float[Array, "sample channel"]
    specular: Float[Array, "mu_node sigma_knot sample channel"]


@stored(partial(jax.jit, static_argnames="transfer"), effort="less")
def _tabulate_slow(
    variant: Glossy,
    samples: SurfaceSamples,
    slow: Float[AnyArray, "coefficient channel"],
    knots: _Knots,
    shadows: Shadows | None,
    transfer: str,
) -> _Columns:
    """Evaluate slow light."""
    view = ViewFilter.named(transfer)
    if view is None:
        seen = degree_table(jnp.asarray(slow), samples.reflected)
    else:
        seen = mirror_light(samples, slow, view.degree)
    if shadows is None:
        diffuse = irradiance(jnp.asarray(slow), samples.normals)
    else:
        seen = jnp.where(shadows.reflected.reshape(-1, *(1,) * (seen.ndim - 1)), seen, 0)
        diffuse = shadowed_irradiance(jnp.asarray(slow), shadows.transfer)

    def at(sigma: Float[Array, ""], mu: Float[Array, ""]) -> Float[Array, "sample channel"]:
        brdf = _at_knot(variant, sigma, mu)
        if view is not None:
            return reflect_mirror_light(brdf, samples.exit_cosines, seen, view)
        passed = transfer_of_samples(brdf, samples.exit_cosines, seen.shape[1] - 1, transfer)
        return jnp.einsum("sl,slc->sc", passed, seen, precision="highest")

    # What is passed on at all knots at once would be gigabytes.
    specular = jax.lax.map(_at_all_mu(at, variant, samples, knots), knots.sigmas)
    return _Columns(diffuse, jnp.swapaxes(specular, 0, 1))


@stored(effort="less")
def _tabulate_fast(
    variant: Glossy,
    samples: SurfaceSamples,
    nodes: LightNodes | FrameNodes,
    knots: _Knots,
    seen: Bool[AnyArray, "sample node"] | None,
    before: _Columns,
) -> _Columns:
    """Evaluate directional sources, added to what there was before."""

    def columns(sigma: Float[Array, ""], mu: Float[Array, ""]) -> Float[Array, "sample 2 channel"]:
        brdf = _at_knot(variant, sigma, mu)
        if isinstance(nodes, FrameNodes):
            return integral_columns_by_frame(brdf, samples, nodes, seen)
        return integral_columns(brdf, samples, nodes, seen)

    def at(sigma: Float[Array, ""], mu: Float[Array, ""]) -> Float[Array, "sample channel"]:
        return columns(sigma, mu)[:, 1]

    diffuse = columns(knots.sigmas[0], knots.mus[0])[:, 0]
    specular = jax.vmap(_at_all_mu(at, variant, samples, knots))(jnp.asarray(knots.sigmas))
    return _Columns(before.diffuse + diffuse, before.specular + jnp.swapaxes(specular, 0, 1))


def _at_all_mu(
    column: Callable[[Float[Array, ""], Float[Array, ""]], Float[Array, "sample channel"]],
    variant: Glossy,
    samples: SurfaceSamples,
    knots: _Knots,
) -> Callable[[Float[Array, ""]], Float[Array, "mu_node sample channel"]]:
    """Evaluate a column of a sigma at every mu, over exit-angle Fresnel.

    They go together, as all but the Fresnel ratio is the same for them.
    """

    def at(sigma: Float[Array, ""]) -> Float[Array, "mu_node sample channel"]:
        def over_fresnel(mu: Float[Array, ""]) -> Float[Array, "sample channel"]:
            return column(sigma, mu) / _relative_fresnel(variant, samples, mu)

        return jax.vmap(over_fresnel)(jnp.asarray(knots.mus))

    return at


def _at_knot(variant: Glossy, sigma: Float[Array, ""], mu: Float[Array, ""]) -> Glossy:
    return variant.with_roughness(sigma, None if variant.mu is None else mu)


def _relative_fresnel(
    variant: Glossy, samples: SurfaceSamples, mu: Float[Array, ""]
) -> Float[Array, "sample 1"]:
    return normalised_fresnel(None if variant.mu is None else mu, samples.exit_cosines)[:, None]


def _blocks(
    light: DualLight, shadows: Shadows | None
) -> Iterator[tuple[LightNodes | FrameNodes, Bool[AnyArray, "sample node"] | None]]:
    """Go through all sources, so many at once that one shape is compiled for any number of them."""
    nodes = light.sources.nodes()
    count = nodes.directions.shape[0]
    for first in range(0, count, SOURCES_AT_ONCE):
        some = slice(first, first + SOURCES_AT_ONCE)
        # A slice would be a program to compile; of one block none is needed.
        one = count <= SOURCES_AT_ONCE
        block = nodes if one else LightNodes(nodes.directions[some], nodes.irradiance[some])
        yield block, None if shadows is None else shadows.sources[:, some]
    if light.frames is not None:
        yield light.frames, None if shadows is None else shadows.frame_sources


def _ready(shadows: Shadows, dtype) -> Shadows:
    """Cast what is to be multiplied."""
    by_frame = shadows.frame_sources
    return Shadows(
        jnp.asarray(shadows.transfer, dtype),
        jnp.asarray(shadows.reflected).astype(bool),
        jnp.asarray(shadows.sources).astype(bool),
        None if by_frame is None else jnp.asarray(by_frame).astype(bool),
    )


def _cast(x: AnyArray, dtype) -> Array:
    x = jnp.asarray(x)
    return x.astype(dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x
