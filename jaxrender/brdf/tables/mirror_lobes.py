"""Directions about the mirror direction, as lobes of several widths: for sums that must meet peaks.

Half vectors have GGX's distribution of one of K widths, so that some width is near any lobe's:

    p(w_r | w_i) = 1 / K sum over k of D_k(h) cos t_h / (4 w_i . h)      per steradian.
"""

import jax.numpy as jnp
import numpy as np

from jaxrender.shapes import AnyArray, Array, Float

WIDTHS = (0.005, 0.02, 0.06, 0.2, 0.5)


def mirrored(
    incoming: Float[AnyArray, "pair 3"], uniforms: Float[AnyArray, "pair 2"]
) -> Float[Array, "pair 3"]:
    """Turn uniform numbers in [0, 1) into outgoing directions; some are below the horizon."""
    incoming, uniforms = jnp.asarray(incoming), jnp.asarray(uniforms)
    scaled = uniforms[:, 0] * len(WIDTHS)
    which = jnp.minimum(scaled.astype(np.int32), len(WIDTHS) - 1)
    part = jnp.clip(scaled - jnp.floor(scaled), 0, 1 - 1e-6)
    # tan^2 = width^2 u / (1 - u).
    tangent = jnp.asarray(WIDTHS, uniforms.dtype)[which] * jnp.sqrt(part / (1 - part))
    cosine = 1 / jnp.sqrt(1 + tangent**2)
    sine, turn = tangent * cosine, 2 * np.pi * uniforms[:, 1]
    half = jnp.stack([sine * jnp.cos(turn), sine * jnp.sin(turn), cosine], axis=1)
    return 2 * jnp.sum(half * incoming, axis=1, keepdims=True) * half - incoming


def mirror_density(
    incoming: Float[AnyArray, "pair 3"], outgoing: Float[AnyArray, "pair 3"]
) -> Float[Array, "pair"]:
    """Evaluate the density of ``mirrored`` per steradian, the same for the pair exchanged."""
    incoming, outgoing = jnp.asarray(incoming), jnp.asarray(outgoing)
    middle = incoming + outgoing
    length = jnp.linalg.norm(middle, axis=1)
    half = middle / jnp.maximum(length, 1e-30)[:, None]
    cosine = jnp.maximum(half[:, 2], 0)
    across = jnp.sum(half * outgoing, axis=1)
    squares = jnp.asarray(WIDTHS, half.dtype)[None] ** 2
    tilt = (half[:, 0] ** 2 + half[:, 1] ** 2)[:, None]
    lobes = squares / (np.pi * (cosine[:, None] ** 2 * squares + tilt) ** 2)
    return lobes.mean(axis=1) * cosine / (4 * jnp.maximum(across, 1e-12))
