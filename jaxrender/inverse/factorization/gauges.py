"""Gauges: which of all products of light and reflectance stands for what the photographs show.

Photographs alone fix the product in each channel:

``per-channel``
    kd + ks = 1 in each channel (T 6.4.4); light of each channel is scaled to match
``dielectric``
    one ks for all channels, since a dielectric's specular part has no colour; mean kd + ks = 1
``metal``
    the light's mean radiance is the same in all channels; mean kd + ks = 1
"""

import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.inverse.intervals import Uncertain, intervals
from jaxrender.inverse.parameters import Parameters
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Float

GAUGES = ("per-channel", "dielectric", "metal")


def gauge_factors(
    share: Float[AnyArray, "channel"], mean: Float[AnyArray, "channel"], gauge: str
) -> Float[AnyArray, "channel"]:
    """Compute the factors that multiply the reflectance of each channel and divide its light."""
    if gauge == "per-channel":
        return 0 * share + 1
    wanted = 1 / share if gauge == "dielectric" else abs(mean)
    return wanted / wanted.mean()


def in_gauge(
    unknown: Float[np.ndarray, "number"],
    covariance: Float[np.ndarray, "number number"],
    variant: Parametric,
    gauge: str,
    shape: tuple[int, int],
) -> tuple[Uncertain, Float[np.ndarray, "channel part channel part"]]:
    """Carry log(ks / kd), log sigma, log(mu - 1) and light over to a gauge, with their covariance.

    The lobe is put in the numbers of ``variant``; ``shape`` is the light's.  What is returned is
    the material, and the covariance of the light.
    """
    parts, channels = shape
    at, slopes = carried(unknown, variant, gauge, shape)
    spread = np.asarray(slopes) @ covariance @ np.asarray(slopes).T
    error = np.sqrt(np.maximum(np.diag(spread), 0))
    leaves, structure = jax.tree.flatten(jax.tree.map(lambda leaf: np.asarray(leaf, float), at))
    cuts = np.cumsum([leaf.size for leaf in leaves])[:-1]
    each = [part.reshape(leaf.shape) for part, leaf in zip(np.split(error, cuts), leaves)]
    (value, _), (errors, _) = (structure.unflatten(one) for one in (leaves, each))
    size = len(spread) - channels * parts
    origins = {one.name: one.origin for one in variant.searched}
    of_light = spread[size:, size:].reshape(channels, parts, channels, parts)
    return intervals(value, errors, origins, spread[:size, :size]), of_light


@stored(effort="least")
def carried(
    unknown: Float[AnyArray, "number"], variant: Parametric, gauge: str, shape: tuple[int, int]
) -> tuple[tuple[Parameters, Float[Array, "channel part"]], Float[Array, "parameter number"]]:
    """Carry the unknowns over to a gauge; with the derivatives of all numbers in a row."""
    parts, channels = shape

    def body_and_light(
        vector: Float[AnyArray, "number"],
    ) -> tuple[Parameters, Float[Array, "channel part"]]:
        logit, lobe, light = jnp.split(vector, [channels, channels + 2])
        share, light = jax.nn.sigmoid(logit), light.reshape(channels, parts)
        factor = gauge_factors(share, light[:, 0], gauge)
        numbers = own_numbers(variant, jnp.exp(lobe[0]), 1 + jnp.exp(lobe[1]))
        one = jnp.ones((), vector.dtype)
        amplitudes = amplitudes_of(variant, (1 - share) * factor, share * factor)
        body = Parameters(amplitudes, numbers, one[None], one)
        return body, light / factor[:, None]

    def flat(vector: Float[Array, "number"]) -> Float[Array, "parameter"]:
        return jax.flatten_util.ravel_pytree(body_and_light(vector))[0]

    unknown = jnp.asarray(unknown)
    return body_and_light(unknown), jax.jacfwd(flat)(unknown)


def amplitudes_of(
    variant: Parametric, base: Float[AnyArray, "channel"], lobe: Float[AnyArray, "channel"]
) -> dict[str, Float[AnyArray, "channel"]]:
    """Name the amplitudes of a base and a lobe, or of the lobe alone where there is no base."""
    names = variant.amplitude_names
    return dict(zip(names, (base, lobe)[-len(names) :]))


def own_numbers(
    variant: Parametric, sigma: Float[AnyArray, ""], mu: Float[AnyArray, ""]
) -> dict[str, Float[AnyArray, ""]]:
    """Put a width, and an index where there is one, in the model's own numbers."""
    index = {} if variant.mu is None else {variant.index.name: variant.index.of_index(mu)}
    return {variant.shape.name: variant.shape.of_width(sigma), **index}
