"""Rows of the convolution theorem, in each of its forms."""

import numpy as np

from jaxrender import reflection
from jaxrender.reflection import SurfacePoints

from ..page import Row, Turn, Unit
from ..places import complex_normal, normal, unit
from .surface import LOCKED_TURNS, TURNS

POINTS = SurfacePoints(
    np.array([0.7, 2.0]), np.array([0.4, 4.0]), np.array([1.2, 3.0]), Unit(unit(2, seed=8))
)
LOCKED = {"gimbal lock": {"points": POINTS._replace(alpha=np.zeros(2))}}
COMPLEX = complex_normal(9, 2)

ROWS = [
    Row(
        "reflect_about_mirror",
        reflection.reflect_about_mirror,
        {"light": normal(9, 2), "terms": normal(2, 3, 3), "world_from_mirror": Turn(TURNS)},
        {"gimbal lock": {"world_from_mirror": Turn(LOCKED_TURNS)}},
    ),
    Row(
        "convolve_radial",
        reflection.convolve_radial,
        {"light": normal(9, 2), "transfer": normal(3)},
    ),
    Row(
        "convolve_isotropic",
        reflection.convolve_isotropic,
        {"light": COMPLEX, "transfer": complex_normal(3, 2, 2, 1)},
    ),
    Row(
        "evaluate_isotropic",
        reflection.evaluate_isotropic,
        {"field": complex_normal(3, 5, 2, 3, 1), "points": POINTS},
        LOCKED,
    ),
    Row(
        "convolve_at_exit",
        reflection.convolve_at_exit,
        {"light": COMPLEX, "transfer": complex_normal(2, 3, 3, 1)},
    ),
    Row(
        "evaluate_at_exit",
        lambda field, points: reflection.evaluate_at_exit(field, np.array([1, 0]), points),
        {"field": complex_normal(2, 3, 5, 5, 1), "points": POINTS},
        LOCKED,
    ),
    Row(
        "convolve_at_direction",
        reflection.convolve_at_direction,
        {"light": complex_normal(4, 1), "transfer": complex_normal(2, 4, 1)},
    ),
    Row(
        "evaluate_at_direction",
        lambda field, points: reflection.evaluate_at_direction(field, np.array([1, 0]), points),
        {"field": complex_normal(2, 2, 3, 3, 1), "points": POINTS},
        LOCKED,
    ),
    Row(
        "convolve_anisotropic",
        reflection.convolve_anisotropic,
        {"light": complex_normal(4, 1), "transfer": complex_normal(4, 4, 1)},
    ),
    Row(
        "evaluate_anisotropic",
        reflection.evaluate_anisotropic,
        {"field": complex_normal(2, 3, 3, 2, 3, 1), "points": POINTS},
        LOCKED,
    ),
    Row(
        "convolve_flatland",
        reflection.convolve_flatland,
        {"light": complex_normal(5), "transfer": complex_normal(5, 3)},
    ),
    Row(
        "evaluate_flatland",
        reflection.evaluate_flatland,
        {"field": complex_normal(5, 3), "alpha": normal(2), "outgoing": normal(2)},
    ),
]
