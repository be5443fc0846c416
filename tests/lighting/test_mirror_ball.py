"""Pinned down: the light around a chrome ball from a photograph.

- A photograph rendered from smooth light gives that light back, whatever the camera's pose and
  wherever between the pixels the ball lies, to the photograph's own resolution.
- A source appears where it is.
- The confidence is the exit cosine: 1 towards the camera, 0 straight behind the ball.
- Pixels that are not usable are filled, and have no confidence; reflectance divides.
"""

import numpy as np
import pytest

from jaxrender.geometry import look_at
from jaxrender.imaging.silhouette import Circle
from jaxrender.lighting import SmoothLobes
from jaxrender.lighting.mirror_ball import light_of_ball

BALL = Circle(48.3, 55.9, 40.6, 0.0, 1.0)
SHAPE = (100, 112)
ROWS = 32
# Bilinear interpolation and pixels that turn R by 2.8 degrees and more blur lobes of 25 degrees.
TOLERANCE = 1e-2
LIGHT = SmoothLobes(
    np.array([[0.6, 0.64, 0.48], [-0.8, 0.0, 0.6], [0.0, -0.6, -0.8]]),
    np.radians([25.0, 40.0, 60.0]),
    np.array([[2.0, 1.5, 1.0], [0.4, 0.6, 0.8], [0.2, 0.2, 0.3]]),
)
POSE = look_at(np.array([3.0, -2.0, 1.0]), np.zeros(3), np.array([0.0, 0.0, 1.0]))


def photograph(light, pose, supersampling=3):
    """Render the ball by reflection at each pixel's own normals; grey around it."""
    rows, columns = ((np.arange(n * supersampling) + 0.5) / supersampling for n in SHAPE)
    y = -(rows[:, None] - BALL.row) / BALL.radius + 0 * columns
    x = (columns[None, :] - BALL.column) / BALL.radius + 0 * rows[:, None]
    on = x**2 + y**2 < 1
    normals = np.stack([x, y, np.sqrt(np.where(on, 1 - x**2 - y**2, 0))], axis=-1)
    reflected = 2 * normals[..., 2:] * normals - np.array([0.0, 0.0, 1.0])
    world = reflected @ pose[:3, :3].T
    seen = np.asarray(light.radiance(world.reshape(-1, 3))).reshape(*world.shape[:2], 3)
    seen = np.where(on[..., None], seen, 0.7)
    blocks = seen.reshape(SHAPE[0], supersampling, SHAPE[1], supersampling, 3)
    return blocks.mean(axis=(1, 3))


def directions(rows=ROWS):
    polar, azimuth = np.meshgrid(
        (np.arange(rows) + 0.5) * np.pi / rows,
        (np.arange(2 * rows) + 0.5) * np.pi / rows,
        indexing="ij",
    )
    sines = np.sin(polar)
    return np.stack([sines * np.cos(azimuth), sines * np.sin(azimuth), np.cos(polar)], axis=-1)


@pytest.mark.parametrize("pose", [np.eye(4), POSE], ids=["camera axes", "turned"])
def test_smooth_light_comes_back(pose):
    found = light_of_ball(photograph(LIGHT, pose), BALL, pose, ROWS)
    fine = np.asarray(LIGHT.radiance(directions(4 * ROWS).reshape(-1, 3)))
    truth = fine.reshape(ROWS, 4, 2 * ROWS, 4, 3).mean(axis=(1, 3))
    radiance = np.asarray(found.environment.radiance)
    sure = found.confidence > 0.35
    assert sure.mean() > 0.7
    assert np.abs(radiance - truth)[sure].max() < TOLERANCE * truth.max()


def test_a_source_appears_where_it_is():
    towards = np.array([[0.36, 0.48, 0.8]])
    source = SmoothLobes(towards, np.radians([6.0]), np.array([[5.0, 5.0, 5.0]]))
    found = light_of_ball(photograph(source, POSE), BALL, POSE)
    environment = found.environment
    assert environment.grid.height == 41
    nodes = environment.nodes()
    centre = np.asarray(nodes.irradiance)[:, 0] @ np.asarray(nodes.directions)
    assert centre @ towards[0] / np.linalg.norm(centre) > np.cos(np.radians(0.3))


def test_confidence_is_the_exit_cosine():
    found = light_of_ball(photograph(LIGHT, POSE), BALL, POSE, ROWS)
    cosines = np.sqrt(np.maximum(1 + directions() @ POSE[:3, 2], 0) / 2)
    # Where neither the rim nor the filling reaches, up to the mean over a texel.
    inside = cosines > 0.4
    assert np.abs(found.confidence - cosines)[inside].max() < 0.01
    assert found.confidence[cosines < 0.1].max() < 0.01


def test_unusable_pixels_are_filled_without_confidence():
    picture = photograph(LIGHT, POSE)
    usable = np.ones(SHAPE, bool)
    usable[40:50, 50:60] = False
    spoilt = np.where(usable[..., None], picture, 100.0)
    clean = light_of_ball(picture, BALL, POSE, ROWS)
    found = light_of_ball(spoilt, BALL, POSE, ROWS, usable=usable, reflectance=0.5)
    radiance = np.asarray(found.environment.radiance)
    assert radiance.max() < 2 * 1.1 * picture.max()
    sure = found.confidence >= (1 - 1e-9) * clean.confidence
    same = np.abs(radiance - 2 * np.asarray(clean.environment.radiance))
    assert same[sure & (clean.confidence > 0)].max() < 1e-9
    assert (found.confidence[clean.confidence > 0.95] == 0).any()


def test_nothing_usable_is_refused():
    picture = photograph(LIGHT, POSE)
    with pytest.raises(ValueError, match="no usable pixel"):
        light_of_ball(picture, BALL, POSE, usable=np.zeros(SHAPE, bool))
    with pytest.raises(ValueError, match="reflectance"):
        light_of_ball(picture, BALL, POSE, reflectance=0.0)
