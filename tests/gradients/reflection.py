"""Rows of ``jaxrender.reflection``."""

from functools import partial

import numpy as np

from jaxrender import reflection
from jaxrender.brdf import Microfacet
from jaxrender.geometry import Orthographic, Sphere, SurfaceSamples, observe, rotation
from jaxrender.harmonics import CubeGrid, LatLongGrid
from jaxrender.lighting import DirectionalSources, LightNodes, SmoothLobes
from jaxrender.reflection import (
    AzimuthalTexture,
    DualForward,
    DualLight,
    ExactForward,
    FrameNodes,
    GlobalShrm,
    IcosahedralMaps,
    LightFieldTable,
    LocalShrm,
    RoughnessTable,
    Shadows,
    SurfacePoints,
    ViewFilter,
)
from jaxrender.reflection.tabulated import KnotRange
from jaxrender.spectra import CentralSpectrum

from .page import Above, Row, Still, Turn, Unit
from .places import POLES, complex_normal, normal, unit

UP = POLES["+Z"]


def samples(normals, outgoing) -> SurfaceSamples:
    """Unit normals and outgoing directions that both move."""
    return SurfaceSamples(Unit(np.asarray(normals)), Unit(np.asarray(outgoing)))


def leaning(normals, cosine: float, seed: int = 0):
    """Directions at a stated cosine to the normals."""
    across = np.cross(normals, unit(len(normals), seed=7 + seed))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return cosine * normals + np.sqrt(1 - cosine**2) * across


NORMALS = unit(2, seed=1)
OUTGOING = leaning(NORMALS, 0.6)
# Where the reflected direction is a pole of the world.
TO_POLE = np.stack([leaning(UP[None], 0.8)[0], leaning(-UP[None], 0.7)[0]])
REFLECTED = 2 * np.sum(TO_POLE * [UP, -UP], axis=1, keepdims=True) * TO_POLE - [UP, -UP]
AT = {"samples": samples(NORMALS, OUTGOING)}
PLACES = {
    "normals at the poles": samples([UP, -UP], leaning(np.array([UP, -UP]), 0.6)),
    "head-on": samples(NORMALS, NORMALS),
    "head-on at the poles": samples([UP, -UP], [UP, -UP]),
    "R at the poles": samples(TO_POLE, REFLECTED),
    "grazing": samples(NORMALS, leaning(NORMALS, 0.055)),
}
EDGES = {place: {"samples": value} for place, value in PLACES.items()}
SIGMA = {"sigma": Above(np.array(0.3))}
MU = {"mu": Above(np.array(1.5), 1)}
MATERIAL = {"kd": np.array([0.2, 0.1]), "ks": np.array([0.4, 0.5]), **SIGMA, **MU}
# Sources near the mirrors' directions, so that narrow lobes are seen.
MIRRORS = 2 * np.sum(NORMALS * OUTGOING, axis=1, keepdims=True) * NORMALS - OUTGOING
SOURCES = MIRRORS + 0.01 * normal(2, 3)
SOURCES /= np.linalg.norm(SOURCES, axis=1, keepdims=True)
LIGHT = {"directions": Unit(SOURCES), "irradiance": np.abs(normal(2, 2)) + 0.2}
NARROW = {"sigma": Above(np.array(0.01))}
CHANGES = {
    "sigma .01": NARROW,
    "sigma 1.5": {"sigma": Above(np.array(1.5))},
    "mu 1.001": {"mu": Above(np.array(1.001), 1)},
    "mu 100": {"mu": Above(np.array(100.0), 1)},
}
SLOW = {"slow": normal(9, 2)}
COEFFICIENTS = {"coefficients": normal(9, 2)}


def glossy(sigma, mu=None, **static) -> Microfacet:
    """A lobe without a base, of one channel."""
    white = np.ones(1, sigma.dtype)
    return Microfacet(0 * white, white, sigma, mu, **static)


def _fixed(like):
    """Samples and slow light in the precision of other numbers."""
    parts = (part.astype(like.dtype) for part in (NORMALS, OUTGOING, SLOW["slow"]))
    normals, outgoing, slow = parts
    return SurfaceSamples(normals, outgoing), slow


def _unlit(like):
    """No sources, in the precision of other numbers."""
    return np.zeros((0, 3), like.dtype), np.zeros((0, 2), like.dtype)


def dual(slow, directions, irradiance) -> DualLight:
    """Slow light and sources."""
    return DualLight(slow, DirectionalSources(directions, irradiance))


POSE = np.array([[1, 0, 0, 0.1], [0, 1, 0, 0.2], [0, 0, 1, 5], [0, 0, 0, 1.0]])
CAMERA, BALL = Orthographic(3, 3, POSE, scale=0.4), Sphere(np.zeros(3), 1.0)
VIEW = observe(CAMERA, BALL)
HIT_NORMALS = np.where(VIEW.hit[..., None], VIEW.normals, UP)
SEEN = {"normals": Unit(HIT_NORMALS)}


def _view(normals):
    outgoing = VIEW.outgoing.astype(normals.dtype)
    return VIEW._replace(normals=normals, outgoing=outgoing)


def _rendered(function):
    """An image by material, normals and the nodes of a light."""

    def call(kd, ks, sigma, mu, normals, directions, irradiance):
        model = ExactForward(LightNodes(directions, irradiance))
        return function(Microfacet(kd, ks, sigma, mu), _view(normals), model)

    return call


def _images(brdf, view, model):
    return tuple(reflection.render_views(brdf, [view, view], model))


def _from_camera(picture):
    """An image of the ball by material and sources."""

    def call(kd, ks, sigma, mu, irradiance):
        # Its own geometry is in double precision, and so is the image; a view may be in single.
        parts = (part.astype(np.float64) for part in (kd, ks, sigma, mu, irradiance))
        kd, ks, sigma, mu, energy = parts
        image = picture(Microfacet(kd, ks, sigma, mu), energy)
        return image.astype(irradiance.dtype)

    return call


def _by_nodes(brdf, energy):
    return reflection.render(brdf, CAMERA, BALL, ExactForward(LightNodes(SOURCES, energy)))


def _by_a_light(brdf, energy):
    return reflection.render_lit(brdf, DirectionalSources(SOURCES, energy), BALL, CAMERA)


FRAMES = {"frames": FrameNodes(Unit(SOURCES[:, None]), np.ones((2, 1, 2)), Still(np.array([0, 1])))}
LIMITS = (3, 2)
SPECTRUM = {"rho": normal(4, 3, 3, 1)}
GRID = LatLongGrid(12, 24)
MAPS = {"maps": normal(*GRID.shape, 4, 1)}
AROUND = {"centres": Unit(unit(2, seed=5)), "outgoing": Unit(unit(2, seed=6))}
AT_POLES = {"at the poles": {"centres": Unit(np.array([UP, -UP]))}}
COINCIDENT = {"coincident": {"outgoing": Unit(unit(2, seed=5))}}
NO_SLOPE = "a map between texels has no derivative at a pole: that of half a texel away"
KINKS = {"at the poles": NO_SLOPE}
POINTS = SurfacePoints(
    np.array([0.7, 2.0]), np.array([0.4, 4.0]), np.array([1.2, 3.0]), Unit(unit(2, seed=8))
)
LOCKED = {"gimbal lock": {"points": POINTS._replace(alpha=np.zeros(2))}}
TURNS = np.asarray(rotation(np.array([0.7, 2.0]), np.array([0.4, 4.0]), np.array([1.2, 3.0])))
LOCKED_TURNS = np.asarray(rotation(np.array([0.0, np.pi]), np.array([0.4, 4.0]), np.zeros(2)))
COMPLEX = complex_normal(9, 2)
NODES = 12
TABLE_ENDS = "the table over exit cosines has no slope by the angle at its end: 3e-6 of the whole"
BETWEEN_FACETS = "the integral's own derivative, facets at rest: differences see light's texels"
RULE_TURNS = "the rule's nodes lie about a plane of incidence, which head-on may be any"
TURNS_OVER = "the azimuth about R counts from N, which is R"


# Of the shape of a table over both numbers; what is in it does not matter.
_KNOTS = KnotRange.over(np.log(0.1), np.log(1.0), 8), KnotRange.over(np.log(0.1), np.log(3.0), 8)
TABLE = RoughnessTable(normal(2, 1), normal(10, 10, 2, 1), np.array([0.8, 0.4]), *_KNOTS)


HEAD_ON_RULE = dict.fromkeys(("head-on", "head-on at the poles"), RULE_TURNS)


def _kept(table: RoughnessTable):
    """What is left of a table for one sample, without its knots."""
    one = table.take(np.array([1]))
    return one.diffuse, one.spline, one.exit_cosines


def spectrum(rho) -> CentralSpectrum:
    """A spectrum of these coefficients, unweighted."""
    return CentralSpectrum(rho, rho[0, 0, 0])


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
            glossy(sigma, mu), samples, dual(slow, *_unlit(sigma))
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
            dual(slow, *_unlit(sigma)),
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
        lambda diffuse, spline, exit_cosines, sigma, mu: RoughnessTable(
            diffuse, spline, exit_cosines, TABLE.log_sigma, TABLE.log_mu
        ).specular(sigma, mu),
        {
            "diffuse": np.asarray(TABLE.diffuse),
            "spline": np.asarray(TABLE.spline),
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
            "exit_cosines": np.asarray(TABLE.exit_cosines),
        },
    ),
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
    Row(
        "render_samples",
        lambda samples, kd, ks, sigma, mu, slow, **light: reflection.render_samples(
            Microfacet(kd, ks, sigma, mu), samples, DualForward(dual(slow, **light), "gaussian")
        ),
        {**AT, **MATERIAL, **SLOW, **LIGHT},
        {"head-on at the poles": EDGES["head-on at the poles"], "sigma .01": NARROW},
    ),
    Row(
        "DualForward.columns",
        lambda samples, sigma, slow: DualForward(dual(slow, *_unlit(sigma)), "gaussian").columns(
            glossy(sigma), samples
        ),
        {**AT, **SIGMA, **SLOW},
    ),
    Row(
        "ExactForward.columns",
        lambda samples, sigma, directions, irradiance: ExactForward(
            LightNodes(directions, irradiance)
        ).columns(glossy(sigma), samples),
        {**AT, **SIGMA, **LIGHT},
    ),
    *(
        Row(name, _rendered(function), {**MATERIAL, **SEEN, **LIGHT})
        for name, function in (
            ("render_view", reflection.render_view),
            ("render_views", _images),
            ("sensitivities", reflection.sensitivities),
        )
    ),
    Row("render", _from_camera(_by_nodes), {**MATERIAL, "irradiance": LIGHT["irradiance"]}),
    Row("render_lit", _from_camera(_by_a_light), {**MATERIAL, "irradiance": LIGHT["irradiance"]}),
    Row(
        "render_widths",
        lambda samples, widths, ks, mu, directions, irradiance: reflection.render_widths(
            Microfacet(ks, ks, widths[0], mu),
            widths,
            samples,
            ExactForward(LightNodes(directions, irradiance)),
        ),
        {**AT, "widths": Above(np.array([0.1, 0.4])), "ks": MATERIAL["ks"], **MU, **LIGHT},
    ),
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

_SIGHT = "traces rays on the host: what is seen changes in steps"
_NUMBERS = "numbers, no function: what takes them has a row"
_LINEAR = "linear algebra on the host, of all photographs or pixels together"
_COUNT = "chooses or counts on the host"
EXCEPTIONS = {
    "dual_columns.widths": "handed on to integral_columns and reflect_by_facets",
    "integral_columns_by_frame.widths": "handed on as by integral_columns",
    "reflect_by_facets.slow": "a constant by intent: it is drawn as an image that is looked up in",
    **dict.fromkeys(("cast_shadows", "visible_nodes", "transfer_vectors"), _SIGHT),
    **dict.fromkeys(("ShadowedDual", "ShadowedForward", "ShadowedModel"), _SIGHT),
    "forward_of": "chooses a model, whose rows those are; test_lit differentiates by the light",
    "ForwardModel": "what a model is: its rows are those of the two",
    "Shrm": "what a map is: its rows are those of the two",
    **dict.fromkeys(
        (
            "DualLight",
            "FrameNodes",
            "DualGoal",
            "IrradianceError",
            "Quadrature",
            "RecoveredBasis",
            "Shadows",
            "SourcesNeeded",
            "SphereFit",
            "SurfacePoints",
            "TransferVectors",
            "ViewFilter",
            "ViewerGoal",
            "ViewerRule",
        ),
        _NUMBERS,
    ),
    **dict.fromkeys(
        (
            "PrincipalComponents",
            "basis_from_photographs",
            "basis_images",
            "principal_components",
            "relit",
            "principal_maps",
            "shrm_from_photographs",
        ),
        _LINEAR,
    ),
    **dict.fromkeys(
        ("dual_light", "filled_up", "irradiance_error", "least_rows", "sources_needed"), _COUNT
    ),
    "quadratic_constants": "five numbers",
    "polar_nodes_for": "counts nodes on the host",
    "flatland_coefficients": "a quadrature of a function of angles that is given",
    "interpolated": "on the host, by the faces that places lie on",
    "reflection_map_by_sum": "the twin on the host, of a profile that is a NumPy function",
    "roughness_table": "tabulates on the host; RoughnessTable.specular is what is differentiated",
}
