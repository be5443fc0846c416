"""ALTA's parametrisations of a pair of directions: coordinates to vectors, and back.

V is the outgoing (view) and L the incoming (light) direction; angles are in radians:

    CARTESIAN               V_x V_y V_z L_x L_y L_z
    SPHERICAL_TL_PL_TV_PV   polar angle and azimuth of L, then of V
    ISOTROPIC_TV_TL_DPHI    polar angles of V and L; azimuth of L from that of V
    RUSIN_TH_TD_PD          t_h, t_d, p_d of Rusinkiewicz (1998), p_d that of V
    RUSIN_TH_TD, COS_TH_TD  t_h and t_d, or their cosines
    STARK_2D                |shadow of (L + V) / 2 on the surface|, |L - V| / 2

What a parametrisation leaves open is chosen: t_h and t_d alone are taken at p_d = pi/2, where every
pair is above the horizon.
"""

from collections.abc import Callable

import numpy as np

from jaxrender.brdf import HalfDifference
from jaxrender.brdf.tables.isotropic import pair_at
from jaxrender.shapes import Bool, Float

# Vectors this near to unit length are left as they are, so that they come back as written.
_UNIT = 1e-14

Rows = Float[np.ndarray, "row column"]
Pair = tuple[Float[np.ndarray, "row 3"], Float[np.ndarray, "row 3"]]


def meaningless(name: str, found: Rows) -> tuple[Bool[np.ndarray, "row"], str]:
    """Say which rows are no angles in radians, no cosines or no directions, and what is wanted."""
    if name == "CARTESIAN":
        lengths = np.linalg.norm(found.reshape(-1, 2, 3), axis=2)
        return np.abs(lengths - 1).max(axis=1) > 1e-3, "two unit vectors"
    if name == "COS_TH_TD":
        return np.any((found < 0) | (found > 1), axis=1), "cosines from 0 to 1"
    if name == "STARK_2D":
        outside = np.any(found < 0, axis=1) | (np.sum(found**2, axis=1) > 1)
        return outside, "lengths whose squares add up to at most 1"
    return np.any(np.abs(found) > 2 * np.pi + 1e-4, axis=1), "angles in radians"


def _from_cartesian(found: Rows) -> Pair:
    vectors = found.reshape(-1, 2, 3)
    lengths = np.linalg.norm(vectors, axis=2, keepdims=True)
    vectors = np.where(np.abs(lengths - 1) < _UNIT, vectors, vectors / lengths)
    return vectors[:, 0], vectors[:, 1]


def _from_angles(polar: Float[np.ndarray, "row"], azimuth: Float[np.ndarray, "row"]) -> np.ndarray:
    sine = np.sin(polar)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)], axis=-1)


def _from_spherical(found: Rows) -> Pair:
    return _from_angles(found[:, 2], found[:, 3]), _from_angles(found[:, 0], found[:, 1])


def _from_isotropic(found: Rows) -> Pair:
    still = np.zeros(len(found))
    return _from_angles(found[:, 0], still), _from_angles(found[:, 1], found[:, 2])


def _from_half(found: Rows) -> Pair:
    aside = found[:, 2] if found.shape[1] == 3 else np.full(len(found), np.pi / 2)
    return pair_at(HalfDifference(found[:, 0], found[:, 1], aside))


def _from_stark(found: Rows) -> Pair:
    along, across = found.T
    up = np.sqrt(np.maximum(1 - along**2 - across**2, 0))
    return np.stack([along, -across, up], axis=-1), np.stack([along, across, up], axis=-1)


def _spherical(*directions: Float[np.ndarray, "row 3"]) -> Rows:
    angles = []
    for direction in reversed(directions):
        flat = np.hypot(direction[:, 0], direction[:, 1])
        angles += [np.arctan2(flat, direction[:, 2]), np.arctan2(direction[:, 1], direction[:, 0])]
    return np.stack(angles, axis=-1)


def _cartesian(*directions: Float[np.ndarray, "row 3"]) -> Rows:
    return np.concatenate(directions, axis=1)


# How many coordinates, and (V, L) from them.
PARAMETRISATIONS: dict[str, tuple[int, Callable[[Rows], Pair]]] = {
    "CARTESIAN": (6, _from_cartesian),
    "SPHERICAL_TL_PL_TV_PV": (4, _from_spherical),
    "ISOTROPIC_TV_TL_DPHI": (3, _from_isotropic),
    "RUSIN_TH_TD_PD": (3, _from_half),
    "RUSIN_TH_TD": (2, _from_half),
    "COS_TH_TD": (2, lambda found: _from_half(np.arccos(found))),
    "STARK_2D": (2, _from_stark),
}
# Coordinates of (V, L), in the parametrisations that are written.
COORDINATES = {"SPHERICAL_TL_PL_TV_PV": _spherical, "CARTESIAN": _cartesian}
