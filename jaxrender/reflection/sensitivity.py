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
from jaxrender.reflection.render import ForwardModel, ShadowedModel, batches
from jaxrender.shapes import Array, Float


def sensitivities(
    brdf: Parametric, view: SurfaceView, model: ForwardModel | ShadowedModel
) -> Float[np.ndarray, "pixel 4 channel"]:
    """Differentiate the radiance of the pixels that are hit by K_d, K_s, sigma and mu.

    K_d and K_s of the same channel; a metal's mu has no effect.
    """
    samples = SurfaceSamples(view.normals[view.hit], view.outgoing[view.hit])
    places = SurfacePlaces.of_views([view])
    found = np.zeros((len(samples.normals), 4, np.shape(brdf.kd)[0]))
    for rows, batch, lit in batches(samples, model, places):
        found[rows] = np.asarray(_differentiate(brdf, batch, lit))[: rows.stop - rows.start]
    return found


@eqx.filter_jit
def _differentiate(
    brdf: Parametric, samples: SurfaceSamples, model: ForwardModel
) -> Float[Array, "pixel 4 channel"]:
    sigma = jnp.asarray(brdf.sigma, float)
    one = jnp.ones_like(sigma)

    def columns(sigma: Float[Array, ""], mu: Float[Array, ""] | None):
        return model.columns(brdf.with_roughness(sigma, mu), samples)

    mu = None if brdf.mu is None else jnp.asarray(brdf.mu, float)
    value, by_sigma = jax.jvp(lambda s: columns(s, mu), (sigma,), (one,))
    by_mu = jnp.zeros_like(value)
    if mu is not None:
        _, by_mu = jax.jvp(lambda m: columns(sigma, m), (mu,), (one,))
    ks = jnp.asarray(brdf.ks)[None, :]
    return jnp.stack([value[:, 0], value[:, 1], ks * by_sigma[:, 1], ks * by_mu[:, 1]], axis=1)
