"""Radiance as a function of unknown light and unknown material (T 6.9, 6.12), linear in the light.

B_ic = sum_k x_kc [ (1 - g_c) D_ik + g_c S_ik(sigma, mu, directions) ]

The light x is slow coefficients followed by the energies of directional sources.  D and S are the
responses of the samples to each of them, by a white diffuse and a white specular lobe.  In each
channel only the product of light and reflectance shows.  So kd + ks = 1 there, and the specular
share g = ks is all that is left of both (T 6.4.4).

``MirrorResponse`` is the frequency view of a glossy material.  For a material without such a view
``integral_response.IntegralResponse`` sums the integral itself.
"""

import abc
import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy, Parametric
from jaxrender.geometry import (
    Components,
    SurfaceSamples,
    meridian_frames,
    pair_in_frame,
)
from jaxrender.harmonics import band_limit_of, degrees, real_basis
from jaxrender.inverse.factorization.source_nodes import POINTS, SHARES, nodes_of
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int, as_jax
from jaxrender.spectra import lambertian_transfer, transfer_of_samples


class Guess(NamedTuple):
    """The nonlinear unknowns in the variables of the search; ``mu`` is unused for a metal.

    ``specular_logit`` is log(ks / kd) of each channel, ``sigma`` log sigma, ``mu`` log(mu - 1).
    ``variance`` is that of each source along either axis (``source_nodes``); None: all are points.
    """

    specular_logit: Float[AnyArray, "channel"]
    sigma: Float[AnyArray, ""]
    mu: Float[AnyArray, ""]
    directions: Float[AnyArray, "source 3"]
    variance: Float[AnyArray, "source"] | None = None

    def by_source(
        self, columns: Callable[[Float[Array, "direction 3"]], Float[Array, "sample direction"]]
    ) -> Float[Array, "sample source"]:
        """Evaluate ``columns`` towards each source, or add up what all of its points send."""
        if self.variance is None:
            return columns(jnp.asarray(self.directions))
        nodes = nodes_of(self.directions, self.variance).reshape(-1, POINTS, 3)
        # One point of every source after the other: all of them at once do not fit into its cache.
        each = jax.lax.map(columns, jnp.moveaxis(nodes, 1, 0))
        return jnp.tensordot(jnp.asarray(SHARES, each.dtype), each, axes=1)


class Columns(NamedTuple):
    """How each sample responds to each part of the light: slow coefficients, then sources."""

    diffuse: Float[Array, "sample part"]
    specular: Float[Array, "sample part"]


def lobe_of(variant: Parametric, sigma: Float[AnyArray, ""], mu: Float[AnyArray, ""]) -> Parametric:
    """Make the material of amplitude one; ``sigma`` and ``mu`` are those of a ``Guess``."""
    index = None if variant.mu is None else 1 + jnp.exp(jnp.asarray(mu))
    return variant.with_roughness(jnp.exp(jnp.asarray(sigma)), index)


def by_degree(
    passed: Float[Array, "sample degree"], basis: Float[AnyArray, "sample coefficient"]
) -> Float[Array, "sample coefficient"]:
    """Weigh every harmonic by what is passed on of its degree."""
    return passed[:, degrees(passed.shape[1] - 1)] * jnp.asarray(basis)


class Response(eqx.Module):
    """Samples of a surface under slow light of a given band limit and directional sources.

    ``diffuse_basis`` is how the samples respond to slow light by the material's base, ``lit`` which
    source each sample sees.  Of ``variant`` only the kind counts: its model, and of a microfacet
    whether it is a metal, Fresnel angle, masking, distribution.
    """

    variant: eqx.AbstractVar[Parametric]
    samples: eqx.AbstractVar[SurfaceSamples]
    diffuse_basis: eqx.AbstractVar[Float[AnyArray, "sample coefficient"]]
    lit: eqx.AbstractVar[Float[AnyArray, "sample source"]]

    @abc.abstractmethod
    def passed(self, guess: Guess) -> Float[Array, "sample term"]:
        """Evaluate what the lobe passes on of each term of slow light."""

    @abc.abstractmethod
    def slow_columns(
        self, passed: Float[Array, "sample term"]
    ) -> Float[Array, "sample coefficient"]:
        """Turn what is passed into the samples' response to slow light by the lobe; linear."""

    @abc.abstractmethod
    def base_towards(
        self, directions: Float[Array, "direction 3"]
    ) -> Float[Array, "sample direction"]:
        """Evaluate the base towards directions, whether they are seen or not."""

    @property
    def rows(self) -> dict[str, Any]:
        """All that has a row for each sample."""
        names = [field.name for field in dataclasses.fields(self) if field.name != "variant"]
        return {name: jax.tree.map(jnp.asarray, getattr(self, name)) for name in names}

    def of_rows(self, rows: dict[str, Any]) -> "Response":
        """Make the same of other samples."""
        return dataclasses.replace(self, **rows)

    def take(self, index: Int[np.ndarray, "kept"] | slice) -> "Response":
        """Keep the samples of the given indices."""
        return self.of_rows(jax.tree.map(lambda rows: as_jax(np.asarray(rows)[index]), self.rows))

    def thinned(self, step: int) -> "Response":
        """Keep one in ``step`` samples."""
        return self.take(slice(None, None, step))

    @property
    def slow_count(self) -> int:
        """The number of slow coefficients."""
        return self.diffuse_basis.shape[1]

    def lobe(self, guess: Guess) -> Parametric:
        """Make the material of a guess, of amplitude one."""
        return lobe_of(self.variant, guess.sigma, guess.mu)

    def slow_specular(
        self, passed: Float[Array, "sample term"], guess: Guess
    ) -> Float[Array, "sample coefficient"]:
        """Evaluate the samples' whole response to slow light by the lobe."""
        return self.slow_columns(passed)

    def slow_slopes(
        self, by_sigma: Float[Array, "sample term"], by_mu: Float[Array, "sample term"]
    ) -> tuple[Float[Array, "sample coefficient"], Float[Array, "sample coefficient"]]:
        """Turn derivatives of what is passed, by log sigma and log(mu - 1), into those of that."""
        return self.slow_columns(by_sigma), self.slow_columns(by_mu)

    def columns(self, guess: Guess) -> Columns:
        """Evaluate both lobes' responses to every part of the light."""
        return self.columns_of(self.passed(guess), guess)

    def columns_of(self, passed: Float[Array, "sample term"], guess: Guess) -> Columns:
        """Evaluate the same where what the lobe passes on is known."""
        slow = self.slow_specular(passed, guess)
        specular = jnp.concatenate([slow, self.source_specular(guess)], axis=1)
        diffuse = self.source_diffuse(guess)
        return Columns(jnp.concatenate([jnp.asarray(self.diffuse_basis), diffuse], 1), specular)

    def towards(self, guess: Guess) -> Columns:
        """Evaluate both lobes towards the directions of a guess, whether they are seen or not."""
        directions = jnp.asarray(guess.directions)
        lobe = lobes_towards(self.lobe(guess), self.samples, directions)
        return Columns(self.base_towards(directions), lobe)

    def source_diffuse(self, guess: Guess) -> Float[Array, "sample source"]:
        """Evaluate the base towards every source."""
        return guess.by_source(self.base_towards) * self.lit

    def source_specular(self, guess: Guess) -> Float[Array, "sample source"]:
        """Evaluate the lobe towards every source."""
        lobe = self.lobe(guess)
        return guess.by_source(partial(lobes_towards, lobe, self.samples)) * self.lit


class MirrorResponse(Response):
    """Of a glossy material: slow light is filtered by degree and looked up at R (T 6.9, 6.12).

    ``diffuse_basis`` holds A_l Y_lm(n), or transfer vectors (T 6.10) where the object shadows
    itself; ``mirror_basis`` holds V(R) Y_lm(R).  ``lacking`` is what this view leaves out of the
    response to slow light, linear where the search stands (``correction``): a constant, and
    derivatives by log sigma and log(mu - 1).
    """

    variant: Glossy
    samples: SurfaceSamples
    diffuse_basis: Float[AnyArray, "sample coefficient"]
    mirror_basis: Float[AnyArray, "sample coefficient"]
    lacking: Float[AnyArray, "sample 3 coefficient"]
    lit: Float[AnyArray, "sample source"]

    @classmethod
    def of_convex(
        cls, variant: Glossy, samples: SurfaceSamples, band_limit: int, sources: int
    ) -> "MirrorResponse":
        """Make the response of an object that never shadows itself."""
        samples = SurfaceSamples(*(as_jax(part) for part in samples))
        each = np.asarray(lambertian_transfer(band_limit))[degrees(band_limit)]
        dtype = samples.normals.dtype
        diffuse = np.asarray(real_basis(samples.normals, band_limit)) * each.astype(dtype)
        mirror = real_basis(samples.reflected, band_limit)
        lit = as_jax(np.ones((len(diffuse), sources), dtype))
        lacking = jnp.zeros((len(diffuse), 3, diffuse.shape[1]), mirror.dtype)
        return cls(variant, samples, as_jax(diffuse), mirror, lacking, lit)

    def shadowed(
        self,
        transfer: Float[AnyArray, "sample coefficient"],
        reflected: Bool[AnyArray, "sample"],
    ) -> "MirrorResponse":
        """Let the object shadow itself: transfer vectors for A_l Y_lm(n), and V(R) (T 6.12)."""
        seen = jnp.asarray(reflected)[:, None]
        mirror = jnp.where(seen, jnp.asarray(self.mirror_basis), 0)
        return dataclasses.replace(self, diffuse_basis=transfer, mirror_basis=mirror)

    def passed(self, guess: Guess) -> Float[Array, "sample degree"]:
        """Evaluate the transfer h_l(t_o) of every sample."""
        band_limit, lobe = band_limit_of(self.slow_count), self.lobe(guess)
        assert isinstance(lobe, Glossy)
        return transfer_of_samples(lobe, self.samples.exit_cosines, band_limit)

    def slow_columns(
        self, passed: Float[Array, "sample degree"]
    ) -> Float[Array, "sample coefficient"]:
        """Evaluate h_l(t_o) V(R) Y_lm(R)."""
        return by_degree(passed, self.mirror_basis)

    def slow_specular(
        self, passed: Float[Array, "sample degree"], guess: Guess
    ) -> Float[Array, "sample coefficient"]:
        """Evaluate the same, and what it leaves out."""
        constant, by_sigma, by_mu = jnp.moveaxis(jnp.asarray(self.lacking), 1, 0)
        return self.slow_columns(passed) + constant + guess.sigma * by_sigma + guess.mu * by_mu

    def slow_slopes(
        self, by_sigma: Float[Array, "sample degree"], by_mu: Float[Array, "sample degree"]
    ) -> tuple[Float[Array, "sample coefficient"], Float[Array, "sample coefficient"]]:
        """Add those of what it leaves out."""
        lacking = jnp.asarray(self.lacking)
        own = super().slow_slopes(by_sigma, by_mu)
        return own[0] + lacking[:, 1], own[1] + lacking[:, 2]

    def base_towards(
        self, directions: Float[Array, "direction 3"]
    ) -> Float[Array, "sample direction"]:
        """Evaluate the clamped cosine."""
        cosines = jnp.matmul(self.samples.normals, directions.T, precision="highest")
        return jnp.maximum(cosines, 0)


def lobes_towards(
    brdf: Parametric,
    samples: SurfaceSamples,
    directions: Float[AnyArray, "source 3"],
    *,
    base: bool = False,
) -> Float[Array, "sample source"]:
    """Evaluate the lobe (or the base) times cos t_i of every sample towards every direction."""
    directions = jnp.asarray(directions)

    def one(sample: SurfaceSamples) -> Float[Array, "source"]:
        frame = meridian_frames(sample.normals)
        pair = Components.of(directions), Components.of(sample.outgoing)
        lobes = list(brdf.transfer(*pair_in_frame(*pair, frame)))
        if not base:
            return lobes[-1]
        # A model without a base has none of it anywhere.
        return lobes[0] if len(lobes) > 1 else jnp.zeros_like(lobes[0])

    return jax.vmap(one)(SurfaceSamples(*(jnp.asarray(a) for a in samples)))


def specular_share(guess: Guess) -> Float[Array, "channel"]:
    """Evaluate ks / (kd + ks) of each channel."""
    return jax.nn.sigmoid(jnp.asarray(guess.specular_logit))
