"""Slow light reflected by a glossy lobe with nothing left out: all azimuthal orders of T 3.43.

The dual model keeps the azimuthal mean of the lobe about the reflected direction, the order q = 0.
With the orders to the light's own degree the sum

sum_lq Lambda_l^-1 h_lq(t_o) L_lq,    L_lq the light in the frame of the reflected direction

is the reflection integral itself, horizon and grazing angles included, of light with a band limit:
what ``integral_columns`` approaches as its grid grows, at a cost that does not depend on how sharp
the lobe is.  Nothing may shadow the surface.
"""

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import band_limit_of, coefficient_count, rotate
from jaxrender.programs import stored
from jaxrender.reflection.convolution import reflect_about_mirror
from jaxrender.shapes import AnyArray, Array, Float, checked
from jaxrender.spectra import azimuthal_transfer_of_samples


@stored(effort="less")
@checked
def reflect_slow_light(
    brdf: Glossy, samples: SurfaceSamples, slow: Float[AnyArray, "coefficient channel"]
) -> Float[Array, "sample channel"]:
    """Evaluate the specular column (ks = 1) of light given by its coefficients."""
    samples = SurfaceSamples(*(jnp.asarray(a) for a in samples))
    band_limit = band_limit_of(slow.shape[0])
    terms = azimuthal_transfer_of_samples(brdf, samples.exit_cosines, band_limit)
    return reflect_about_mirror(slow, terms, samples.world_from_mirror)


@stored(effort="less")
@checked
def slow_light_columns(
    brdf: Glossy, samples: SurfaceSamples, band_limit: int
) -> Float[Array, "sample coefficient"]:
    """Evaluate the specular column (ks = 1) of every coefficient of light to a band limit.

    A rotation's inverse is its transpose.  So the weights of the light in a sample's own frame are
    turned into the world, and not the light into the frame of every sample.
    """
    samples = SurfaceSamples(*(jnp.asarray(a) for a in samples))
    terms = azimuthal_transfer_of_samples(brdf, samples.exit_cosines, band_limit)
    degree, order = np.nonzero(np.tri(band_limit + 1, dtype=bool))
    wavelength = np.sqrt(4 * np.pi / (2 * degree + 1))
    local = jnp.zeros((len(terms), coefficient_count(band_limit)), terms.dtype)
    weighted = terms[:, degree, order] / jnp.asarray(wavelength, terms.dtype)[None]
    local = local.at[:, degree * (degree + 1) + order].set(weighted)
    return jax.vmap(lambda one, frame: rotate(one[:, None], frame)[:, 0])(
        local, samples.world_from_mirror
    )
