"""Forward models behind the one interface that a search asks of them: columns of kd and ks."""

from typing import NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy, Parametric, normalised_fresnel
from jaxrender.geometry import SurfaceSamples
from jaxrender.lighting import LightNodes
from jaxrender.reflection import (
    DualLight,
    FrameNodes,
    RoughnessTable,
    Shadows,
    dual_columns,
    integral_columns,
    integral_columns_by_frame,
)
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int

# Which samples to keep: their indices, or every so many.
Rows = Int[np.ndarray, "kept"] | slice


class Columns(NamedTuple):
    """The columns of kd and ks."""

    diffuse: Float[Array, "sample channel"]
    specular: Float[Array, "sample channel"]


@runtime_checkable
class Model(Protocol):
    """What a fit asks of a forward model."""

    def columns(self, sigma: Float[Array, "*sample"], mu: Float[Array, ""] | None) -> Columns:
        """Evaluate the diffuse and the specular column for given sigma and mu.

        Some models take a sigma for each sample.
        """
        ...

    def take(self, index: Rows) -> "Model":
        """Keep the samples of the given indices."""
        ...


class TabulatedModel(eqx.Module):
    """The dual model through its table over roughness."""

    table: RoughnessTable

    def columns(self, sigma: Float[Array, ""], mu: Float[Array, ""] | None) -> Columns:
        """Look up the columns."""
        return Columns(jnp.asarray(self.table.diffuse), self.table.specular(sigma, mu))

    def take(self, index: Rows) -> "TabulatedModel":
        """Keep the samples of the given indices."""
        return TabulatedModel(self.table.take(index))


class DualModel(eqx.Module):
    """The dual model itself, shadows included: no table to make, slower to evaluate again."""

    variant: Glossy
    samples: SurfaceSamples
    light: DualLight
    shadows: Shadows | None = None
    transfer: str = eqx.field(static=True, default="exit-cosine")

    def columns(self, sigma: Float[Array, "*sample"], mu: Float[Array, ""] | None) -> Columns:
        """Evaluate T 6.9, or T 6.12; with the transfer ``facets`` for a sigma a sample, too."""
        mu = None if self.variant.mu is None else mu
        one, each = (sigma[0], sigma) if jnp.ndim(sigma) else (sigma, None)
        brdf = self.variant.with_roughness(one, mu)
        columns = dual_columns(
            brdf, self.samples, self.light, self.transfer, self.shadows, widths=each
        )
        return Columns(columns[:, 0], columns[:, 1])

    def take(self, index: Rows) -> "DualModel":
        """Keep the samples of the given indices."""
        light, shadows = self.light, self.shadows
        if light.frames is not None:
            light = light.for_frames(np.asarray(light.frames.frame_of_sample)[index])
        if shadows is not None:
            shadows = Shadows(*jax.tree.map(lambda part: np.asarray(part)[index], shadows))
        samples = SurfaceSamples(*(np.asarray(part)[index] for part in self.samples))
        return DualModel(self.variant, samples, light, shadows, self.transfer)


class ExactModel(eqx.Module):
    """The integral over the light's nodes, for the lobe of ``variant`` (whatever its numbers).

    ``seen`` tells for each part of the light which of its nodes every sample sees; None: all.
    """

    variant: Parametric
    samples: SurfaceSamples
    nodes: tuple[LightNodes | FrameNodes, ...]
    seen: tuple[Bool[AnyArray, "sample node"], ...] | None = None

    def columns(self, sigma: Float[Array, "*sample"], mu: Float[Array, ""] | None) -> Columns:
        """Integrate; a Fresnel ratio at the exit angle is a factor and stays outside the sum."""
        outside = self.variant.fresnel_is_factor
        lobe = self.variant.as_metal() if outside else self.variant
        one, each = (sigma[0], sigma) if jnp.ndim(sigma) else (sigma, None)
        columns = self._integrate(lobe.with_roughness(one, None if outside else mu), each)
        specular = columns[:, 1]
        if outside:
            specular = specular * normalised_fresnel(mu, self.samples.exit_cosines)[:, None]
        return Columns(columns[:, 0], specular)

    def take(self, index: Rows) -> "ExactModel":
        """Keep the samples of the given indices."""
        samples = SurfaceSamples(*(a[index] for a in self.samples))
        nodes = tuple(
            FrameNodes(part.directions, part.irradiance, part.frame_of_sample[index])
            if isinstance(part, FrameNodes)
            else part
            for part in self.nodes
        )
        seen = None if self.seen is None else tuple(part[index] for part in self.seen)
        return ExactModel(self.variant, samples, nodes, seen)

    def _integrate(
        self, lobe: Parametric, widths: Float[Array, "sample"] | None
    ) -> Float[Array, "sample 2 channel"]:
        """Sum over the lights that all photographs share and over those of each frame."""
        parts = [
            integral_columns_by_frame(lobe, self.samples, part, seen, widths=widths)
            if isinstance(part, FrameNodes)
            else integral_columns(lobe, self.samples, part, seen, widths=widths)
            for part, seen in zip(self.nodes, self.seen or [None] * len(self.nodes))
        ]
        return jnp.sum(jnp.stack(parts), axis=0)


class MatteModel(eqx.Module):
    """A model whose lobe is dark: paint without gloss."""

    model: Model

    def columns(self, sigma: Float[Array, "*sample"], mu: Float[Array, ""] | None) -> Columns:
        """Evaluate the diffuse column alone."""
        diffuse = self.model.columns(sigma, mu).diffuse
        return Columns(diffuse, jnp.zeros_like(diffuse))

    def take(self, index: Rows) -> "MatteModel":
        """Keep the samples of the given indices."""
        return MatteModel(self.model.take(index))


class LinearisedModel(eqx.Module):
    """Any model to first order about one roughness and index: what error bars are made of.

    The roughness may be one for each sample, where the model takes that.
    """

    diffuse: Float[Array, "sample channel"]
    specular: Float[Array, "sample channel"]
    by_sigma: Float[Array, "sample channel"]
    by_mu: Float[Array, "sample channel"]
    sigma: Float[Array, "*sample"]
    mu: Float[Array, ""]

    @classmethod
    def about(
        cls, model: Model, sigma: Float[Array, "*sample"], mu: Float[Array, ""] | None
    ) -> "LinearisedModel":
        """Evaluate a model and its derivatives once."""
        return _linearise(model, sigma, mu)

    def columns(self, sigma: Float[Array, "*sample"], mu: Float[Array, ""] | None) -> Columns:
        """Extrapolate the columns linearly."""
        wider = sigma - self.sigma
        specular = self.specular + self.by_sigma * (wider[:, None] if jnp.ndim(wider) else wider)
        if mu is not None:
            specular = specular + self.by_mu * (mu - self.mu)
        return Columns(self.diffuse, specular)

    def take(self, index: Rows) -> "LinearisedModel":
        """Keep the samples of the given indices."""
        sigma = self.sigma[index] if jnp.ndim(self.sigma) else self.sigma
        return LinearisedModel(
            self.diffuse[index],
            self.specular[index],
            self.by_sigma[index],
            self.by_mu[index],
            sigma,
            self.mu,
        )


@eqx.filter_jit
def _linearise(
    model: Model, sigma: Float[Array, "*sample"], mu: Float[Array, ""] | None
) -> LinearisedModel:
    one = jnp.ones_like(sigma)
    if mu is not None and isinstance(model, ExactModel) and not jnp.ndim(sigma):
        # Both derivatives in one pass over the nodes, which each alone would make again.
        def specular_at(at: Float[Array, "2"]) -> tuple[Float[Array, "sample channel"], Columns]:
            columns = model.columns(at[0], at[1])
            return columns.specular, columns

        slopes, (diffuse, specular) = jax.jacfwd(specular_at, has_aux=True)(jnp.stack([sigma, mu]))
        return LinearisedModel(diffuse, specular, slopes[..., 0], slopes[..., 1], sigma, mu)
    (diffuse, specular), (_, by_sigma) = jax.jvp(lambda s: model.columns(s, mu), (sigma,), (one,))
    if mu is None:
        zero = jnp.zeros_like(specular)
        return LinearisedModel(diffuse, specular, by_sigma, zero, sigma, jnp.ones((), sigma.dtype))
    _, (_, by_mu) = jax.jvp(lambda m: model.columns(sigma, m), (mu,), (jnp.ones_like(mu),))
    return LinearisedModel(diffuse, specular, by_sigma, by_mu, sigma, mu)
