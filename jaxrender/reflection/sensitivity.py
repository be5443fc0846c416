"""How an image answers to its material: the derivatives that carry a covariance into pixels.

B = K_d D + K_s S(sigma, mu), so of each channel dB/dK_d = D, dB/dK_s = S, and of the lobe
K_s dS/dsigma and K_s dS/dmu, which any forward model gives by differentiation.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.geometry import SurfacePlaces, SurfaceSamples, SurfaceView
from jaxrender.reflection.render import (
    ForwardModel,
    ShadowedModel,
    in_batches,
    samples_of_views,
)
from jaxrender.shapes import AnyArray, Array, Float, checked


@checked
def sensitivities(
    brdf: Parametric, view: SurfaceView, model: ForwardModel | ShadowedModel
) -> Float[AnyArray, "pixel number channel"]:
    """Differentiate the radiance of the pixels that are hit by the numbers of the material.

    First come amplitudes, such as K_d and K_s, of the same channel, then the others in the order
    of ``brdf.numbers``.
    """
    places = SurfacePlaces.of_views([view])
    lobes, channels = brdf.amplitudes.shape
    shape = (lobes + len(brdf.numbers), channels)
    return in_batches(_differentiate, brdf, samples_of_views([view]), model, shape, places)


@eqx.filter_jit
def _differentiate(
    brdf: Parametric, samples: SurfaceSamples, model: ForwardModel
) -> Float[Array, "pixel number channel"]:
    amplitudes, shaped = brdf.amplitudes, np.array(brdf.shaped())
    numbers = {name: jnp.asarray(value, amplitudes.dtype) for name, value in brdf.numbers.items()}
    value = model.columns(brdf.with_numbers(numbers), samples)
    slopes = []
    for name, at in numbers.items():

        def moved(to: Float[Array, ""], name: str = name) -> Float[Array, "pixel lobe channel"]:
            return model.columns(brdf.with_numbers({**numbers, name: to}), samples)

        slope = jax.jvp(moved, (at,), (jnp.ones_like(at),))[1][:, shaped]
        slopes.append(jnp.sum(amplitudes[shaped][None] * slope, axis=1)[:, None])
    return jnp.concatenate([value, *slopes], axis=1)
