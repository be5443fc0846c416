"""Radiance of both lobes under each harmonic: what light given by coefficients is multiplied by."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from jaxrender.brdf import BRDF, Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import band_limit_of, coefficient_count, degrees, real_basis
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.reflection import ForwardModel, polar_coefficients
from jaxrender.shapes import Array, Float
from jaxrender.spectra import lambertian_transfer, transfer_of_samples

# Diffuse light beyond this degree is under .4 % of the whole.
_DIFFUSE_BAND_LIMIT = 8
# Polar nodes of the exact integral; the lobe meets smooth harmonics.
_POLAR_NODES = 24


class LobeColumns(NamedTuple):
    """Radiance of the diffuse and of the specular lobe under each harmonic."""

    diffuse: Float[Array, "sample coefficient"]
    specular: Float[Array, "sample coefficient"]


@eqx.filter_jit
def harmonic_columns(
    samples: SurfaceSamples, brdf: Microfacet, band_limit: int, exact: bool = True
) -> Float[Array, "sample coefficient"]:
    """Evaluate the specular lobe's radiance under each harmonic to a band limit.

    ``exact`` evaluates the integral itself; otherwise it is h_l(t_o) Y_lm(R).
    """
    if exact:
        return polar_coefficients(brdf, samples, band_limit, _POLAR_NODES)[:, 1]
    passed = transfer_of_samples(brdf, samples.exit_cosines, band_limit, "exit-cosine")
    return passed[:, degrees(band_limit)] * real_basis(samples.reflected, band_limit)


def diffuse_basis(samples: SurfaceSamples, band_limit: int) -> Float[Array, "sample coefficient"]:
    """Evaluate A_l Y_lm(n), zero above the degrees that make up diffuse light."""
    kept = min(band_limit, _DIFFUSE_BAND_LIMIT)
    normals = jnp.asarray(samples.normals)
    each = jnp.asarray(lambertian_transfer(kept)[degrees(kept)], normals.dtype)
    missing = coefficient_count(band_limit) - coefficient_count(kept)
    return jnp.pad(real_basis(normals, kept) * each[None, :], ((0, 0), (0, missing)))


def diffuse_under(
    basis: Float[Array, "sample coefficient"], light: Float[Array, "coefficient channel"]
) -> Float[Array, "sample channel"]:
    """Evaluate E(n), kept above zero where ringing would take it below on the dark side."""
    found = jnp.matmul(basis, light, precision="highest")
    return jnp.maximum(found, 1e-3 * jnp.mean(jnp.abs(found)))


class HarmonicColumns(eqx.Module):
    """Both lobes' columns as a function of the search point."""

    diffuse: Float[Array, "sample coefficient"]
    samples: SurfaceSamples
    variant: Microfacet
    unknowns: Unknowns
    band_limit: int = eqx.field(static=True)
    exact: bool = eqx.field(static=True)

    def __call__(self, point: Float[Array, "unknown"]) -> LobeColumns:
        """Evaluate them."""
        lobe = self._lobe_at(point)
        specular = harmonic_columns(self.samples, lobe, self.band_limit, self.exact)
        return LobeColumns(self.diffuse, specular)

    def _lobe_at(self, point: Float[Array, "unknown"]) -> Microfacet:
        return self.variant.with_numbers(self.unknowns.unpack(point).numbers)


class HarmonicForward(ForwardModel):
    """Light given by coefficients, reflected as where the sites under it are solved."""

    light: Float[Array, "coefficient channel"]
    exact: bool = eqx.field(static=True)

    def columns(self, brdf: BRDF, samples: SurfaceSamples) -> Float[Array, "sample lobe channel"]:
        """Evaluate both lobes; ``exact`` is as in ``harmonic_columns``."""
        assert isinstance(brdf, Microfacet)
        limit = band_limit_of(len(self.light))
        specular = harmonic_columns(samples, brdf, limit, self.exact)
        diffuse = diffuse_under(diffuse_basis(samples, limit), self.light)
        lit = jnp.matmul(specular, self.light, precision="highest")
        return jnp.stack([diffuse, lit], axis=1)
