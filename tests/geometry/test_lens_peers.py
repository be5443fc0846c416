"""Lenses against the programs whose they are: COLMAP and OpenCV, where they are installed.

- Every camera model of COLMAP, both ways, within 1e-6 radians.
- OpenCV's ``projectPoints``, ``undistortPoints`` and ``fisheye``, with its pixels' centres.
"""

import numpy as np
import pytest
from lens_samples import FISHEYE, NUMBERS, PRISM, parameters
from test_lenses import directions

from jaxrender.geometry import LENS_MODELS, Pinhole, look_at, opencv_lens

MICRORADIAN = 1e-6


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@pytest.mark.parametrize("name", NUMBERS)
def test_camera_models_of_colmap(name):
    pycolmap = pytest.importorskip("pycolmap")
    theirs = pycolmap.Camera(model=name, width=64, height=48, params=parameters(name))
    named = LENS_MODELS[name].pinhole(parameters(name))
    focal = np.array([named["fl_x"], named.get("fl_y", named["fl_x"])])
    centre = np.array([named["cx"], named["cy"]])
    lens, along = LENS_MODELS[name].lens(NUMBERS[name]), directions(4)
    pixels = theirs.img_from_cam(along)
    np.testing.assert_allclose(
        lens.distort(along), (pixels - centre) / focal, atol=MICRORADIAN / 1000
    )
    back = theirs.cam_from_img(pixels)
    back = np.c_[back, np.ones(len(back))] if back.shape[1] == 2 else back
    found = lens.undistort((pixels - centre) / focal)
    np.testing.assert_allclose(found, unit(back), atol=MICRORADIAN)


def test_every_model_of_colmap_is_known():
    pycolmap = pytest.importorskip("pycolmap")
    assert set(pycolmap.CameraModelId.__members__) - {"INVALID"} == set(LENS_MODELS)


@pytest.mark.parametrize("count", [4, 5, 8, 12])
def test_opencv(count):
    cv2 = pytest.importorskip("cv2")
    coefficients, matrix = np.array(PRISM[:count]), np.diag([100.0, 120.0, 1.0])
    matrix[:2, 2] = 31, 23.5
    along = directions(5)
    pixels = cv2.projectPoints(along, np.zeros(3), np.zeros(3), matrix, coefficients)[0][:, 0]
    pose = look_at(np.array([1.0, 2, 3]), np.zeros(3), np.array([0.0, 0, 1]))
    # OpenCV counts from the middle of the first pixel.
    ours = Pinhole(
        64, 48, pose, fl_x=100.0, fl_y=120.0, cx=31.5, cy=24.0, lens=opencv_lens(PRISM[:count])
    )
    points = (along * [1, -1, -1]) @ pose[:3, :3].T + pose[:3, 3]
    np.testing.assert_allclose(ours.project(points), pixels + 0.5, atol=100 * MICRORADIAN / 1000)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-13)
    ideal = cv2.undistortPoints(pixels, matrix, coefficients, criteria=criteria)[:, 0]
    found = ours.lens.undistort((pixels - [31, 23.5]) / [100, 120])
    np.testing.assert_allclose(found, unit(np.c_[ideal, np.ones(len(ideal))]), atol=MICRORADIAN)


def test_fisheye_of_opencv():
    cv2 = pytest.importorskip("cv2")
    along = directions(6)
    matrix = np.array([[100.0, 0, 31], [0, 120, 23.5], [0, 0, 1]])
    ideal = np.ascontiguousarray(along[:, None, :2])
    pixels = cv2.fisheye.distortPoints(ideal, matrix, np.array(FISHEYE))[:, 0]
    lens = LENS_MODELS["OPENCV_FISHEYE"].lens(FISHEYE)
    places = (pixels - [31, 23.5]) / [100, 120]
    np.testing.assert_allclose(lens.distort(along), places, atol=MICRORADIAN / 1000)
    np.testing.assert_allclose(lens.undistort(places), unit(along), atol=MICRORADIAN)
