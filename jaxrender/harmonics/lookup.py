"""Looking a latitude-longitude image up at any direction, traced and differentiable.

``Grid.neighbours`` says the same on the host; here the rows beyond the poles are written out once
(``over_poles``) and every direction then costs four texels.
"""

import jax.numpy as jnp
import numpy as np

from jaxrender.shapes import AnyArray, Array, Directions, Float


def over_poles(
    image: Float[AnyArray, "row column *rest"], signs: Float[np.ndarray, "*rest"] | None = None
) -> Float[Array, "padded_row column *rest"]:
    """Add the row beyond each pole: the first and the last again, half a turn away.

    ``signs`` multiply them: components in frames that turn with the azimuth come back from the
    other side turned by half a turn.  Raises ``ValueError`` for an odd number of columns.
    """
    texels = jnp.asarray(image)
    width = texels.shape[1]
    if width % 2:
        raise ValueError(f"{width} columns have no opposite ones; give an even number of them")
    beyond = jnp.roll(texels[np.array([0, -1])], width // 2, axis=1)
    if signs is not None:
        beyond = beyond * jnp.asarray(signs, texels.dtype)[None, None]
    return jnp.concatenate([beyond[:1], texels, beyond[1:]])


def looked_up(
    padded: Float[AnyArray, "padded_row column channel"], directions: Directions
) -> Float[Array, "*batch channel"]:
    """Interpolate bilinearly in polar angle and azimuth, in an image from ``over_poles``."""
    x, y, z = jnp.moveaxis(jnp.asarray(directions), -1, 0)
    height, width = padded.shape[0] - 2, padded.shape[1]
    texels = jnp.asarray(padded).reshape(-1, padded.shape[2])
    # The row of index 0 lies beyond the pole: half a texel before it.
    row = jnp.arctan2(jnp.hypot(x, y), z) * (height / np.pi) + 0.5
    column = jnp.arctan2(y, x) * (width / (2 * np.pi)) - 0.5
    above, left = jnp.clip(jnp.floor(row), 0, height), jnp.floor(column)
    down, right = (row - above)[..., None], (column - left)[..., None]
    north = above.astype(int) * width
    west = left.astype(int) % width
    east = (west + 1) % width
    upper = (1 - right) * texels[north + west] + right * texels[north + east]
    lower = (1 - right) * texels[north + width + west] + right * texels[north + width + east]
    return (1 - down) * upper + down * lower
