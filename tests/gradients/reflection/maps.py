"""Rows of spherical harmonic reflection maps: how they are made, changed and looked up in."""

import numpy as np

from jaxrender import reflection
from jaxrender.harmonics import CubeGrid, LatLongGrid
from jaxrender.reflection import (
    AzimuthalTexture,
    GlobalShrm,
    IcosahedralMaps,
    LightFieldTable,
    LocalShrm,
)
from jaxrender.spectra import CentralSpectrum

from ..page import Row, Turn, Unit
from ..places import normal, unit
from .surface import LOCKED_TURNS, TURNS, UP

SPECTRUM = {"rho": normal(4, 3, 3, 1)}
GRID = LatLongGrid(12, 24)
MAPS = {"maps": normal(*GRID.shape, 4, 1)}
AROUND = {"centres": Unit(unit(2, seed=5)), "outgoing": Unit(unit(2, seed=6))}
AT_POLES = {"at the poles": {"centres": Unit(np.array([UP, -UP]))}}
COINCIDENT = {"coincident": {"outgoing": Unit(unit(2, seed=5))}}
NO_SLOPE = "a map between texels has no derivative at a pole: that of half a texel away"
KINKS = {"at the poles": NO_SLOPE}


def spectrum(rho) -> CentralSpectrum:
    """A spectrum of these coefficients, unweighted."""
    return CentralSpectrum(rho, rho[0, 0, 0])


ROWS = [
    Row(
        "central_coefficients",
        lambda light, rho, world_from_central: reflection.central_coefficients(
            light, spectrum(rho), world_from_central
        ),
        {"light": normal(16, 1), **SPECTRUM, "world_from_central": Turn(TURNS)},
        {"gimbal lock": {"world_from_central": Turn(LOCKED_TURNS)}},
    ),
    Row(
        "local_shrm",
        lambda light, rho: reflection.local_shrm(light, spectrum(rho), GRID).maps,
        {"light": normal(16, 1), **SPECTRUM},
    ),
    Row(
        "global_shrm",
        lambda maps: reflection.global_shrm(LocalShrm(maps, GRID, 2)).maps,
        MAPS,
    ),
    Row(
        "local_from_global",
        lambda maps: reflection.local_from_global(GlobalShrm(maps, GRID, 2)).maps,
        MAPS,
    ),
    *(
        Row(
            f"{kind.__name__}.at",
            lambda maps, centres, outgoing, kind=kind: kind(maps, GRID, 2, True).at(
                centres, outgoing
            ),
            {**MAPS, **AROUND},
            {**AT_POLES, **COINCIDENT},
            kinks=KINKS,
        )
        for kind in (GlobalShrm, LocalShrm)
    ),
    Row(
        "GlobalShrm.at",
        lambda maps, centres, outgoing: GlobalShrm(maps, CubeGrid(4), 1).at(centres, outgoing),
        {"maps": normal(*CubeGrid(4).shape, 4, 1), **AROUND},
        AT_POLES,
        at="cube",
    ),
    Row(
        "GlobalShrm.viewer",
        lambda maps, centres, outgoing: GlobalShrm(maps, GRID, 2).viewer(centres, outgoing),
        {**MAPS, **AROUND},
    ),
    Row(
        "LocalShrm.viewer",
        lambda maps, centres, outgoing: LocalShrm(maps, GRID, 2).viewer(centres, outgoing),
        {**MAPS, **AROUND},
        AT_POLES,
        kinks={"at the poles": "the frames of T 2.10 turn about a pole"},
    ),
    Row(
        "GlobalShrm.dynamic_map",
        lambda maps, outgoing: GlobalShrm(maps, GRID, 2).dynamic_map(outgoing),
        {**MAPS, "outgoing": Unit(unit(1)[0])},
    ),
    Row(
        "GlobalShrm.on",
        lambda maps: GlobalShrm(maps, GRID, 2).on(CubeGrid(6)).maps,
        MAPS,
    ),
    Row(
        "PrincipalMaps.expanded",
        lambda maps, viewers: reflection.PrincipalMaps(maps, viewers, np.ones(4)).expanded(),
        {"maps": normal(4, 8, 2, 1), "viewers": normal(2, 4)},
    ),
    Row(
        "IcosahedralMaps.at",
        lambda maps, centres, outgoing: IcosahedralMaps(maps, True).at(centres, outgoing),
        {"maps": normal(12, 6, 12, 1), **AROUND},
        {**AT_POLES, **COINCIDENT},
        kinks=KINKS,
    ),
    Row(
        "AzimuthalTexture.at",
        lambda maps, centres, outgoing: AzimuthalTexture(maps).at(centres, outgoing),
        {"maps": normal(5, 6, 12, 1), **AROUND},
        {**AT_POLES, **COINCIDENT},
        kinks={**KINKS, "coincident": "the angle between R and V is nowhere negative"},
    ),
    Row(
        "LightFieldTable.shrm",
        lambda values: LightFieldTable(values).shrm(1, 2).maps,
        {"values": normal(3, 4, 6, 12, 1)},
    ),
]
