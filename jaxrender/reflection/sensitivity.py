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
) -> Float[AnyArray, "pixel 4 channel"]:
    """Differentiate the radiance of the pixels that are hit by K_d, K_s, sigma and mu.

    K_d and K_s of the same channel; a metal's mu has no effect.
    """
    places = SurfacePlaces.of_views([view])
    shape = (4, np.shape(brdf.kd)[0])
    return in_batches(_differentiate, (brdf, samples_of_views([view]), model), shape, places)


@eqx.filter_jit
def _differentiate(
    brdf: Parametric, samples: SurfaceSamples, model: ForwardModel
) -> Float[Array, "pixel 4 channel"]:
    ks = jnp.asarray(brdf.ks)[None, :]
    sigma = jnp.asarray(brdf.sigma, ks.dtype)
    one = jnp.ones_like(sigma)

    def columns(sigma: Float[Array, ""], mu: Float[Array, ""] | None):
        return model.columns(brdf.with_roughness(sigma, mu), samples)

    mu = None if brdf.mu is None else jnp.asarray(brdf.mu, ks.dtype)
    value, by_sigma = jax.jvp(lambda s: columns(s, mu), (sigma,), (one,))
    by_mu = jnp.zeros_like(value)
    if mu is not None:
        _, by_mu = jax.jvp(lambda m: columns(sigma, m), (mu,), (one,))
    return jnp.stack([value[:, 0], value[:, 1], ks * by_sigma[:, 1], ks * by_mu[:, 1]], axis=1)
