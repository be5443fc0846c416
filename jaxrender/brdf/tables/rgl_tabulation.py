"""Any isotropic BRDF in the adaptive parameterisation of measured ones (see ``rgl``).

The density of normals D is free to choose, since samples are divided by it.  Here it is half broad,
with many samples near the normal, and half what the highlight reflects straight back,
f(m, m) cos^2 t_m without the least f, as Dupuy and Jakob have it for a first guess.  So half of the
samples lie about the highlight, however narrow.  Samples beyond the horizon hold the value that is
nearest to it.  Incoming directions lie evenly, and densely near grazing, where values grow like
1 / cos t_i.
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from scipy.integrate import trapezoid

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.half_vector import SMALLEST_COSINE
from jaxrender.brdf.tables.bilinear_warp import BilinearWarp
from jaxrender.brdf.tables.rgl import RglTables
from jaxrender.shapes import Float

# What the tables' incoming direction is of the BRDF.
FIRST = ("incoming", "outgoing")
# Incoming directions lie evenly to here, and from here on each cosine is this part of the last.
_EVEN_TO, _RATIO, _LAST_COSINE = 1.05, 0.9, 0.015
# Of a density of normals: so that no cell of the square is empty.
_LEAST_FACING = 0.02
# The broad half: angles of the normals below the root of this have one density.
_BROAD = 0.01
# What rises less above a base, in parts of the largest value, is rounding.
_ROUNDING = 1e-6
_evaluate = eqx.filter_jit(BRDF.evaluate)


class RglSize(NamedTuple):
    """How fine the tables are: polar angles of i evenly spaced, normals, and samples a side."""

    even: int = 20
    normals: int = 1024
    visible_across: int = 256
    visible_around: int = 65
    samples: int = 96


def tabulate_rgl(brdf: BRDF, first: str = "incoming", size: RglSize | None = None) -> RglTables:
    """Tabulate an isotropic BRDF; negative values become 0.

    ``first`` is the direction of the BRDF that the tables have for their incoming one.  A renderer
    that traces light backwards, as Mitsuba does, looks them up by where it looks from: give it
    ``"outgoing"``, unless the BRDF is reciprocal.  Raises ``ValueError`` for an anisotropic BRDF
    and for values that are not finite.
    """
    if first not in FIRST:
        raise ValueError(f"first={first!r}: choose one of {', '.join(FIRST)}")
    if not brdf.isotropic:
        raise ValueError("the BRDF is anisotropic: tabulate its IsotropicMean")
    size = size or RglSize()
    theta_i = _incoming_angles(size.even)
    polar = np.pi / 2 * np.linspace(0, 1, size.normals) ** 2
    density = _density(brdf, polar)
    # As the reader has them: in single precision.
    ndf = np.broadcast_to(density, (2, size.normals)).astype(np.float32)
    areas = _areas(np.pi / 2 * np.linspace(0, 1, size.normals) ** 2, polar, density)
    sigma = np.broadcast_to(areas, (2, size.normals)).astype(np.float32)
    visible = np.stack([_visible(theta, polar, density, size) for theta in theta_i])
    visible = visible.astype(np.float32)
    warp = BilinearWarp.of(visible.astype(float))
    samples = np.stack(
        [
            _samples(brdf, first, theta, *_inverted(warp, table, size.samples), ndf[0], sigma[0])
            for table, theta in enumerate(theta_i)
        ]
    )
    phi_i = np.zeros(1, np.float32)
    found = np.maximum(np.moveaxis(samples, -1, 1), 0).astype(np.float32)
    angles = theta_i.astype(np.float32)
    return RglTables(phi_i, angles, ndf, sigma, visible[None], found[None])


def _incoming_angles(even: int) -> Float[np.ndarray, "theta"]:
    """Place the polar angles of i, beyond the last of which values are held."""
    steps = int(np.log(_LAST_COSINE / np.cos(_EVEN_TO)) / np.log(_RATIO))
    grazing = np.arccos(np.cos(_EVEN_TO) * _RATIO ** np.arange(1, steps + 1))
    return np.concatenate([np.linspace(0, _EVEN_TO, even), grazing])


def _density(brdf: BRDF, polar: Float[np.ndarray, "normal"]) -> Float[np.ndarray, "normal"]:
    """Choose the density of normals, of projected area 1."""
    straight = _direction(np.minimum(polar, np.arccos(SMALLEST_COSINE)), np.zeros_like(polar))
    values = np.asarray(_evaluate(brdf, straight, straight), float).mean(axis=-1)
    if not np.isfinite(values).all():
        raise ValueError("the BRDF is not finite where light goes straight back; mend its values")
    steep = polar > _EVEN_TO
    # What rises above a base; rounding alone would be normals scattered at random.
    least = values[~steep].min() + _ROUNDING * values.max()
    own = np.maximum(values - least, 0) * np.cos(polar) ** 2
    broad = (polar**2 + _BROAD) ** -0.75
    parts = [part / area for part in (own, broad) if (area := _projected(part, polar)) > 0]
    return np.mean(parts, axis=0)


def _projected(
    density: Float[np.ndarray, "normal"], polar: Float[np.ndarray, "normal"]
) -> float | np.floating:
    return 2 * np.pi * trapezoid(density * np.sin(polar) * np.cos(polar), polar)


def _areas(
    theta: Float[np.ndarray, "theta"],
    polar: Float[np.ndarray, "normal"],
    density: Float[np.ndarray, "normal"],
) -> Float[np.ndarray, "theta"]:
    """Integrate the normals' area that each direction sees."""
    azimuth = np.linspace(0, np.pi, 65)
    areas = []
    for angle in theta[:: max(1, len(theta) // 64)]:
        facing = np.maximum(_facing(angle, polar[:, None], azimuth[None, :]), 0)
        ring = 2 * trapezoid(facing, azimuth)
        areas.append(trapezoid(density * np.sin(polar) * ring, polar))
    return np.interp(theta, theta[:: max(1, len(theta) // 64)], areas)


def _facing(
    theta: float | np.floating, polar: Float[np.ndarray, "..."], azimuth: Float[np.ndarray, "..."]
) -> Float[np.ndarray, "..."]:
    """Evaluate i . m with i at azimuth 0."""
    return np.sin(theta) * np.sin(polar) * np.cos(azimuth) + np.cos(theta) * np.cos(polar)


def _visible(
    theta: float | np.floating,
    polar: Float[np.ndarray, "normal"],
    density: Float[np.ndarray, "normal"],
    size: RglSize,
) -> Float[np.ndarray, "row column"]:
    """Tabulate the density of visible normals over the square."""
    across, around = np.linspace(0, 1, size.visible_across), np.linspace(0, 1, size.visible_around)
    angle = np.pi / 2 * across**2
    facing = _facing(theta, angle[None, :], (2 * np.pi * around - np.pi)[:, None])
    # D (i . m) sin t_m times dt_m / du; the least keeps rows about 0 and the horizon alive.
    weight = np.interp(angle, polar, density) * (np.sin(angle) * across + 1e-6)
    return weight * np.maximum(facing, _LEAST_FACING)


def _inverted(
    warp: BilinearWarp, table: int, count: int
) -> tuple[Float[np.ndarray, "row column"], Float[np.ndarray, "row column"]]:
    """Find where in the square the nodes of the samples lie: across and around."""
    parts = (warp.density, warp.along, warp.below)
    density, along, below = (np.asarray(part)[table] for part in parts)
    rows, columns = density.shape
    nodes = np.linspace(0, 1, count)
    row, t = _within(below, along[:, -1], nodes * below[-1], rows - 1)
    mixed = density[row] * (1 - t)[:, None] + density[row + 1] * t[:, None]
    sums = along[row] * (1 - t)[:, None] + along[row + 1] * t[:, None]
    across = np.stack(
        [
            np.add(*_within(one, own, nodes * one[-1], columns - 1)) / (columns - 1)
            for one, own in zip(sums, mixed)
        ]
    )
    return across, np.broadcast_to(((row + t) / (rows - 1))[:, None], across.shape)


def _within(
    sums: Float[np.ndarray, "node"],
    values: Float[np.ndarray, "node"],
    wanted: Float[np.ndarray, "point"],
    cells: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Invert the integral of a function that is linear between nodes: the cell, and where in it."""
    cell = np.clip(np.searchsorted(sums, wanted, side="right") - 1, 0, cells - 1)
    low, high = values[cell], values[cell + 1]
    rest = np.maximum(wanted - sums[cell], 0) * cells
    root = np.sqrt(np.maximum(low**2 + 2 * (high - low) * rest, 0))
    total = low + root
    return cell, np.clip(np.where(total > 0, 2 * rest / np.where(total > 0, total, 1), 0), 0, 1)


def _samples(
    brdf: BRDF,
    first: str,
    theta: float | np.floating,
    across: Float[np.ndarray, "row column"],
    around: Float[np.ndarray, "row column"],
    ndf: np.ndarray,
    sigma: np.ndarray,
) -> Float[np.ndarray, "row column channel"]:
    """Evaluate S = f cos t_o 4 s(u_i) / D(u) at the nodes."""
    nodes = np.linspace(0, 1, len(ndf))
    density = np.interp(across, nodes, ndf)
    area = np.interp(np.sqrt(2 * theta / np.pi), nodes, sigma)
    normal = _direction(np.pi / 2 * across**2, 2 * np.pi * around - np.pi)
    towards = np.broadcast_to(_direction(np.asarray(theta), np.zeros(())), normal.shape)
    away = 2 * np.sum(towards * normal, axis=-1, keepdims=True) * normal - towards
    away[..., 2] = np.maximum(away[..., 2], SMALLEST_COSINE)
    away /= np.linalg.norm(away, axis=-1, keepdims=True)
    pair = (towards, away) if first == "incoming" else (away, towards)
    values = np.asarray(_evaluate(brdf, *pair), float)
    if not np.isfinite(values).all():
        raise ValueError("the BRDF is not finite at some pairs of directions; mend its values")
    return values * away[..., 2:] * (4 * area / density)[..., None]


def _direction(
    polar: Float[np.ndarray, "*batch"], azimuth: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch 3"]:
    sine = np.sin(polar)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)], axis=-1)
