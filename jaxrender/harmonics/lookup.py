"""Looking an image up at any direction, traced and differentiable.

``Grid.neighbours`` says the same on the host.  Of latitude-longitude images the rows beyond the
poles are written out once (``over_poles``) and every direction then costs four texels
(``looked_up``).  ``looked_up_on_cube`` knows which texel lies beyond each edge of a face.

At a pole the interpolant has a value but no derivative: it depends on the azimuth one comes from.
``off_pole`` says where to differentiate instead, half a texel away: right to first order in the
size of a texel.
"""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero

from jaxrender.harmonics.panoramic_grids import CUBE_FACES, CubeGrid
from jaxrender.shapes import AnyArray, Array, Directions, Float, ImageArray, Int, checked

# Nearer to a pole than this part of a row, derivatives are taken half a row from it: further in
# they would grow without bound.  A little less than half, so as not to lie on a row.
_NEAR_POLE, _OFF_POLE = 1e-3, 0.499


@checked
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


@checked
def off_pole(directions: Directions, rows: int) -> Float[Array, "*batch 3"]:
    """Move directions at a pole of an image of so many rows to where it can be differentiated."""
    x, y, z = jnp.moveaxis(jnp.asarray(directions), -1, 0)
    row = np.pi / rows
    pole = x * x + y * y < (_NEAR_POLE * row * z) ** 2
    return jnp.stack(
        [
            jnp.where(pole, float(np.sin(_OFF_POLE * row)) * jnp.abs(z), x),
            jnp.where(pole, 0, y),
            jnp.where(pole, float(np.cos(_OFF_POLE * row)) * z, z),
        ],
        axis=-1,
    )


@jax.custom_jvp
@checked
def looked_up(
    padded: Float[AnyArray, "padded_row column channel"], directions: Directions
) -> Float[Array, "*batch channel"]:
    """Interpolate bilinearly in polar angle and azimuth, in an image from ``over_poles``."""
    return interpolated(padded, directions)


def _looked_up_jvp(primals, tangents):
    (padded, directions), (texels, moves) = primals, tangents
    value = interpolated(padded, directions)
    moved = jnp.zeros_like(value)
    if not isinstance(texels, SymbolicZero):
        moved = moved + interpolated(texels, directions)
    if not isinstance(moves, SymbolicZero):
        beside = off_pole(directions, padded.shape[0] - 2)
        moved = moved + jax.jvp(lambda at: interpolated(padded, at), (beside,), (moves,))[1]
    return value, moved


looked_up.defjvp(_looked_up_jvp, symbolic_zeros=True)


@checked
def interpolated(
    padded: Float[AnyArray, "padded_row column channel"], directions: Directions
) -> Float[Array, "*batch channel"]:
    """Interpolate as ``looked_up`` does, with no rule for derivatives at the poles."""
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


@checked
def looked_up_on_cube(
    grid: CubeGrid, image: ImageArray, directions: Directions
) -> Float[Array, "*batch channel"]:
    """Interpolate bilinearly on the face that a direction meets: ``CubeGrid.neighbours``, traced.

    Directions of any length.  Derivatives on an edge are those of one of its faces.
    """
    unit = jnp.asarray(directions)
    local = jnp.einsum(
        "fax,...x->...fa", jnp.asarray(CUBE_FACES, unit.dtype), unit, precision="highest"
    )
    face = jnp.argmax(local[..., 0], axis=-1)
    ahead, right, up = jnp.moveaxis(
        jnp.take_along_axis(local, face[..., None, None], axis=-2)[..., 0, :], -1, 0
    )
    row = ((1 - up / ahead) * grid.side - 1) / 2
    column = ((1 + right / ahead) * grid.side - 1) / 2
    # Rounding may put an edge a little beyond the texels that lie next to it.
    top, left = (jnp.clip(jnp.floor(place), -1, grid.side - 1) for place in (row, column))
    down, across = (row - top)[..., None], (column - left)[..., None]
    texels = jnp.asarray(image).reshape(-1, image.shape[-1])
    place = jnp.asarray(_cube_texels(grid))
    first, second = top.astype(int) + 1, left.astype(int) + 1
    upper = [texels[place[face, first, second + step]] for step in (0, 1)]
    lower = [texels[place[face, first + 1, second + step]] for step in (0, 1)]
    over, under = ((1 - across) * west + across * east for west, east in (upper, lower))
    return (1 - down) * over + down * under


@lru_cache(maxsize=8)
def _cube_texels(grid: CubeGrid) -> Int[np.ndarray, "face padded_row padded_column"]:
    """Number the texels of every face, and those one beyond its edges."""
    place = np.arange(-1, grid.side + 1)
    face, row, column = np.meshgrid(np.arange(6), place, place, indexing="ij")
    return grid.texel(face.ravel(), row.ravel(), column.ravel()).reshape(face.shape)
