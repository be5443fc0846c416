"""Rows of ``jaxrender.lighting``."""

import numpy as np

from jaxrender.geometry import rotation
from jaxrender.lighting import (
    AngularIntensity,
    ClearSky,
    ConeIntensity,
    DirectionalSources,
    Environment,
    Flaps,
    HarmonicLight,
    IsotropicIntensity,
    OvercastSky,
    PointLight,
    PointSources,
    SmoothLobes,
    SpotIntensity,
)

from .page import Above, Row, Turn, Unit
from .places import POLES, normal, repeated, unit

COLOUR = np.array([0.7, 1.2])
UPPER = unit(2, seed=3) * np.array([1, 1, 0]) + np.array([0, 0, 0.4])
UPPER /= np.linalg.norm(UPPER, axis=1, keepdims=True)
SUN = np.array([0.48, 0.36, 0.8])
OVERHEAD = np.array([0.0, 0.0, 1.0])
LUMINAIRE = {
    "horizontal": np.array([0.2, 1.5, 4.0]),
    "vertical": np.array([0.1, 0.9, 2.0, 3.0]),
    "values": np.abs(normal(3, 4, 2)),
}
# Between the nodes above, on the path of every step.
WITHIN = np.array([[0.5, 0.4, -0.76811457], [-0.3, 0.6, 0.74161985]])
ON_AXIS = "the azimuth of the table has no value on the axis"
AT_ZENITH = "in parts of the radiance at the zenith, which has a cusp where the sun is"
LOBES = {
    "directions": Unit(unit(2, seed=4)),
    "widths": Above(np.array([0.05, 1.0])),
    "middle": normal(2, 2),
}
IMAGE = Above(np.random.default_rng(0).uniform(0.1, 2, (3, 6, 2)))
TURN = np.asarray(rotation(np.array(0.7), np.array(0.4), np.array(1.2)))

ROWS = [
    Row(
        "DirectionalSources.nodes",
        lambda directions, irradiance: DirectionalSources(directions, irradiance).nodes(),
        {"directions": unit(2) * 1.7, "irradiance": normal(2, 2)},
        {"+Z": {"directions": repeated(POLES["+Z"])}},
    ),
    Row(
        "Environment.nodes",
        lambda radiance: Environment(radiance).nodes(),
        {"radiance": IMAGE},
    ),
    Row(
        "Environment.scaled",
        lambda radiance, factor: Environment(radiance).scaled(factor).radiance,
        {"radiance": IMAGE, "factor": np.array(1.7)},
    ),
    Row(
        "HarmonicLight.nodes",
        lambda coefficients: HarmonicLight(coefficients).nodes(),
        {"coefficients": normal(4, 2)},
    ),
    Row(
        "HarmonicLight.radiance",
        lambda coefficients, directions: HarmonicLight(coefficients).radiance(directions),
        {"coefficients": normal(4, 2), "directions": Unit(unit(2))},
        {place: {"directions": Unit(repeated(pole))} for place, pole in POLES.items()},
    ),
    Row(
        "HarmonicLight.to_environment",
        lambda coefficients: HarmonicLight(coefficients).to_environment(4).radiance,
        {"coefficients": np.array([[9.0, 8.0], [0.3, 0.1], [0.2, 0.5], [0.4, -0.6]])},
    ),
    Row(
        "SmoothLobes.radiance",
        lambda of, **lobes: SmoothLobes(**lobes).radiance(of),
        {**LOBES, "of": Unit(unit(2, seed=4) + 0.02 * normal(2, 3))},
        {"coincident": {"of": Unit(unit(2, seed=4))}},
    ),
    Row(
        "SmoothLobes.to_environment",
        lambda **lobes: SmoothLobes(**lobes).to_environment(3).radiance,
        {**LOBES, "widths": Above(np.array([0.4, 1.0])), "middle": np.ones((2, 2))},
    ),
    Row(
        "OvercastSky.radiance",
        lambda zenith, directions: OvercastSky(zenith).radiance(directions),
        {"zenith": COLOUR, "directions": Unit(UPPER)},
        {
            "zenith": {"directions": Unit(repeated(OVERHEAD))},
            "below": {"directions": Unit(-UPPER)},
        },
    ),
    Row("Sky.nodes", lambda zenith: OvercastSky(zenith).nodes(), {"zenith": COLOUR}),
    Row(
        "Sky.to_environment",
        lambda sun, zenith: ClearSky(sun, zenith).to_environment(4).radiance,
        {"sun": SUN, "zenith": COLOUR},
        {"sun overhead": {"sun": OVERHEAD}},
        kinks={"sun overhead": AT_ZENITH},
    ),
    Row(
        "ClearSky.radiance",
        lambda sun, zenith, directions: ClearSky(sun, zenith).radiance(directions),
        {"sun": SUN, "zenith": COLOUR, "directions": Unit(UPPER)},
        {
            "sun overhead": {"sun": OVERHEAD},
            "at the sun": {"directions": Unit(repeated(SUN))},
            "below": {"directions": Unit(-UPPER)},
        },
        kinks={
            "sun overhead": AT_ZENITH,
            "at the sun": "radiance falls linearly with the angle from the sun",
        },
    ),
    Row(
        "ClearSky.relative",
        lambda sun, directions: ClearSky(sun, np.ones(1)).relative(directions),
        {"sun": SUN, "directions": Unit(UPPER)},
        {"zenith": {"directions": Unit(repeated(OVERHEAD))}},
    ),
    Row(
        "IsotropicIntensity.intensity",
        lambda value, directions: IsotropicIntensity(value).intensity(directions),
        {"value": COLOUR, "directions": Unit(unit(2))},
    ),
    Row(
        "SpotIntensity.intensity",
        lambda peak, exponent, directions: SpotIntensity(peak, exponent).intensity(directions),
        {"peak": COLOUR, "exponent": np.array(7.5), "directions": Unit(UPPER)},
        {
            "on the axis": {"directions": Unit(repeated(OVERHEAD))},
            "backwards": {"directions": Unit(-UPPER)},
            "exponent 0": {"exponent": np.array(0.0)},
        },
    ),
    Row(
        "ConeIntensity.intensity",
        lambda value, directions: ConeIntensity(
            SpotIntensity(value, 2.0), half_angle=1.4
        ).intensity(directions),
        {"value": COLOUR, "directions": Unit(UPPER)},
        {"outside": {"directions": Unit(-UPPER)}},
    ),
    Row(
        "AngularIntensity.intensity",
        lambda directions, **luminaire: AngularIntensity(**luminaire).intensity(directions),
        {"directions": Unit(WITHIN / np.linalg.norm(WITHIN, axis=1, keepdims=True)), **LUMINAIRE},
        {place: {"directions": Unit(repeated(pole))} for place, pole in POLES.items()},
        kinks=dict.fromkeys(POLES, ON_AXIS),
    ),
    Row(
        "AngularIntensity.flux", lambda **luminaire: AngularIntensity(**luminaire).flux(), LUMINAIRE
    ),
    Row(
        "PointLight.arriving",
        lambda position, points, peak, world_from_local: PointLight(
            position,
            SpotIntensity(peak, 2.0),
            world_from_local,
            Flaps(np.array([[1.0, 0.0, 0.0]], peak.dtype), np.array([5.0], peak.dtype)),
        ).arriving(points),
        {
            "position": np.array([0.3, 0.2, -3.0]),
            "points": normal(2, 3),
            "peak": COLOUR,
            "world_from_local": Turn(TURN),
        },
        {"at the light": {"points": np.array([[0.3, 0.2, -3.0], [1.0, 2.0, 0.5]])}},
        kinks={"at the light": "nothing arrives at the place of the light itself"},
    ),
    Row(
        "PointSources.at",
        lambda positions, intensity, points: PointSources(positions, intensity).at(points),
        {
            "positions": np.array([[0.3, 0.2, -3.0], [4.0, 1.0, 2.0]]),
            "intensity": Above(np.abs(normal(2, 2))),
            "points": normal(2, 3),
        },
        {"at the light": {"points": np.array([[0.3, 0.2, -3.0], [1.0, 2.0, 0.5]])}},
        kinks={"at the light": "nothing arrives at the place of the light itself"},
    ),
    Row(
        "PointSources.seen_from",
        lambda positions, intensity, place: (
            PointSources(positions, intensity).seen_from(place).nodes()
        ),
        {
            "positions": np.array([[0.3, 0.2, -3.0], [4.0, 1.0, 2.0]]),
            "intensity": Above(np.abs(normal(2, 2))),
            "place": normal(3),
        },
    ),
    Row(
        "PointLight.intensity",
        lambda directions, peak, world_from_local: PointLight(
            np.zeros(3), SpotIntensity(peak, 2.0), world_from_local
        ).intensity(directions),
        {
            "directions": Unit(UPPER @ TURN.T),
            "peak": COLOUR,
            "world_from_local": Turn(TURN),
        },
    ),
]

_HOST = "on the host: cells are sorted, and a texel is in one or in another"
EXCEPTIONS = {
    **dict.fromkeys(("candidates", "condensed", "partition", "split_to_energy", "take"), _HOST),
    **dict.fromkeys(("Candidates", "Cells", "LightSplit"), "what those give: numbers, no function"),
    "BallLight": "what light_of_ball gives: numbers, no function",
    "Flaps": "numbers; what they cut is in the rows of PointLight",
    "Environment.turned": "looks its image up on the host",
    "FunctionLight": "what light by direction is: its rows are those of skies and lobes",
    "Light": "what a light is: its rows are those of the kinds of light",
    "LightNodes": "numbers, no function",
    "PointSources.nodes": "there are none: every place sees others",
    "LightSum": "its parts one after the other",
    "Sky": "what a sky is: its rows are those of the two skies",
    "light_of": "of a name",
    **dict.fromkeys(
        ("light_of_ball", "view_of_ball", "view_of_lens"),
        "reads a photograph on the host, by SciPy's look-up",
    ),
    **dict.fromkeys(("ball_of_circle", "ball_of_mask"), "reads an outline on the host"),
    **dict.fromkeys(("Ball", "BallView", "Evidence", "MergedViews"), "numbers, no function"),
    **dict.fromkeys(("fill_smoothly", "merge_views"), "of measured images, on the host"),
    "panorama_named": "of a name",
    **dict.fromkeys(("to_latlong", "to_own_latlong"), "reads an image on the host, by look-up"),
    "positive_environment": "drawn from positive_part_of",
    "positive_light": "as positive_part_of, with sources",
    "positive_part_of": "Newton's method on the host, for the image of a light that was found",
    "preetham": "of one number on the host; the distribution is static",
}
