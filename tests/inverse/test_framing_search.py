"""Axes, turns, units and mirrors are found by silhouettes.

- Every axes are found, every unit, turns and mirrors, all wrong at once, and what is told is kept.
- What symmetry hides cannot be told, and what was told is kept: rolls of cameras about a ball.
- A shape that is another fits nothing.  Photographs without masks are parted from their border.
"""

from pathlib import Path

import numpy as np
import pytest
from wrongly_framed import cameras, file_of, silhouettes

from jaxrender.geometry import CAMERA_AXES, Mesh, Placement, Sphere, sculpture
from jaxrender.inverse.conventions import Framing, Silhouettes, find_framing
from jaxrender.inverse.conventions.framings import TURNS, UNITS
from jaxrender.inverse.conventions.outlines import outlined
from jaxrender.inverse.conventions.silhouettes import covered, overlap
from jaxrender.inverse.photographs import Reading
from jaxrender.io import Capture, Frame, Image

TOLD = Framing()
OBJECT = sculpture(3)
WRONG = [
    *(Framing(axes, bool(k % 2), 2 * k + 1, UNITS[k % 7]) for k, axes in enumerate(CAMERA_AXES)),
    TOLD,
]


SOME = [
    pytest.param(one, marks=() if k % 4 == 2 else pytest.mark.slow) for k, one in enumerate(WRONG)
]


@pytest.mark.parametrize("true", SOME, ids=str)
def test_what_is_meant_is_found(true):
    seen = silhouettes(OBJECT, true.axes, true.mirrored)
    found = find_framing(file_of(OBJECT, true), seen, TOLD)
    assert found.framing == true
    assert set(found.told_apart) == {"axes", "mirrored", "turn", "unit"}
    assert found.overlap > 0.95
    assert max(found.rivals.values()) < found.overlap - 0.1


def test_what_was_told_is_kept_and_a_mesh_may_have_been_placed():
    told = Framing("opencv", True)
    placed = Placement.of_degrees(0.5, np.array([0.0, 0, 30]), np.array([0.1, 0, 0.2]))
    shape = placed.mesh(OBJECT)
    seen = silhouettes(shape, "opencv", True)
    assert find_framing(shape, seen, told, placed).framing == told
    # The file is ten times too large, and about its own origin.
    wrong = Placement.of_degrees(5.0, np.array([0.0, 0, 30]), np.array([0.1, 0, 0.2]))
    found = find_framing(wrong.mesh(OBJECT), seen, told, wrong)
    assert found.framing == told._replace(unit=0.1)
    assert "lengths of the shape times 0.1: overlap" in found.sentences()[-1]


def test_a_ball_hides_rolls_and_mirrors_and_what_was_told_is_kept():
    ball = Sphere(np.zeros(3), 1.0)
    for told in (Framing("pytorch3d"), Framing("opencv", True)):
        found = find_framing(ball, silhouettes(ball, "opencv"), told)
        assert found.framing == told
        assert {"axes", "mirrored"}.isdisjoint(found.told_apart)
        assert "unit" in found.told_apart
        assert "cannot be told from another" in found.sentences()[0]


def test_a_sphere_in_another_unit_is_found():
    ball = Sphere(np.array([0.5, 0.2, 0.1]), 1.0)
    seen = silhouettes(ball, "opencv_inverted")
    wrong = Framing("opencv_inverted", unit=1000.0)
    assert find_framing(file_of(ball, wrong), seen, TOLD).framing == wrong


def test_another_shape_fits_nothing():
    stick = Mesh.ellipsoid(np.array([0.1, 0.1, 1.5]), 2)
    found = find_framing(Sphere(np.zeros(3), 0.3), silhouettes(stick), TOLD)
    assert not found.fits
    assert "no axes, turn or unit fit" in found.sentences()[0]


def test_without_a_silhouette_nothing_is_found():
    with pytest.raises(ValueError, match="give masks"):
        find_framing(OBJECT, Silhouettes((), (), ()), TOLD)


def test_turns_are_said_by_the_axes_of_the_mesh():
    # z of the world is y of the mesh: the rotation by 90 degrees about x.
    turn = next(
        k for k, t in enumerate(TURNS) if np.array_equal(t @ [0, 1, 0], [0, 0, 1]) and t[0, 0] == 1
    )
    assert Framing(turn=turn).aspect("turn") == "the mesh's +y up, its +x along x"
    np.testing.assert_allclose(Framing(turn=turn).own.degrees, [90, 0, 0], atol=1e-12)


@pytest.mark.parametrize("background", [0.0, 0.02, 0.7])
def test_an_object_is_parted_from_its_border(background):
    rng = np.random.default_rng(0)
    camera = cameras()[1]
    mask = covered(camera, OBJECT)
    # One side is nearly as dark as a black background.
    shading = np.linspace(0.05, 0.5, mask.shape[1])[None, :, None]
    picture = np.where(mask[..., None], shading, background) + np.zeros(3)
    picture += 0.003 * rng.normal(size=picture.shape)
    assert overlap(outlined(np.maximum(picture, 0)), mask) > 0.9


def test_an_empty_photograph_has_no_outline():
    rng = np.random.default_rng(0)
    assert not outlined(np.full((40, 40, 3), 0.5)).any()
    assert outlined(0.5 + 0.01 * rng.normal(size=(40, 40, 3))).mean() < 0.05


def test_masks_alpha_and_outlines_are_silhouettes():
    camera = cameras()[0]
    mask = covered(camera, OBJECT)
    pixels, valid = 0.5 * mask[..., None] + np.zeros(3), np.zeros(mask.shape, bool)
    frames = tuple(Frame(name, camera, Path(name), None, None) for name in ("alpha", "plain", "no"))
    images = [
        Image(np.ones_like(pixels), mask.astype(float), {}, valid),
        Image(pixels, None, {}, valid),
        Image(np.ones_like(pixels), None, {}, valid),
    ]
    found = Silhouettes.of(Capture(frames), images, Reading())
    assert found.names == ("alpha", "plain")
    assert found.guessed == ("plain",)
    assert all(overlap(one, mask) > 0.95 for one in found.masks)
