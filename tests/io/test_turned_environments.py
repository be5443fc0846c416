"""Panoramas that are mirrored or turned as they are read: by one bright texel each.

A texel of the picture is seen in a known direction; its mirror image in the mirrored column; a yaw
turns the direction about the panorama's up, +Z or, of ``y-up``, +Y.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxrender.io import read_environment, write_image

ROWS = 32


def brightest(path, convention, **how) -> np.ndarray:
    """The mean direction of the light of a picture."""
    nodes = read_environment(path, convention, **how).nodes()
    mean = np.asarray(nodes.irradiance)[:, 0] @ np.asarray(nodes.directions)
    return mean / np.linalg.norm(mean)


@pytest.fixture
def picture(tmp_path):
    def write(column):
        image = np.zeros((ROWS, 2 * ROWS, 3))
        image[10, column] = 1
        write_image(tmp_path / "probe.exr", image)
        return tmp_path / "probe.exr"

    return write


@pytest.mark.parametrize(("convention", "up"), [("z-up", [0, 0, 1]), ("y-up", [0, 1, 0])])
def test_a_yaw_turns_about_the_panoramas_up(picture, convention, up):
    path = picture(5)
    turn = Rotation.from_rotvec(37 * np.array(up), degrees=True)
    expected = turn.apply(brightest(path, convention))
    np.testing.assert_allclose(brightest(path, convention, yaw=37), expected, atol=0.01)


@pytest.mark.parametrize(("convention", "flip"), [("z-up", [1, -1, 1]), ("y-up", [-1, 1, 1])])
def test_a_mirrored_panorama_is_read_from_right_to_left(picture, convention, flip):
    mirrored = brightest(picture(5), convention, mirrored=True)
    np.testing.assert_allclose(mirrored, brightest(picture(2 * ROWS - 6), convention), atol=1e-6)
    np.testing.assert_allclose(mirrored, brightest(picture(5), convention) * flip, atol=1e-6)


def test_it_is_turned_after_it_is_mirrored(picture):
    path = picture(5)
    turn = Rotation.from_rotvec([0, 0, 50], degrees=True)
    expected = turn.apply(brightest(path, "z-up", mirrored=True))
    found = brightest(path, "z-up", mirrored=True, yaw=50)
    np.testing.assert_allclose(found, expected, atol=0.01)


def test_a_probe_of_its_own_has_no_yaw(picture):
    with pytest.raises(ValueError, match="yaw is 5"):
        read_environment(picture(5), "z-up", axes="probe", yaw=5)
