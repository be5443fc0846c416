"""The reflection map as a forward model: slow light, the viewer's direction to degree P.

    column = sum_lq Lambda_l^-1 h_lq(t_o) L_lq,    L_lq the light in the sample's mirror frame

The azimuthal mean that other transfers keep is q = 0 alone; ``slow_light.reflect_slow_light`` keeps
every q.  Two filters lie between them, with the orders q <= P:

``shrm-P``
    h_lq(t_o) cos t_o expanded to degree P of t'_o = 2 t_o, as the map of T 5.10 has it
``azimuthal-P``
    h_lq at each sample's own exit angle: beyond the thesis, at the same cost

For a Gaussian lobe of sigma .2 under light to degree 16, exit cosines from .15 to .5, they are off
by 5.7, 2.9, 1.5 % and by 1.2, .33, .02 % at P = 2, 4, 8, the mean by 4.2 %
(``experiments/shrm_model.py``).

What depends on the samples and the light, L_lq, is computed once (``mirror_light``); a new sigma or
mu costs one table of h_lq (``reflect_mirror_light``).  Nothing is interpolated between texels.
"""

import re
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.batches import in_batches
from jaxrender.brdf import Glossy
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import band_limit_of, rotate
from jaxrender.shapes import AnyArray, Array, Float, Int, checked
from jaxrender.spectra import (
    CentralSpectrum,
    azimuthal_transfer_of_samples,
    central_spectrum,
    extent_of,
)

# Closer to grazing exit than this the weighted column is divided by this cosine.
_LEAST_COSINE = 1e-3
# Rotated side by side, to bound the memory.
_SAMPLES_AT_ONCE = 64
_NAME = re.compile(r"(shrm|azimuthal)-(\d+)")

MirrorLight = Float[AnyArray, "sample degree order channel"]


class ViewFilter(NamedTuple):
    """Which orders about R are kept, and whether the exit angle is expanded as well."""

    degree: int
    expanded: bool

    @classmethod
    def named(cls, transfer: str) -> "ViewFilter | None":
        """Read ``shrm-P`` or ``azimuthal-P``; None for any other transfer."""
        match = _NAME.fullmatch(transfer)
        return cls(int(match[2]), match[1] == "shrm") if match else None


@eqx.filter_jit
@checked
def mirror_light(
    samples: SurfaceSamples, slow: Float[AnyArray, "coefficient channel"], order_limit: int
) -> Float[Array, "sample degree order channel"]:
    """Turn the light into every sample's mirror frame: L_lq / Lambda_l, q = 0 ... the limit."""
    values = jnp.asarray(slow)
    index, scale = _orders(band_limit_of(values.shape[0]), order_limit)
    frames = SurfaceSamples(*(jnp.asarray(a) for a in samples)).world_from_mirror
    weights = jnp.asarray(scale, values.dtype)[:, :, None]

    def seen(frame: Float[Array, "3 3"]) -> Float[Array, "degree order channel"]:
        return rotate(values, frame.T)[index] * weights

    return in_batches(seen, frames, _SAMPLES_AT_ONCE)


@eqx.filter_jit
@checked
def reflect_mirror_light(
    brdf: Glossy,
    exit_cosines: Float[AnyArray, "sample"],
    light: MirrorLight,
    view: ViewFilter,
) -> Float[Array, "sample channel"]:
    """Evaluate the specular column (ks = 1); differentiable in the BRDF and the light."""
    terms = _terms(brdf, jnp.asarray(exit_cosines), light.shape[1] - 1, view)
    return jnp.einsum("slq,slqc->sc", terms, jnp.asarray(light), precision="highest")


@eqx.filter_jit
def mirror_coefficients_of(
    brdf: Glossy, samples: SurfaceSamples, band_limit: int, view: ViewFilter
) -> Float[Array, "sample coefficient"]:
    """Expand the lobe in harmonics of the light's direction: the column under light Y_lm."""
    arrays = SurfaceSamples(*(jnp.asarray(a) for a in samples))
    index, scale = _orders(band_limit, view.degree)
    terms = _terms(brdf, jnp.asarray(arrays.exit_cosines), band_limit, view)
    terms = terms * jnp.asarray(scale, terms.dtype)[None]

    def in_world(sample: tuple) -> Float[Array, "coefficient"]:
        own, frame = sample
        # Entries that do not exist all point at degree 0, and add nothing there.
        local = jnp.zeros(((band_limit + 1) ** 2, 1), own.dtype).at[index].add(own[..., None])
        return rotate(local, frame)[:, 0]

    frames = arrays.world_from_mirror
    return in_batches(in_world, (terms, frames), _SAMPLES_AT_ONCE)


def specular_spectrum(brdf: Glossy, band_limits: tuple[int, int]) -> CentralSpectrum:
    """rho_lpq of the glossy lobe alone at amplitude one, weighted by the exit cosine."""
    dtype = jnp.result_type(jnp.asarray(brdf.ks), jnp.asarray(brdf.sigma))
    return central_spectrum(brdf.specular_transfer, band_limits, *extent_of(brdf, dtype), True)


def _terms(
    brdf: Glossy, exit_cosines: Float[Array, "sample"], band_limit: int, view: ViewFilter
) -> Float[Array, "sample degree order"]:
    if not view.expanded:
        return azimuthal_transfer_of_samples(brdf, exit_cosines, band_limit, view.degree)
    weighted = specular_spectrum(brdf, (band_limit, view.degree)).transfer_at(exit_cosines)[..., 0]
    return weighted / jnp.maximum(exit_cosines, _LEAST_COSINE)[:, None, None]


def _orders(
    band_limit: int, order_limit: int
) -> tuple[Int[np.ndarray, "degree order"], Float[np.ndarray, "degree order"]]:
    """Where the orders 0 ... limit of each degree stand, and 1 / Lambda_l, 0 for q > l."""
    degree = np.arange(band_limit + 1)[:, None]
    order = np.arange(min(band_limit, order_limit) + 1)[None, :]
    exists = order <= degree
    index = np.where(exists, degree * (degree + 1) + order, 0)
    return index, np.where(exists, np.sqrt((2 * degree + 1) / (4 * np.pi)), 0)
