"""The reflection map as a forward model: slow light, the viewer's direction to degree P.

    column = sum_lq Lambda_l^-1 h_lq(t_o) L_lq,    h_lq(t_o) cos t_o to degree P of t'_o = 2 t_o

with L_lq the light in each sample's mirror frame.  The azimuthal mean that other transfers keep is
q = 0 alone; ``slow_light.reflect_slow_light`` keeps every q and the exact h_lq.  What depends on
the samples and the light, L_lq, is computed once (``mirror_light``); a new sigma or mu costs one
spectrum (``reflect_mirror_light``).  Nothing is interpolated between texels.

For a Gaussian lobe of sigma .2 under light to degree 10 the column is off by 4.3, 1.3, 1.2 % at
P = 2, 3, 4 where the exit cosine is above .5, and by 6.4, 3.9, 3.3 % from there to .15; the
azimuthal mean with its exact exit cosine by 1.4 and 5.0 %.
"""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import band_limit_of, rotate
from jaxrender.shapes import AnyArray, Array, Float, Int
from jaxrender.spectra import CentralSpectrum, central_spectrum, extent_of

# Closer to grazing exit than this the weighted column is divided by this cosine.
_LEAST_COSINE = 1e-3
# Rotated side by side, to bound the memory.
_SAMPLES_AT_ONCE = 64
_NAME = re.compile(r"shrm-(\d+)")

MirrorLight = Float[AnyArray, "sample degree order channel"]


def view_degree_of(transfer: str) -> int | None:
    """P of a transfer named ``shrm-P``; None for any other name."""
    match = _NAME.fullmatch(transfer)
    return int(match[1]) if match else None


@eqx.filter_jit
def mirror_light(
    samples: SurfaceSamples, slow: Float[AnyArray, "coefficient channel"], view_degree: int
) -> Float[Array, "sample degree order channel"]:
    """Turn the light into every sample's mirror frame: L_lq / Lambda_l, q = 0 ... min(F, P)."""
    values = jnp.asarray(slow)
    index, scale = _orders(band_limit_of(values.shape[0]), view_degree)
    frames = SurfaceSamples(*(jnp.asarray(a) for a in samples)).world_from_mirror
    weights = jnp.asarray(scale, values.dtype)[:, :, None]

    def seen(frame: Float[Array, "3 3"]) -> Float[Array, "degree order channel"]:
        return rotate(values, frame.T)[index] * weights

    return jax.lax.map(seen, frames, batch_size=_SAMPLES_AT_ONCE)


@eqx.filter_jit
def reflect_mirror_light(
    brdf: Glossy,
    exit_cosines: Float[AnyArray, "sample"],
    light: MirrorLight,
    view_degree: int,
) -> Float[Array, "sample channel"]:
    """Evaluate the specular column (ks = 1); differentiable in the BRDF and the light."""
    terms = _terms(brdf, jnp.asarray(exit_cosines), (light.shape[1] - 1, view_degree))
    return jnp.einsum("slq,slqc->sc", terms, jnp.asarray(light), precision="highest")


@eqx.filter_jit
def mirror_coefficients_of(
    brdf: Glossy, samples: SurfaceSamples, band_limit: int, view_degree: int
) -> Float[Array, "sample coefficient"]:
    """Expand the lobe in harmonics of the light's direction: the column under light Y_lm."""
    arrays = SurfaceSamples(*(jnp.asarray(a) for a in samples))
    index, scale = _orders(band_limit, view_degree)
    terms = _terms(brdf, arrays.exit_cosines, (band_limit, view_degree))
    terms = terms * jnp.asarray(scale, terms.dtype)[None]

    def in_world(sample: tuple) -> Float[Array, "coefficient"]:
        own, frame = sample
        # Entries that do not exist all point at degree 0, and add nothing there.
        local = jnp.zeros(((band_limit + 1) ** 2, 1), own.dtype).at[index].add(own[..., None])
        return rotate(local, frame)[:, 0]

    frames = arrays.world_from_mirror
    return jax.lax.map(in_world, (terms, frames), batch_size=_SAMPLES_AT_ONCE)


def specular_spectrum(brdf: Glossy, band_limits: tuple[int, int]) -> CentralSpectrum:
    """rho_lpq of the glossy lobe alone at amplitude one, weighted by the exit cosine."""
    dtype = jnp.result_type(jnp.asarray(brdf.ks), jnp.asarray(brdf.sigma))
    return central_spectrum(brdf.specular_transfer, band_limits, *extent_of(brdf, dtype), True)


def _terms(
    brdf: Glossy, exit_cosines: Float[Array, "sample"], band_limits: tuple[int, int]
) -> Float[Array, "sample degree order"]:
    weighted = specular_spectrum(brdf, band_limits).transfer_at(exit_cosines)[..., 0]
    return weighted / jnp.maximum(exit_cosines, _LEAST_COSINE)[:, None, None]


def _orders(
    band_limit: int, view_degree: int
) -> tuple[Int[np.ndarray, "degree order"], Float[np.ndarray, "degree order"]]:
    """Where the orders 0 ... min(F, P) of each degree stand, and 1 / Lambda_l, 0 for q > l."""
    degree = np.arange(band_limit + 1)[:, None]
    order = np.arange(min(band_limit, view_degree) + 1)[None, :]
    exists = order <= degree
    index = np.where(exists, degree * (degree + 1) + order, 0)
    return index, np.where(exists, np.sqrt((2 * degree + 1) / (4 * np.pi)), 0)
