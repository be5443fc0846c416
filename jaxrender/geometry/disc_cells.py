"""What the disc of directions covers of the cells of Nusselt's square: areas, and places inside.

The square is cut into n x n cells; n = 1 or even, so that a cell lies on one side of either axis.
Directions fill the disc of radius 1/2 about the centre.  Cells on its rim are covered in part, and
what is done with a rim cell (a mean, a random place) is done with that part alone.

With the disc's radius as unit and a cell folded to u0 <= u <= u1, v0 <= v <= v1, u0, v0 >= 0, the
covered part is v0 <= v <= min(v1, sqrt(1 - u^2)).  Its area up to u is elementary, and a place that
is uniform in it is found by inverting that area along u, and along v by a straight line.
"""

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.shapes import AnyArray, Array, Float, Int, checked

# The area is concave along u, so Newton's steps from the left never overshoot; where the part ends
# in a corner each takes three quarters of what is left, and these leave 6e-8 of the area.
_STEPS = 12


def covered_shares(size: int) -> Float[np.ndarray, "row column"]:
    """Find the share of each cell's area that is in the disc; float64 on the host.

    Raises ``ValueError`` for a size that is neither 1 nor even and positive.
    """
    _refuse_size(size)
    if size == 1:
        return np.full((1, 1), np.pi / 4)
    near = np.arange(size // 2) * 2 / size
    u, v = np.meshgrid(near, near, indexing="ij")
    step = 2 / size
    quarter = np.asarray(_area(np, u, (u, v, v + step), u + step)) / step**2
    # Differences of areas: a cell outside may be left with rounding, one inside be short of 1.
    quarter = np.where(np.hypot(u + step, v + step) <= 1, 1.0, np.clip(quarter, 0, 1))
    quarter = np.where(np.hypot(u, v) >= 1, 0.0, quarter)
    half = np.concatenate([quarter[::-1], quarter], axis=0)
    return np.concatenate([half[:, ::-1], half], axis=1)


@checked
def places_in_disc(
    cells: Int[AnyArray, "point 2"], fractions: Float[AnyArray, "point 2"], size: int
) -> Float[Array, "point 2"]:
    """Turn uniform numbers in [0, 1) into places uniform in the covered part of cells.

    ``cells`` count rows and columns of ``size``; a cell that the disc does not touch gives its
    corner nearest to the disc.  Raises ``ValueError`` as ``covered_shares`` does.
    """
    _refuse_size(size)
    cells, fractions = jnp.asarray(cells), jnp.asarray(fractions)
    if size == 1:
        radius, azimuth = jnp.sqrt(fractions[:, 0]), 2 * np.pi * fractions[:, 1]
        flat = radius[:, None] * jnp.stack([jnp.cos(azimuth), jnp.sin(azimuth)], axis=1)
        return (flat + 1) / 2
    step = 2 / size
    right = cells >= size // 2
    near = jnp.where(right, cells - size // 2, size // 2 - 1 - cells).astype(fractions.dtype) * step
    u0, v0 = near[:, 0], near[:, 1]
    v1 = v0 + step
    far = jnp.minimum(u0 + step, jnp.sqrt(jnp.maximum(1 - v0 * v0, 0)))
    far = jnp.maximum(far, u0)
    wanted = fractions[:, 0] * _area(jnp, u0, (u0, v0, v1), far)

    def step_on(_: Array, u: Array) -> Array:
        height = jnp.minimum(v1, jnp.sqrt(jnp.maximum(1 - u * u, 0))) - v0
        missing = wanted - _area(jnp, u0, (u0, v0, v1), u)
        return jnp.clip(
            u + jnp.where(height > 0, missing / jnp.where(height > 0, height, 1), 0), u, far
        )

    u = jax.lax.fori_loop(0, _STEPS, step_on, u0)
    top = jnp.minimum(v1, jnp.sqrt(jnp.maximum(1 - u * u, 0)))
    v = v0 + fractions[:, 1] * jnp.maximum(top - v0, 0)
    inside = jnp.hypot(u0 + step, v1) <= 1
    plain = near + fractions * step
    folded = jnp.where(inside[:, None], plain, jnp.stack([u, v], axis=1))
    return (1 + jnp.where(right, folded, -folded)) / 2


def _area(xp, start, cell, stop):
    """Integrate min(v1, sqrt(1 - u^2)) - v0 over u from ``start`` to ``stop``, where positive."""
    _, v0, v1 = cell
    level = xp.sqrt(xp.maximum(1 - v1 * v1, 0))
    end = xp.sqrt(xp.maximum(1 - v0 * v0, 0))
    flat = xp.clip(stop, start, xp.maximum(level, start)) - start
    left = xp.maximum(start, level)
    right = xp.maximum(xp.minimum(stop, end), left)
    return (v1 - v0) * flat + _segment(xp, right) - _segment(xp, left) - v0 * (right - left)


def _segment(xp, u):
    """Integrate sqrt(1 - u^2) from 0."""
    u = xp.minimum(u, 1)
    return (u * xp.sqrt(1 - u * u) + xp.arcsin(u)) / 2


def _refuse_size(size: int) -> None:
    if size != 1 and (size < 2 or size % 2):
        raise ValueError(f"size={size}: give 1 or an even number of cells along an axis")
