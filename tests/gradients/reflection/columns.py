"""Rows of the columns of lobes: by the integral, by slow and mirrored light, and from a table."""

from functools import partial

import numpy as np

from jaxrender import reflection
from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.lighting import LightNodes, SmoothLobes
from jaxrender.reflection import FrameNodes, RoughnessTable, Shadows, ViewFilter
from jaxrender.reflection.knots import ChebyshevNodes, KnotRange

from ..page import Above, Row, Still, Unit
from ..places import normal, unit
from .surface import (
    AT,
    EDGES,
    LIGHT,
    MATERIAL,
    MU,
    NARROW,
    NORMALS,
    OUTGOING,
    SIGMA,
    SLOW,
    SOURCES,
    dual,
    glossy,
    unlit,
)

CHANGES = {
    "sigma .01": NARROW,
    "sigma 1.5": {"sigma": Above(np.array(1.5))},
    "mu 1.001": {"mu": Above(np.array(1.001), 1)},
    "mu 100": {"mu": Above(np.array(100.0), 1)},
}
FRAMES = {"frames": FrameNodes(Unit(SOURCES[:, None]), np.ones((2, 1, 2)), Still(np.array([0, 1])))}
NODES = 12
TABLE_ENDS = "the table over exit cosines has no slope by the angle at its end: 3e-6 of the whole"
BETWEEN_FACETS = "the integral's own derivative, facets at rest: differences see light's texels"
RULE_TURNS = "the rule's nodes lie about a plane of incidence, which head-on may be any"
TURNS_OVER = "the azimuth about R counts from N, which is R"
HEAD_ON_RULE = dict.fromkeys(("head-on", "head-on at the poles"), RULE_TURNS)

# Of the shape of a table over both numbers; what is in it does not matter.
_KNOTS = (
    KnotRange.over(np.log(0.1), np.log(1.0), 8),
    ChebyshevNodes.over(np.log(0.1), np.log(3.0), 8),
)
TABLE = RoughnessTable(normal(2, 1), normal(8, 10, 2, 1), normal(8), np.array([0.8, 0.4]), *_KNOTS)


def _fixed(like):
    """Samples and slow light in the precision of other numbers."""
    parts = (part.astype(like.dtype) for part in (NORMALS, OUTGOING, SLOW["slow"]))
    normals, outgoing, slow = parts
    return SurfaceSamples(normals, outgoing), slow


def _kept(table: RoughnessTable):
    """What is left of a table for one sample, without its knots."""
    one = table.take(np.array([1]))
    return one.diffuse, one.spline, one.exit_cosines


def columns(name: str, call, arguments: dict, edges: dict | None = None, **rest) -> Row:
    """A model's columns, of samples everywhere."""
    return Row(name, call, {**AT, **arguments}, EDGES if edges is None else edges, **rest)


ROWS = [
    columns(
        "integral_columns",
        lambda samples, sigma, mu, directions, irradiance, widths: (
            reflection.integral_columns(
                glossy(sigma, mu), samples, LightNodes(directions, irradiance)
            ),
            reflection.integral_columns(
                glossy(sigma, mu), samples, LightNodes(directions, irradiance), widths=widths
            ),
        ),
        {**SIGMA, **MU, **LIGHT, "widths": Above(np.array([0.1, 0.4]))},
        {**EDGES, **CHANGES, "sources coincide": {"directions": Unit(SOURCES[[0, 0]])}},
    ),
    columns(
        "integral_columns_by_frame",
        lambda samples, sigma, frames: reflection.integral_columns_by_frame(
            glossy(sigma), samples, frames
        ),
        {**SIGMA, **FRAMES},
        {place: EDGES[place] for place in ("normals at the poles", "head-on")},
    ),
    columns(
        "polar_columns",
        lambda samples, sigma, directions, widths: reflection.polar_columns(
            glossy(sigma),
            samples,
            SmoothLobes(directions, widths, np.ones((2, 1), sigma.dtype)).radiance,
            NODES,
        ),
        {**SIGMA, "directions": Unit(unit(2)), "widths": Above(np.array([0.7, 1.0]))},
        kinks=HEAD_ON_RULE,
    ),
    columns(
        "polar_coefficients",
        lambda samples, sigma: reflection.polar_coefficients(glossy(sigma), samples, 2, NODES),
        SIGMA,
        kinks=HEAD_ON_RULE,
    ),
    Row(
        "radiance",
        lambda kd, ks, columns: reflection.radiance(
            Microfacet(kd, ks, columns[0, 0, 0], None), columns
        ),
        {"kd": MATERIAL["kd"], "ks": MATERIAL["ks"], "columns": np.abs(normal(3, 2, 2))},
    ),
    columns(
        "dual_columns",
        lambda samples, sigma, mu, slow, **light: reflection.dual_columns(
            glossy(sigma, mu), samples, dual(slow, **light), "gaussian"
        ),
        {**SIGMA, **MU, **SLOW, **LIGHT},
    ),
    Row(
        "dual_columns",
        lambda samples, sigma, mu, slow: reflection.dual_columns(
            glossy(sigma, mu), samples, dual(slow, *unlit(sigma))
        ),
        {**AT, **SIGMA, **MU, **SLOW},
        CHANGES,
        at="exit-cosine",
    ),
    columns(
        "dual_columns",
        lambda samples, sigma, slow, transfer: reflection.dual_columns(
            glossy(sigma),
            samples,
            dual(slow, *unlit(sigma)),
            "azimuthal-1",
            Shadows(transfer, np.array([True, False]), np.zeros((2, 0), bool)),
        ),
        {**SIGMA, **SLOW, "transfer": normal(2, 9)},
        {place: EDGES[place] for place in ("head-on", "R at the poles")},
        at="in shadow",
        kinks={"head-on": TABLE_ENDS},
    ),
    columns(
        "reflect_slow_light",
        lambda samples, sigma, slow: reflection.reflect_slow_light(glossy(sigma), samples, slow),
        {**SIGMA, "slow": normal(4, 2)},
        kinks=dict.fromkeys(("head-on", "head-on at the poles"), TABLE_ENDS),
    ),
    columns(
        "slow_light_columns",
        lambda samples, sigma: reflection.slow_light_columns(glossy(sigma), samples, 1),
        SIGMA,
        kinks=dict.fromkeys(("head-on", "head-on at the poles"), TABLE_ENDS),
    ),
    columns(
        "mirror_light",
        partial(reflection.mirror_light, order_limit=1),
        SLOW,
        kinks=dict.fromkeys(("head-on", "head-on at the poles"), TURNS_OVER),
    ),
    Row(
        "reflect_mirror_light",
        lambda exit_cosines, light, sigma: tuple(
            reflection.reflect_mirror_light(
                glossy(sigma), exit_cosines, light, ViewFilter(1, expanded)
            )
            for expanded in (True, False)
        ),
        {"exit_cosines": np.array([0.8, 0.35]), "light": normal(2, 3, 2, 1), **SIGMA},
    ),
    Row(
        "reflect_by_facets",
        lambda sigma, widths: (
            reflection.reflect_by_facets(glossy(sigma), *_fixed(sigma)),
            reflection.reflect_by_facets(glossy(sigma), *_fixed(sigma), widths),
        ),
        {**SIGMA, "widths": Above(np.array([0.1, 0.4]))},
        kinks={"random": BETWEEN_FACETS},
    ),
    columns(
        "facet_coefficients",
        lambda samples, sigma: reflection.facet_coefficients(glossy(sigma), samples, 2),
        SIGMA,
    ),
    Row(
        "RoughnessTable.specular",
        lambda diffuse, spline, log_scale, exit_cosines, sigma, mu: RoughnessTable(
            diffuse, spline, log_scale, exit_cosines, TABLE.log_sigma, TABLE.log_mu
        ).specular(sigma, mu),
        {
            "diffuse": np.asarray(TABLE.diffuse),
            "spline": np.asarray(TABLE.spline),
            "log_scale": np.asarray(TABLE.log_scale),
            "exit_cosines": np.asarray(TABLE.exit_cosines),
            **SIGMA,
            **MU,
        },
    ),
    Row(
        "RoughnessTable.take",
        lambda **table: _kept(
            RoughnessTable(**table, log_sigma=TABLE.log_sigma, log_mu=TABLE.log_mu)
        ),
        {
            "diffuse": np.asarray(TABLE.diffuse),
            "spline": np.asarray(TABLE.spline),
            "log_scale": np.asarray(TABLE.log_scale),
            "exit_cosines": np.asarray(TABLE.exit_cosines),
        },
    ),
]
