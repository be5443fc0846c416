"""Between spherical harmonic reflection maps and the explicit forms before them (T 5.3.2, 5.6.2).

``IcosahedralMaps``
    Cabral's twelve reflection maps, blended between the three nearest viewers
``AzimuthalTexture``
    Kautz and McCool's three-dimensional texture B(R, t'_o): no azimuth (T 5.25)
``LightFieldTable``
    the whole four-dimensional light field B(R, o'), and the way back
"""

from functools import lru_cache
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from trimesh import creation

from jaxrender.harmonics import (
    LatLongGrid,
    flat_index,
    looked_up,
    over_poles,
    real_basis,
)
from jaxrender.reflection.shrm.maps import GlobalShrm, LocalShrm, exit_cosine
from jaxrender.shapes import AnyArray, Array, Directions, Float, Int, checked


class IcosahedralMaps(eqx.Module):
    """A reflection map for each of the viewers at an icosahedron's vertices (Cabral 1999)."""

    maps: Float[AnyArray, "viewer row column channel"]
    weighted: bool = eqx.field(static=True, default=False)

    @classmethod
    def of(cls, shrm: GlobalShrm) -> "IcosahedralMaps":
        """Sum the maps for each viewer (T 5.35)."""
        viewers = icosahedron_vertices()
        return cls(jnp.stack([shrm.dynamic_map(viewer) for viewer in viewers]), shrm.weighted)

    @eqx.filter_jit
    @checked
    def at(self, centres: Directions, outgoing: Directions) -> Float[Array, "*batch channel"]:
        """Blend the maps of the three viewers around each outgoing direction."""
        shares = blending_shares(outgoing)
        values = jnp.stack([looked_up(over_poles(one), centres) for one in jnp.asarray(self.maps)])
        found = jnp.einsum("...v,v...c->...c", shares, values, precision="highest")
        return found / exit_cosine(centres, outgoing)[..., None] if self.weighted else found


def icosahedron_vertices() -> Float[np.ndarray, "12 3"]:
    """The twelve viewers, unit vectors along (0, +-1, +-g) and its turns, g the golden ratio."""
    return np.array(creation.icosahedron().vertices)


@lru_cache(maxsize=1)
def _faces() -> tuple[Int[np.ndarray, "20 3"], Float[np.ndarray, "20 3 3"]]:
    """The icosahedron's faces, and for each the matrix from a direction to shares."""
    faces = np.array(creation.icosahedron().faces)
    return faces, np.linalg.inv(np.swapaxes(icosahedron_vertices()[faces], 1, 2))


def blending_shares(directions: Directions) -> Float[Array, "*batch 12"]:
    """How much of each of the twelve viewers a direction is: barycentric on its face; sums to 1."""
    faces, shares_of = _faces()
    unit = jnp.asarray(directions).reshape(-1, 3)
    shares = jnp.einsum(
        "fij,xj->xfi", jnp.asarray(shares_of, unit.dtype), unit, precision="highest"
    )
    face = jnp.argmax(shares.min(axis=2), axis=1)
    each = np.arange(unit.shape[0])
    own = jnp.maximum(shares[each, face], 0)
    own = own / own.sum(axis=1, keepdims=True)
    found = jnp.zeros((unit.shape[0], 12), unit.dtype)
    found = found.at[each[:, None], jnp.asarray(faces)[face]].set(own, unique_indices=True)
    return found.reshape(*directions.shape[:-1], 12)


class AzimuthalTexture(eqx.Module):
    """B(R, t'_o) at equal steps of the angle between R and V, from 0 to pi (T 5.25)."""

    maps: Float[AnyArray, "exit row column channel"]
    weighted: bool = eqx.field(static=True, default=False)

    @classmethod
    def of(cls, local: LocalShrm, count: int) -> "AzimuthalTexture":
        """Sum the terms q = 0 at so many angles; ValueError below 2."""
        if count < 2:
            raise ValueError(f"{count} angles to interpolate between: give 2 or more")
        angles = np.linspace(0, np.pi, count)
        along = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=-1)
        zonal = [flat_index(p, 0) for p in range(local.order + 1)]
        maps = jnp.asarray(local.maps)[:, :, np.array(zonal)]
        around = real_basis(jnp.asarray(along, maps.dtype), local.order)[:, np.array(zonal)]
        found = jnp.einsum("rcpd,ep->ercd", maps, around, precision="highest")
        return cls(found, local.weighted)

    @eqx.filter_jit
    @checked
    def at(self, centres: Directions, outgoing: Directions) -> Float[Array, "*batch channel"]:
        """Interpolate linearly between the two nearest angles."""
        maps = jnp.asarray(self.maps)
        count = maps.shape[0]
        place = _angle_between(centres, outgoing) * ((count - 1) / np.pi)
        floor = jnp.clip(jnp.floor(place), 0, count - 2)
        lower, share = floor.astype(int)[None, ..., None], (place - floor)[..., None]
        layers = jnp.stack([looked_up(over_poles(one), centres) for one in maps])
        near, far = (jnp.take_along_axis(layers, layer, axis=0)[0] for layer in (lower, lower + 1))
        found = (1 - share) * near + share * far
        return found / exit_cosine(centres, outgoing)[..., None] if self.weighted else found


def _angle_between(first: Directions, second: Directions) -> Float[Array, "*batch"]:
    """The angle between unit directions; where it is 0 or pi, its kinks, its derivative is 0."""
    apart, along = (
        jnp.sum(jnp.square(a), axis=-1)
        for a in (jnp.asarray(first) - second, jnp.asarray(first) + second)
    )
    kink = (apart == 0) | (along == 0)
    # The root of zero has no derivative, so there it is not taken.
    half = jnp.arctan2(jnp.sqrt(jnp.where(kink, 1, apart)), jnp.sqrt(jnp.where(kink, 1, along)))
    return jnp.where(kink, jnp.where(apart == 0, 0, np.pi), 2 * half)


class ViewerRule(NamedTuple):
    """Local viewers of a light field: Gauss-Legendre polar angles, equal azimuths from 0."""

    rows: int
    columns: int

    def directions(self) -> Float[np.ndarray, "viewer_row viewer_column 3"]:
        """Unit vectors o'."""
        cosines = np.polynomial.legendre.leggauss(self.rows)[0][::-1, None]
        azimuths = (np.arange(self.columns) * 2 * np.pi / self.columns)[None, :]
        sines = np.sqrt(1 - cosines**2)
        x, y = sines * np.cos(azimuths), sines * np.sin(azimuths)
        return np.stack([x, y, np.broadcast_to(cosines, x.shape)], axis=-1)

    def weights(self) -> Float[np.ndarray, "viewer_row 1"]:
        """Solid angle of each viewer; sums to 4 pi over them."""
        return np.polynomial.legendre.leggauss(self.rows)[1][::-1, None] * 2 * np.pi / self.columns


class LightFieldTable(eqx.Module):
    """B(R, o') tabulated over maps and local viewers: the explicit form (T 5.3.2)."""

    values: Float[AnyArray, "viewer_row viewer_column row column channel"]
    weighted: bool = eqx.field(static=True, default=False)

    @classmethod
    def of(cls, local: LocalShrm, rule: ViewerRule) -> "LightFieldTable":
        """Sum the maps for every viewer."""
        return cls(_tabulated(jnp.asarray(local.maps), rule, local.order), local.weighted)

    def shrm(self, order: int, band_limit: int) -> LocalShrm:
        """Integrate over the viewers: the maps B_pq to degree P of a light field to degree F.

        Raises ``ValueError`` where the table has too few viewers for the degree.
        """
        values = jnp.asarray(self.values)
        rule = ViewerRule(*values.shape[:2])
        if order >= rule.rows or 2 * order >= rule.columns:
            raise ValueError(
                f"degree {order} of the viewer cannot be determined from {rule.rows} x "
                f"{rule.columns} viewers: tabulate more of them, or ask for less"
            )
        around = _viewer_basis(rule, order) * rule.weights()[..., None]
        maps = jnp.einsum(
            "tfk,tfrcd->rckd", jnp.asarray(around, values.dtype), values, precision="highest"
        )
        grid = LatLongGrid(*values.shape[2:4])
        return LocalShrm(maps, grid, band_limit, self.weighted)


@eqx.filter_jit
def _tabulated(maps: Array, rule: ViewerRule, order: int) -> Array:
    # One product of (P+1)^2 terms a texel: measured faster than P terms in two steps (T 5.6.2), as
    # it reads the maps once and writes every result where it belongs.
    around = jnp.asarray(_viewer_basis(rule, order), maps.dtype)
    texels = jnp.moveaxis(maps, 2, 0)
    flat = jnp.matmul(
        around.reshape(-1, texels.shape[0]),
        texels.reshape(texels.shape[0], -1),
        precision="highest",
    )
    return flat.reshape(rule.rows, rule.columns, *texels.shape[1:])


def _viewer_basis(
    rule: ViewerRule, order: int
) -> Float[np.ndarray, "viewer_row viewer_column outgoing"]:
    with jax.ensure_compile_time_eval():
        return np.asarray(real_basis(jnp.asarray(rule.directions()), order))
