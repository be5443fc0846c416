"""From an image on one grid to an image on another.

``change_grid`` goes through harmonics: exact for what the band limit holds, blurred with rings for
what it does not.  ``resample`` interpolates: never outside the range of the image, second order in
the size of a texel, but it does not keep the integral, and skips texels when the target is coarser.
"""

import jax.numpy as jnp

from jaxrender.harmonics.grids import Grid
from jaxrender.harmonics.transform import analyse, check_image, synthesise
from jaxrender.shapes import Array, Float, ImageArray, checked


@checked
def change_grid(
    source: Grid, image: ImageArray, target: Grid, band_limit: int
) -> Float[Array, "target_row target_column channel"]:
    """Return the image's function up to degree F, on the target's texels.

    Raises ValueError if the image is not the source's or F exceeds the source's band limit.
    """
    return synthesise(target, analyse(source, image, band_limit))


@checked
def resample(
    source: Grid, image: ImageArray, target: Grid
) -> Float[Array, "target_row target_column channel"]:
    """Return the image interpolated bilinearly at the directions of the target's texels.

    Raises ValueError if the image is not the source's.
    """
    check_image(source, image)
    values = jnp.asarray(image)
    index, share = source.neighbours(target.directions().reshape(-1, 3))
    corners = values.reshape(-1, values.shape[-1])[index]
    between = jnp.sum(jnp.asarray(share, values.dtype)[..., None] * corners, axis=1)
    return between.reshape(*target.shape, values.shape[-1])
