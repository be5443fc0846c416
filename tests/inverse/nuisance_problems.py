"""Problems that the tests of nuisances share: a ball, its cameras and lights, and what is told."""

import numpy as np
from inverse_problems import unit
from scipy.spatial.transform import Rotation

from jaxrender.geometry import (
    Orthographic,
    Pinhole,
    Sphere,
    SurfacePlaces,
    SurfaceSamples,
    look_at,
    observe,
)
from jaxrender.inverse import KnownLight, Observations
from jaxrender.inverse.nuisances import Corrections, Told
from jaxrender.lighting import DirectionalSources, Environment

# Neither about the origin nor of size one: lengths are relative to the object.
CENTER, RADIUS = np.array([0.3, -0.2, 0.1]), 0.7
BALL = Sphere(CENTER, RADIUS)
SIZE, VIEWS = 12, 3
# Cameras do not look at the middle of the object.
AIM = np.array([0.05, 0.02, 0.1])
LEAST = 0.3


def camera(number, kind=Pinhole, turn=((1, 0, 0), (0, 1, 0), (0, 0, 1))):
    azimuth = 2 * np.pi * number / VIEWS + 0.2
    towards = np.array([np.cos(azimuth), np.sin(azimuth), 0.4 - 0.3 * number])
    pose = look_at(CENTER + 3 * towards, CENTER + AIM, np.array([0.0, 0, 1]))
    pose[:3, :3] = np.array(turn, float) @ pose[:3, :3]
    if kind is Orthographic:
        return Orthographic(SIZE, SIZE, pose, scale=2.2 * RADIUS / SIZE)
    return Pinhole(SIZE, SIZE, pose, fl_x=1.9 * SIZE)


def observed(kind=Pinhole):
    """List what the cameras see of the ball; radiance is any."""
    cameras = [camera(number, kind) for number in range(VIEWS)]
    views = [observe(one, BALL) for one in cameras]
    usable = [view.exit_cosines > LEAST for view in views]

    def gathered(name):
        return np.concatenate([getattr(v, name)[u] for v, u in zip(views, usable)])

    frame = np.repeat(np.arange(VIEWS), [np.count_nonzero(u) for u in usable])
    return Observations(
        SurfaceSamples(gathered("normals"), gathered("outgoing")),
        np.random.default_rng(0).uniform(0.1, 2, (len(frame), 3)),
        frame,
        SurfacePlaces(gathered("points"), gathered("geometric_normals")),
        stands_for=np.full(len(frame), 2.0),
        pixel=np.concatenate([np.argwhere(u) for u in usable]),
        eyes=np.stack([one.position for one in cameras]),
    )


def environment(rows=32):
    """Make a few smooth lobes, none about an axis of the image."""
    directions = Environment(np.ones((rows, 2 * rows, 1))).grid.directions()
    axes = unit(np.array([[0.8, 0.3, 0.5], [-0.5, 0.6, -0.6], [0.1, -0.9, 0.4]]))
    return Environment(np.exp(3 * (directions @ axes.T - 1)) @ np.diag([1.0, 2.0, 3.0]) + 0.1)


# The second is dark, and so in no group.
LAMPS = DirectionalSources(
    unit(np.array([[0.5, 0.6, 0.6], [0.0, 1.0, 0.2], [-0.3, 0.1, 0.9]])),
    np.array([[2.0, 1.8, 1.6], [0.0, 0.0, 0.0], [0.5, 0.6, 0.7]]),
)
# As many as there are photographs, one with two sources.
OWN = (
    DirectionalSources(unit(np.array([[0.9, -0.1, 0.3]])), np.full((1, 3), 1.1)),
    DirectionalSources(
        unit(np.array([[0.1, 0.9, 0.3], [0.4, 0.4, 0.8]])), np.array([[0.4] * 3, [0.9] * 3])
    ),
    DirectionalSources(unit(np.array([[-0.9, -0.1, 0.5]])), np.full((1, 3), 0.7)),
)
LIGHT = KnownLight(environment(), LAMPS, OWN)
TOLD = Told(observed(), LIGHT, BALL)
NOTHING = Corrections.none(TOLD)


# Any directions.
NORMALS = unit(np.random.default_rng(7).normal(size=(20, 3)))


def some(**given):
    """Make corrections, from numbers of any layout."""
    now = NOTHING
    for name, numbers in given.items():
        now = now.moved(name, np.asarray(numbers, float).ravel())
    return now


def matrix(vector):
    return Rotation.from_rotvec(np.asarray(vector, float)).as_matrix()
