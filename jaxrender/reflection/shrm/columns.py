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
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import band_limit_of, rotate
from jaxrender.shapes import AnyArray, Array, Float
from jaxrender.spectra import CentralSpectrum, central_spectrum, extent_of

# Closer to grazing exit than this the weighted column is divided by this cosine.
_LEAST_COSINE = 1e-3
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
    """Turn the light into every sample's mirror frame: L_lq, q = 0 ... min(F, P), by Lambda_l."""
    values = jnp.asarray(slow)
    band_limit = band_limit_of(values.shape[0])
    order_limit = min(band_limit, view_degree)
    frames = SurfaceSamples(*(jnp.asarray(a) for a in samples)).world_from_mirror
    local = rotate(values, jnp.swapaxes(frames, -1, -2))
    degree, order = np.arange(band_limit + 1)[:, None], np.arange(order_limit + 1)[None, :]
    exists = order <= degree
    index = np.where(exists, degree * (degree + 1) + order, 0)
    scale = np.where(exists, np.sqrt((2 * degree + 1) / (4 * np.pi)), 0)
    return local[:, index] * jnp.asarray(scale, values.dtype)[None, :, :, None]


@eqx.filter_jit
def reflect_mirror_light(
    brdf: Glossy,
    exit_cosines: Float[AnyArray, "sample"],
    light: MirrorLight,
    view_degree: int,
) -> Float[Array, "sample channel"]:
    """Evaluate the specular column (ks = 1); differentiable in the BRDF and the light."""
    spectrum = specular_spectrum(brdf, (light.shape[1] - 1, view_degree))
    cosines = jnp.asarray(exit_cosines)
    terms = spectrum.transfer_at(cosines)[..., 0]
    column = jnp.einsum("slq,slqc->sc", terms, jnp.asarray(light), precision="highest")
    return column / jnp.maximum(cosines, _LEAST_COSINE)[:, None]


def specular_spectrum(brdf: Glossy, band_limits: tuple[int, int]) -> CentralSpectrum:
    """rho_lpq of the glossy lobe alone at amplitude one, weighted by the exit cosine."""
    dtype = jnp.asarray(brdf.ks).dtype
    return central_spectrum(brdf.specular_transfer, band_limits, *extent_of(brdf, dtype), True)
