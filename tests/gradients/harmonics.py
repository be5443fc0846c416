"""Rows of ``jaxrender.harmonics``."""

from functools import partial

import numpy as np

from jaxrender import harmonics
from jaxrender.geometry import rotation
from jaxrender.harmonics import (
    AngularMapGrid,
    CubeGrid,
    GaussLegendreGrid,
    LatLongGrid,
    RotationGrid,
)

from .page import Row, Turn, Unit
from .places import POLES, complex_normal, normal, repeated, unit

LIMIT = 3
COUNT = (LIMIT + 1) ** 2
GRIDS = {
    "latitude-longitude": LatLongGrid(7, 14),
    "Gauss-Legendre": GaussLegendreGrid(4, 8),
    "cube": CubeGrid(6),
    "ball map": AngularMapGrid(13),
}
LATLONG, CUBE = GRIDS["latitude-longitude"], GRIDS["cube"]
GROUP = RotationGrid(2)
COEFFICIENTS = normal(COUNT, 2)
LOCKED = "gimbal lock"
ROTATIONS = {
    "random": rotation(np.array([0.7, 2.0]), np.array([0.4, 4.0]), np.array([1.2, 3.0])),
    LOCKED: rotation(np.zeros(2), np.array([0.0, 0.7]), np.array([0.0, 0.4])),
    "gimbal lock upside down": rotation(np.full(2, np.pi), np.array([0.0, 0.7]), np.zeros(2)),
}
ROTATIONS = {place: np.asarray(matrices) for place, matrices in ROTATIONS.items()}
TURNS = {place: {"world_from_local": Turn(turns)} for place, turns in ROTATIONS.items()}
ANGLES = {name: np.random.default_rng(3 + k).uniform(0.3, 2.8, 2) for k, name in enumerate("abg")}
BY_ANGLE = {"alpha": ANGLES["a"], "beta": ANGLES["b"], "gamma": ANGLES["g"]}
STRAIGHT = {LOCKED: {"alpha": np.zeros(2)}, "upside down": {"alpha": np.full(2, np.pi)}}
TO_POLES = {place: {"directions": Unit(repeated(pole))} for place, pole in POLES.items()}
NO_SLOPE = "the interpolant has no derivative at a pole: that of half a texel away"


def _of_grids(function: str, argument: str) -> list[Row]:
    """A transform on every kind of grid, whose images it is linear in."""
    call = getattr(harmonics, function)
    rows = []
    for name, grid in GRIDS.items():
        if argument == "image":
            limit = min(LIMIT, grid.band_limit)
            own = partial(lambda grid, limit, image: call(grid, image, limit), grid, limit)
            rows.append(Row(function, own, {"image": normal(*grid.shape, 2)}, at=name))
        else:
            own = partial(lambda grid, coefficients: call(grid, coefficients), grid)
            rows.append(Row(function, own, {"coefficients": COEFFICIENTS}, at=name))
    return rows


ROWS = [
    Row(
        "real_basis",
        partial(harmonics.real_basis, band_limit=LIMIT),
        {"directions": Unit(unit(2))},
        TO_POLES,
    ),
    Row(
        "real_basis",
        partial(harmonics.real_basis, band_limit=0),
        {"directions": Unit(unit(2))},
        TO_POLES,
        at="degree 0",
    ),
    Row("explicit_basis", harmonics.explicit_basis, {"directions": Unit(unit(2))}, TO_POLES),
    Row(
        "complex_basis",
        partial(harmonics.complex_basis, band_limit=LIMIT),
        {"directions": Unit(unit(2))},
        TO_POLES,
    ),
    Row(
        "evaluate",
        harmonics.evaluate,
        {"coefficients": COEFFICIENTS, "directions": Unit(unit(2))},
        TO_POLES,
    ),
    Row(
        "evaluate",
        harmonics.evaluate,
        {"coefficients": normal(1, 2), "directions": Unit(unit(2))},
        TO_POLES,
        at="degree 0",
    ),
    Row(
        "degree_table",
        harmonics.degree_table,
        {"coefficients": COEFFICIENTS, "directions": Unit(unit(2))},
        TO_POLES,
    ),
    Row(
        "legendre",
        partial(harmonics.legendre, band_limit=6),
        {"cosines": np.array([0.3, -0.7])},
        {"the ends": {"cosines": np.array([1.0, -1.0])}, "0": {"cosines": np.zeros(2)}},
    ),
    Row("complex_from_real", harmonics.complex_from_real, {"coefficients": COEFFICIENTS}),
    Row("real_from_complex", harmonics.real_from_complex, {"coefficients": complex_normal(9, 2)}),
    Row(
        "apply_transfer",
        harmonics.apply_transfer,
        {"coefficients": COEFFICIENTS, "transfer": normal(LIMIT + 1)},
    ),
    Row(
        "rotate",
        harmonics.rotate,
        {"coefficients": COEFFICIENTS, **TURNS["random"]},
        {place: TURNS[place] for place in list(TURNS)[1:]},
    ),
    Row(
        "rotate",
        harmonics.rotate,
        {"coefficients": normal(1, 2), **TURNS["random"]},
        at="degree 0",
    ),
    Row(
        "reflect",
        lambda coefficients, world_from_local: harmonics.reflect(coefficients, -world_from_local),
        {"coefficients": COEFFICIENTS, **TURNS["random"]},
        {place: TURNS[place] for place in list(TURNS)[1:]},
    ),
    Row(
        "rotation_matrices",
        partial(harmonics.rotation_matrices, band_limit=2),
        TURNS["random"],
        {place: TURNS[place] for place in list(TURNS)[1:]},
    ),
    Row(
        "rotate_by_angles",
        harmonics.rotate_by_angles,
        {"coefficients": COEFFICIENTS, **BY_ANGLE},
        STRAIGHT,
    ),
    Row(
        "small_d",
        partial(harmonics.small_d, band_limit=LIMIT),
        {"angles": ANGLES["a"]},
        {"0": {"angles": np.zeros(2)}, "pi": {"angles": np.full(2, np.pi)}},
    ),
    Row("representation", partial(harmonics.representation, band_limit=2), BY_ANGLE, STRAIGHT),
    Row(
        "circle_basis",
        partial(harmonics.circle_basis, band_limit=LIMIT),
        {"angles": ANGLES["a"]},
        {"0": {"angles": np.zeros(2)}},
    ),
    Row(
        "analyse_circle",
        partial(harmonics.analyse_circle, band_limit=LIMIT),
        {"samples": normal(8, 2)},
    ),
    Row(
        "synthesise_circle",
        partial(harmonics.synthesise_circle, count=8),
        {"coefficients": complex_normal(7, 2)},
    ),
    Row(
        "rotate_circle",
        harmonics.rotate_circle,
        {"coefficients": complex_normal(7, 2), "angle": ANGLES["b"]},
    ),
    Row(
        "reflect_circle",
        harmonics.reflect_circle,
        {"light": complex_normal(7, 1), "transfer": complex_normal(7, 2, seed=1)},
    ),
    *_of_grids("analyse", "image"),
    *_of_grids("synthesise", "coefficients"),
    *_of_grids("analyse_dense", "image")[:1],
    *_of_grids("synthesise_dense", "coefficients")[:1],
    Row(
        "analyse_rotations",
        partial(harmonics.analyse_rotations, GROUP, band_limit=2),
        {"samples": complex_normal(*GROUP.shape)},
    ),
    Row(
        "synthesise_rotations",
        partial(harmonics.synthesise_rotations, GROUP),
        {"coefficients": complex_normal(3, 5, 5)},
    ),
    *(
        Row(
            name,
            getattr(harmonics, name),
            {"first": complex_normal(3, 5, 5), "second": complex_normal(3, 5, 5, seed=1)},
        )
        for name in ("convolve_rotations", "correlate_rotations")
    ),
    Row(
        "change_grid",
        lambda image: harmonics.change_grid(LATLONG, image, GRIDS["Gauss-Legendre"], LIMIT),
        {"image": normal(*LATLONG.shape, 2)},
    ),
    Row(
        "resample",
        lambda image: harmonics.resample(LATLONG, image, GRIDS["Gauss-Legendre"]),
        {"image": normal(*LATLONG.shape, 2)},
    ),
    Row("over_poles", harmonics.over_poles, {"image": normal(4, 8, 2)}),
    Row(
        "looked_up",
        harmonics.looked_up,
        {"padded": normal(6, 8, 2), "directions": Unit(unit(2))},
        TO_POLES,
        kinks=dict.fromkeys(TO_POLES, NO_SLOPE),
    ),
    Row(
        "interpolated",
        harmonics.interpolated,
        {"padded": normal(6, 8, 2), "directions": Unit(unit(2))},
    ),
    Row(
        "off_pole",
        partial(harmonics.off_pole, rows=8),
        {"directions": Unit(unit(2))},
        TO_POLES,
        kinks=dict.fromkeys(TO_POLES, "it moves what is nearer than a texel, not what is further"),
    ),
    Row(
        "looked_up_on_cube",
        partial(harmonics.looked_up_on_cube, CUBE),
        {"image": normal(*CUBE.shape, 2), "directions": Unit(unit(2))},
        TO_POLES,
    ),
]

_WHOLE = "of whole numbers"
_ON_HOST = "a table, made on the host from whole numbers"
_STATIC = "a static description: the arrays that it gives are made on the host from whole numbers"
EXCEPTIONS = {
    **dict.fromkeys(("band_limit_of", "coefficient_count", "degrees", "orders"), _WHOLE),
    **dict.fromkeys(("flat_index", "circle_angles", "quarter_turn"), _ON_HOST),
    "associated": "NumPy on the host: the tables of the transforms; legendre is the traced one",
    **dict.fromkeys(
        ("halving_strength", "hann", "lanczos", "minimal"), "weights, on the host, from few numbers"
    ),
    **dict.fromkeys(
        ("minimal_strength", "ringing", "window_named"), "a search on the host, for one lobe"
    ),
    "over_poles.signs": "plus and minus one",
    **dict.fromkeys(("hann", "lanczos", "minimal", "halving_strength"), _ON_HOST),
    **dict.fromkeys(
        ("ringing", "minimal_strength", "window_named"),
        "a search on the host for the lowest value of a lobe, and for a window by it",
    ),
    "transfer_of": "a quadrature on the host of a profile that is given as a NumPy function",
    **dict.fromkeys(
        (
            "AngularMapGrid",
            "CubeGrid",
            "GaussLegendreGrid",
            "Grid",
            "LatLongGrid",
            "RotationGrid",
            "SeparableGrid",
        ),
        _STATIC,
    ),
}
