"""Rows of irradiance by the normal, and of environment maps convolved with a lobe."""

from functools import partial

import numpy as np

from jaxrender import reflection
from jaxrender.harmonics import LatLongGrid

from ..page import Row, Unit
from ..places import normal
from .surface import NORMALS, UP

COEFFICIENTS = {"coefficients": normal(9, 2)}

ROWS = [
    Row(
        "irradiance",
        reflection.irradiance,
        {**COEFFICIENTS, "normals": Unit(NORMALS)},
        {"poles": {"normals": Unit(np.array([UP, -UP]))}},
    ),
    Row("irradiance_matrix", reflection.irradiance_matrix, COEFFICIENTS),
    *(
        Row(name, getattr(reflection, name), {"matrix": normal(2, 4, 4), "normals": Unit(NORMALS)})
        for name in ("matrix_irradiance", "quadratic_irradiance")
    ),
    Row(
        "shadowed_irradiance",
        reflection.shadowed_irradiance,
        {**COEFFICIENTS, "transfer": normal(3, 9)},
    ),
    Row(
        "reflection_maps",
        partial(reflection.reflection_maps, onto=LatLongGrid(4, 8)),
        {"image": normal(6, 12, 2), "transfers": normal(2, 3)},
    ),
]
