"""How a panorama is meant is found by the photographs that it lights.

- Layout, mirror image and yaw are found, on a ball and on a concave object, beside a known lamp.
- Under uniform light nothing is told; under light that is even about the upright the layout alone.
- A highlight in one place alone makes no difference that counts, and the panorama must be one.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from wrongly_framed import cameras

from jaxrender.brdf import Microfacet
from jaxrender.geometry import (
    Sphere,
    SurfacePlaces,
    SurfaceSamples,
    observe,
    sculpture,
)
from jaxrender.harmonics import LatLongGrid
from jaxrender.inverse import KnownLight, Observations
from jaxrender.inverse.conventions import Known, Orientation, find_orientation
from jaxrender.inverse.conventions.orientation_search import surpasses
from jaxrender.inverse.conventions.orientations import Panoramas
from jaxrender.inverse.conventions.quick_fit import QuickFit
from jaxrender.lighting import DirectionalSources, Environment
from jaxrender.reflection import ExactForward, ShadowedForward, render_view

MATERIAL = Microfacet(
    np.array([0.2, 0.15, 0.1]), np.full(3, 0.1), 0.15, 1.5, "half", "smith", "ggx"
)
ROWS = 32
LAMP = DirectionalSources(np.array([[1.0, -1.0, 0.5]]), np.full((1, 3), 1.0))
TOLD = Orientation()


def room() -> np.ndarray:
    """A window, a lamp and a floor: unlike from every side, as a z-up panorama."""
    directions = LatLongGrid(ROWS, 2 * ROWS).directions()
    image = 0.15 + 0.1 * np.maximum(directions[..., 2:], 0) + np.zeros(3)
    for towards, width, radiance in (
        ([1, 0.2, 0.3], 0.35, [3, 2.5, 2]),
        ([-0.3, 1, 0.1], 0.25, [1, 2, 3]),
        ([-0.6, -0.5, 0.6], 0.2, [4, 4, 4]),
    ):
        along = directions @ (np.array(towards) / np.linalg.norm(towards))
        image = image + np.exp((along - 1) / width**2)[..., None] * np.array(radiance)
    return image


def picture_of(image: np.ndarray, meant: Orientation) -> np.ndarray:
    """Write a z-up panorama so that it is read as it is only if it is meant so.

    Directions of the texels of either layout are those of the module on layouts.
    """
    polar, azimuth = np.meshgrid(
        (np.arange(ROWS) + 0.5) * np.pi / ROWS,
        (np.arange(2 * ROWS) + 0.5) * np.pi / ROWS,
        indexing="ij",
    )
    level, height = np.sin(polar), np.cos(polar)
    if meant.convention == "z-up":
        own, up = (level * np.cos(azimuth), level * np.sin(azimuth), height), [0.0, 0, 1]
    else:
        own, up = (level * np.sin(azimuth), height, -level * np.cos(azimuth)), [0.0, 1, 0]
    turn = Rotation.from_rotvec(meant.yaw * np.array(up), degrees=True)
    world = turn.apply(np.stack(own, axis=-1).reshape(-1, 3))
    picture = Panoramas({"z-up": image}).radiance(TOLD, world).reshape(image.shape)
    return picture[:, ::-1] if meant.mirrored else picture


def observations(shape, light, views: int = 3) -> Observations:
    """See a shape in some light, with a per cent of noise."""
    nodes, rng = light.nodes(), np.random.default_rng(0)
    forward = ExactForward(nodes) if shape.is_convex() else ShadowedForward(shape, nodes)
    parts = []
    for number, camera in enumerate(cameras(views, 28)):
        view = observe(camera, shape)
        seen = view.hit & (view.exit_cosines > 0.15)
        values = np.asarray(render_view(MATERIAL, view, forward))[seen]
        values = values * (1 + 0.01 * rng.normal(size=values.shape))
        frame = np.full(len(values), number)
        geometry = (view.normals, view.outgoing, view.points, view.geometric_normals)
        parts.append((*(each[seen] for each in geometry), values, frame))
    normals, outgoing, points, facing, values, frame = map(np.concatenate, zip(*parts))
    places = SurfacePlaces(points, facing)
    return Observations(SurfaceSamples(normals, outgoing), values, frame, places)


@pytest.fixture(scope="module")
def ball():
    return observations(Sphere(np.zeros(3), 1.0), Environment(room()))


@pytest.mark.parametrize(
    "meant",
    [
        TOLD,
        Orientation("y-up", False, 90.0),
        Orientation("z-up", True, -37.0),
        Orientation("y-up", True, 150.0),
    ],
    ids=str,
)
def test_what_is_meant_is_found(ball, meant):
    found = find_orientation(ball, None, picture_of(room(), meant), TOLD)
    assert found.orientation[:2] == meant[:2]
    assert found.orientation.off(meant) < 2
    assert found.unexplained < 0.05
    assert found.told_apart == ("convention", "mirrored", "yaw")
    assert found.fits
    assert f"environment `{meant.convention}`" in found.sentences()[0]


def test_a_quarter_turn_is_found_as_it_is(ball):
    """The steps go by other degrees, and the noise may prefer a neighbour."""
    meant, told = Orientation("y-up", False, 90.0), Orientation(yaw=3.3)
    found = find_orientation(ball, None, picture_of(room(), meant), told)
    assert found.orientation == meant
    # One that is farther from it than the light's detail is none.
    other = meant.turned(91.4)
    found = find_orientation(ball, None, picture_of(room(), other), told)
    assert found.orientation.off(other) < found.orientation.off(meant)


@pytest.mark.slow
def test_a_concave_object_beside_a_known_lamp():
    shape = sculpture(3)
    seen = observations(shape, Environment(room()) + LAMP, 2)
    meant = Orientation("y-up", True, 60.0)
    picture, lamp = picture_of(room(), meant), KnownLight(None, LAMP)
    found = find_orientation(seen, shape, picture, TOLD, Known(lamp, MATERIAL))
    assert found.orientation[:2] == meant[:2]
    assert found.orientation.off(meant) < 2
    # Without the lamp, and without shadows, more is left.
    assert found.unexplained < 0.5 * find_orientation(seen, shape, picture, TOLD).unexplained
    assert found.unexplained < find_orientation(seen, None, picture, TOLD, Known(lamp)).unexplained


def test_uniform_light_tells_nothing():
    even = np.full((ROWS, 2 * ROWS, 3), 0.7)
    seen = observations(Sphere(np.zeros(3), 1.0), Environment(even))
    for picture in (even, even * (1 + 0.01 * np.random.default_rng(0).normal(size=even.shape))):
        found = find_orientation(seen, None, picture, Orientation("y-up", True, 20.0))
        assert found.orientation == Orientation("y-up", True, 20.0)
        assert found.told_apart == ()
        assert found.sentences() == [
            "the environment's layout, mirror and yaw cannot be told, because the light is uniform"
        ]


def test_an_object_that_another_even_light_lit_tells_nothing(ball):
    # The photographs are of uniform light, but the panorama that is told is not.
    even = observations(Sphere(np.zeros(3), 1.0), Environment(np.full((ROWS, 2 * ROWS, 3), 0.7)))
    found = find_orientation(even, None, room(), TOLD)
    assert found.changed == ()


def test_light_that_is_even_about_the_upright_tells_the_layout_alone():
    sky = np.linspace(2, 0.1, ROWS)[:, None, None] * np.ones((1, 2 * ROWS, 3))
    seen = observations(Sphere(np.zeros(3), 1.0), Environment(sky))
    found = find_orientation(seen, None, sky, Orientation("y-up"))
    assert found.orientation == TOLD
    assert found.told_apart == ("convention",)
    assert found.sentences()[1] == "its mirrored and yaw cannot be told from another"


def test_too_few_pixels_tell_nothing(ball):
    few = ball.take(np.arange(20))
    assert find_orientation(few, None, room(), TOLD).why == "only 20 pixels show the object"


def test_a_picture_of_no_layout_is_refused(ball):
    with pytest.raises(ValueError, match=r"50 x 40 .* which no layout has"):
        find_orientation(ball, None, np.ones((40, 50, 3)), TOLD)


def fit(squares) -> QuickFit:
    return QuickFit(np.zeros((len(squares), 3)), np.asarray(squares, float), 100.0)


def test_one_part_alone_makes_no_difference():
    parts = np.repeat(np.arange(10), 4)
    even, less = np.ones(40), np.full(40, 0.3)
    assert surpasses(fit(less), fit(even), parts)
    assert not surpasses(fit(even), fit(less), parts)
    # A tenth less is no difference, nor is one that a single part makes.
    assert not surpasses(fit(0.9 * even), fit(even), parts)
    assert not surpasses(fit(even), fit(np.where(parts == 3, 30.0, 0.95)), parts)
    # Of two parts nothing is learned that few per cent could not have done.
    assert not surpasses(fit(less), fit(even), parts % 2)
