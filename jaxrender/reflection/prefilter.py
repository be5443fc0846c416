"""Prefiltered environment maps: reflection as a function of one direction (T 4.3.1, 5.6).

For a lobe that depends on the angle from a central direction alone (the normal for Lambert, the
reflected direction for Phong or a microfacet seen head-on) the reflected light is the light
convolved with the lobe, B_lm = A_l L_lm: analysis, one multiplication a coefficient, synthesis.
``reflection_map_by_sum`` is the integral over the light's texels, texel by texel: the slow twin.
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics import LatLongGrid, analyse, apply_transfer, synthesise
from jaxrender.shapes import AnyArray, Array, Float, ImageArray, checked

# Results of the twin worked out at once, to bound the memory.
_ROWS_AT_ONCE = 4


@checked
def reflection_maps(
    image: ImageArray,
    transfers: Float[AnyArray, "lobe degree"] | Float[AnyArray, "lobe degree channel"],
    onto: LatLongGrid,
) -> Float[Array, "lobe map_row map_column channel"]:
    """Filter one light by several lobes: a map a lobe, by direction, on the grid ``onto``.

    The light is a latitude-longitude image of radiance, the lobes their A_l up to a common degree,
    one for all channels or one for each.  A map holds radiance (times steradian for the clamped
    cosine, whose map is irradiance).  Raises ``ValueError`` where the degree is above what the
    image carries.
    """
    grid = LatLongGrid(*image.shape[:2])
    band_limit = transfers.shape[1] - 1
    if band_limit > grid.band_limit:
        raise ValueError(
            f"lobes to degree {band_limit}, and {grid.height} x {grid.width} texels carry degree "
            f"{grid.band_limit}: leave the higher degrees out, or give a larger image"
        )
    return _filter(grid, onto, jnp.asarray(image), jnp.asarray(transfers, image.dtype))


@partial(jax.jit, static_argnums=(0, 1))
def _filter(grid: LatLongGrid, onto: LatLongGrid, image: Array, transfers: Array) -> Array:
    coefficients = analyse(grid, image, transfers.shape[1] - 1)
    # Lobe by lobe, so that every map comes out as it shall lie: one copy less than side by side.
    return jax.vmap(lambda transfer: synthesise(onto, apply_transfer(coefficients, transfer)))(
        transfers
    )


@checked
def reflection_map_by_sum(
    image: ImageArray, profile: Callable[[np.ndarray], np.ndarray], onto: LatLongGrid
) -> Float[np.ndarray, "map_row map_column channel"]:
    """Sum profile(cos t) L over all texels of the light, for every direction of ``onto``.

    ``profile`` is the lobe as a function of the cosine from its centre, 1/sr.  Host side, float64.
    """
    grid = LatLongGrid(*image.shape[:2])
    nodes = grid.directions().reshape(-1, 3)
    energy = (grid.weights()[..., None] * np.asarray(image, float)).reshape(len(nodes), -1)
    centres = onto.directions()
    found = np.empty((*onto.shape, energy.shape[1]))
    for first in range(0, onto.height, _ROWS_AT_ONCE):
        rows = slice(first, first + _ROWS_AT_ONCE)
        found[rows] = profile(np.clip(centres[rows] @ nodes.T, -1, 1)) @ energy
    return found
