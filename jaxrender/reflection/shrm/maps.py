"""The spherical harmonic reflection map: a map whose texels are functions of the viewer (T 5.4).

    B(R, o) = sum_pq B_pq(R) Y_pq(o)            (T 5.10, 5.11), real harmonics, p to P

R is the central direction, for most BRDFs the reflected one.  A *local* map has o in the frame of
its texel, Rz(beta) Ry(alpha) with R as third axis; a *global* one in the world, so that for a
distant viewer all harmonics are evaluated once and the map becomes a plain reflection map (T 5.35).
``weighted`` maps hold B cos t_o, for BRDFs that rise as 1 / cos t_o (see ``spectra.central``); they
are divided by it where they are evaluated, though by no less than ``LEAST_COSINE``.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import dot
from jaxrender.harmonics import (
    CubeGrid,
    Grid,
    LatLongGrid,
    band_limit_of,
    change_grid,
    interpolated,
    looked_up_on_cube,
    off_pole,
    orders,
    over_poles,
    real_basis,
)
from jaxrender.shapes import AnyArray, Array, Directions, Float, checked

# Below this cosine of the exit angle a weighted map is divided by it, not by less: what is cut off
# at degree P does not vanish towards grazing exit as the cosine does, and would glare.
LEAST_COSINE = 0.1

Maps = Float[AnyArray, "row column outgoing channel"]


class Shrm(eqx.Module):
    """Reflection maps B_pq, ``outgoing`` the flat index p(p+1)+q, on the texels of ``grid``.

    ``band_limit`` is F, the light's highest degree in them.
    Raises ``ValueError`` where the maps are not the grid's, where the last but one axis is no
    (P+1)^2, and for a latitude-longitude grid with an odd number of columns.
    """

    maps: Maps
    grid: Grid = eqx.field(static=True)
    band_limit: int = eqx.field(static=True)
    weighted: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        band_limit_of(self.maps.shape[2])
        if tuple(self.maps.shape[:2]) != self.grid.shape:
            raise ValueError(
                f"maps of {self.maps.shape[0]} x {self.maps.shape[1]} texels on a grid of "
                f"{self.grid.shape[0]} x {self.grid.shape[1]}; make the grid from their shape"
            )
        check_columns(self.grid)

    @property
    def order(self) -> int:
        """P, the highest degree of the viewer's direction."""
        return band_limit_of(self.maps.shape[2])

    @abc.abstractmethod
    def viewer(self, centres: Directions, outgoing: Directions) -> Float[Array, "*batch 3"]:
        """Express outgoing directions in the frames of the central directions' texels."""

    @abc.abstractmethod
    def _signs(self) -> Float[np.ndarray, "outgoing"]:
        """What half a turn about the pole does to each map."""

    @checked
    def at(self, centres: Directions, outgoing: Directions) -> Float[Array, "*batch channel"]:
        """Evaluate B for points with these central and outgoing directions, in the world.

        Bilinear between texels; both kinds of map are second order in their size, and at a pole
        of a latitude-longitude map, where these have no derivative, theirs is first order.
        Only these and the cube are looked up where the compiler sees it; what other grids have for
        neighbours is asked on the host.
        """
        flat = [jnp.asarray(directions).reshape(-1, 3) for directions in (centres, outgoing)]
        if isinstance(self.grid, LatLongGrid | CubeGrid):
            found = _evaluated(self, *flat)
        else:
            found = _summed_at(self, _between_texels(self, np.asarray(flat[0])), *flat)
        return found.reshape(*centres.shape[:-1], found.shape[-1])


class LocalShrm(Shrm):
    """Maps over outgoing directions in each texel's own frame (T 5.10); poles are singular."""

    @checked
    def viewer(self, centres: Directions, outgoing: Directions) -> Float[Array, "*batch 3"]:
        """Express outgoing directions along (theta, phi, R) of each central direction."""
        x, y, z = jnp.moveaxis(jnp.asarray(centres), -1, 0)
        at_pole = (x == 0) & (y == 0)
        # The root of zero has no derivative, so there it is not taken.
        length = jnp.hypot(jnp.where(at_pole, 1, x), y)
        sine = jnp.where(at_pole, 0, length)
        cos_b, sin_b = jnp.where(at_pole, 1, x / length), y / length
        out = jnp.asarray(outgoing)
        along = out[..., 0] * cos_b + out[..., 1] * sin_b
        across = out[..., 1] * cos_b - out[..., 0] * sin_b
        up = out[..., 2]
        return jnp.stack([along * z - up * sine, across, along * sine + up * z], axis=-1)

    def _signs(self) -> Float[np.ndarray, "outgoing"]:
        return np.where(orders(self.order) % 2 == 0, 1.0, -1.0)


class GlobalShrm(Shrm):
    """Maps over outgoing directions in the world (T 5.11): smooth in R, to degree F + P."""

    @checked
    def viewer(self, centres: Directions, outgoing: Directions) -> Float[Array, "*batch 3"]:
        """Leave the directions in the world."""
        return jnp.asarray(outgoing)

    @jax.jit
    @checked
    def dynamic_map(self, outgoing: Float[AnyArray, "3"]) -> Float[Array, "row column channel"]:
        """Sum the maps for one distant viewer: the plain reflection map of T 5.35.

        Of a weighted map it holds B cos t_o, which the renderer divides at each pixel.
        """
        around = real_basis(jnp.asarray(outgoing), self.order)
        return _summed(jnp.asarray(self.maps), around)

    def on(self, grid: Grid) -> "GlobalShrm":
        """Change to another grid, a cube for example, exactly: the maps have a band limit.

        Raises ``ValueError`` where this grid does not carry degree F + P.
        """
        flat = jnp.reshape(jnp.asarray(self.maps), (*self.grid.shape, -1))
        moved = change_grid(self.grid, flat, grid, self.band_limit + self.order)
        maps = moved.reshape(*grid.shape, *self.maps.shape[2:])
        return GlobalShrm(maps, grid, self.band_limit, self.weighted)

    def _signs(self) -> Float[np.ndarray, "outgoing"]:
        return np.ones(self.maps.shape[2])


def exit_cosine(
    centres: Float[AnyArray, "*batch 3"], outgoing: Float[AnyArray, "*batch 3"]
) -> Float[Array, "*batch"]:
    """cos t_o = cos(t'_o / 2) from the reflected and the outgoing direction, not below .1."""
    squared = (1 + dot(centres, outgoing)) / 2
    return jnp.sqrt(jnp.maximum(squared, LEAST_COSINE**2))


def check_columns(grid: Grid):
    """Raise ``ValueError`` for a latitude-longitude grid with an odd number of columns.

    Beyond a pole lies the column half a turn away, which such a grid does not have.
    """
    if isinstance(grid, LatLongGrid) and grid.width % 2:
        raise ValueError(
            f"a reflection map of {grid.height} x {grid.width} texels: its columns must have "
            "opposite ones to be looked up over the poles; give an even number of columns"
        )


def least_rows(band_limit: int, order: int) -> int:
    """Rows below which a latitude-longitude map aliases: it carries (rows - 1) / 2 >= F + P."""
    return 2 * (band_limit + order) + 1


@eqx.filter_jit
def _summed(
    maps: Float[Array, "row column outgoing channel"], around: Float[Array, "outgoing"]
) -> Float[Array, "row column channel"]:
    # One product over the maps as they lie, each channel on its own: as a sum over the third axis
    # it takes three to ten times as long.
    count, channels = maps.shape[2:]
    by_channel = around[:, None, None] * jnp.eye(channels, dtype=maps.dtype)[None]
    flat = maps.reshape(-1, count * channels)
    summed = jnp.matmul(flat, by_channel.reshape(-1, channels), precision="highest")
    return summed.reshape(*maps.shape[:2], channels)


@eqx.filter_jit
def _evaluated(
    shrm: Shrm, centres: Float[Array, "point 3"], outgoing: Float[Array, "point 3"]
) -> Float[Array, "point channel"]:
    return _differentiable(shrm, centres, outgoing)


@eqx.filter_custom_jvp
def _differentiable(shrm: Shrm, centres: Array, outgoing: Array) -> Array:
    return _plain(shrm, centres, outgoing)


@_differentiable.def_jvp
def _differentiable_jvp(primals, tangents):
    """Differentiate by centres at a pole beside it: look-up and frames at the same place."""
    (shrm, centres, outgoing), (maps_move, centres_move, outgoing_move) = primals, tangents
    value, moved = eqx.filter_jvp(
        lambda s, o: _plain(s, centres, o), (shrm, outgoing), (maps_move, outgoing_move)
    )
    if centres_move is None:
        return value, moved
    beside = centres
    if isinstance(shrm.grid, LatLongGrid):
        beside = off_pole(centres, shrm.grid.height)
    _, by_centres = jax.jvp(lambda c: _plain(shrm, c, outgoing), (beside,), (centres_move,))
    return value, by_centres if moved is None else moved + by_centres


def _plain(
    shrm: Shrm, centres: Float[Array, "point 3"], outgoing: Float[Array, "point 3"]
) -> Float[Array, "point channel"]:
    """Interpolate all maps and sum them."""
    maps = jnp.asarray(shrm.maps)
    rest = maps.shape[2:]
    flat = maps.reshape(*maps.shape[:2], -1)
    if isinstance(shrm.grid, LatLongGrid):
        signs = np.broadcast_to(shrm._signs()[:, None], rest).reshape(-1)
        values = interpolated(over_poles(flat, signs), centres)
    else:
        assert isinstance(shrm.grid, CubeGrid), "other grids are looked up on the host"
        values = looked_up_on_cube(shrm.grid, flat, centres)
    return _summed_at(shrm, values.reshape(-1, *rest), centres, outgoing)


@eqx.filter_jit
def _summed_at(
    shrm: Shrm,
    values: Float[Array, "point outgoing channel"],
    centres: Float[Array, "point 3"],
    outgoing: Float[Array, "point 3"],
) -> Float[Array, "point channel"]:
    around = real_basis(shrm.viewer(centres, outgoing), shrm.order)
    found = jnp.einsum("xkc,xk->xc", values, around, precision="highest")
    return found / exit_cosine(centres, outgoing)[:, None] if shrm.weighted else found


def _between_texels(
    shrm: Shrm, centres: Float[np.ndarray, "point 3"]
) -> Float[Array, "point outgoing channel"]:
    """Interpolate all maps where only the host knows the neighbours."""
    maps = jnp.asarray(shrm.maps)
    index, share = shrm.grid.neighbours(centres)
    corners = maps.reshape(-1, *maps.shape[2:])[index]
    return jnp.sum(jnp.asarray(share, maps.dtype)[:, :, None, None] * corners, axis=1)
