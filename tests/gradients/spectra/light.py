"""Rows of the coefficients of lights."""

from functools import partial

import numpy as np

from jaxrender import spectra
from jaxrender.lighting import ClearSky, DirectionalSources, Environment, HarmonicLight, OvercastSky

from ..page import Above, Row, Unit
from ..places import POLES, normal, unit

AXES = {place: {"axis": Unit(pole)} for place, pole in POLES.items()}
AXIS = {"axis": Unit(unit(1)[0])}
SUN = np.array([0.48, 0.36, 0.8])
COLOUR = np.array([0.7, 1.2])

ROWS = [
    Row(
        "directional_coefficients",
        partial(spectra.directional_coefficients, band_limit=3),
        {"direction": Unit(unit(1)[0]), "irradiance": COLOUR},
        {place: {"direction": Unit(pole)} for place, pole in POLES.items()},
    ),
    Row(
        "zonal_coefficients",
        spectra.zonal_coefficients,
        {"transfer": normal(4, 2), **AXIS},
        AXES,
    ),
    Row(
        "axial_coefficients",
        lambda axis: spectra.axial_coefficients(lambda c: np.exp(2 * c), axis, 3),
        AXIS,
        AXES,
    ),
    Row(
        "uniform_coefficients",
        partial(spectra.uniform_coefficients, band_limit=2),
        {"radiance": COLOUR},
    ),
    Row(
        "overcast_coefficients",
        lambda zenith: spectra.overcast_coefficients(OvercastSky(zenith), 3),
        {"zenith": COLOUR},
    ),
    Row(
        "clear_coefficients",
        lambda sun, zenith: spectra.clear_coefficients(ClearSky(sun, zenith), 3),
        {"sun": Unit(SUN), "zenith": COLOUR},
        {
            "overhead": {"sun": Unit(POLES["+Z"])},
            "low": {"sun": Unit(np.array([0.8, -0.6, 0.0]) * np.cos(0.05) + [0, 0, np.sin(0.05)])},
        },
        kinks={"overhead": "in parts of the radiance at the zenith, which has a cusp at the sun"},
    ),
    Row(
        "light_coefficients",
        lambda radiance, coefficients, directions, irradiance, zenith: tuple(
            spectra.light_coefficients(light, 2)
            for light in (
                Environment(radiance),
                HarmonicLight(coefficients),
                DirectionalSources(directions, irradiance),
                OvercastSky(zenith),
            )
        ),
        {
            "radiance": Above(np.random.default_rng(0).uniform(0.1, 2, (5, 10, 2))),
            "coefficients": normal(4, 2),
            "directions": Unit(unit(2)),
            "irradiance": normal(2, 2),
            "zenith": COLOUR,
        },
        {
            "sources at the poles": {"directions": Unit(np.stack(list(POLES.values())))},
        },
    ),
]
