"""Patches of micro-geometry, and the endless surface that repeating one makes.

- Heights lie where they were given, the last row joins the first, faces look up.
- A sawtooth has the angles and materials asked for; a random surface its slope and Gaussian slopes.
- Threads are closed prisms that look outwards, of the length and lean asked for.
- Rays meet the endless surface where a brute-force search over many periods meets it: also at
  grazing angles, from far away, and where threads lean over the border.
- What is not a patch is refused.
"""

import numpy as np
import pytest

from jaxrender.geometry.height_fields import (
    Patch,
    gaussian_surface,
    height_field,
    sawtooth,
    velvet,
)
from jaxrender.geometry.mesh import Mesh
from jaxrender.geometry.periodic import PeriodicSurface


def test_heights_lie_where_they_were_given():
    heights = np.arange(6.0).reshape(2, 3) ** 2
    patch = height_field(heights, (3.0, 4.0))
    table = {(round(x, 9), round(y, 9)): z for x, y, z in patch.mesh.vertices}
    for row in range(3):
        for column in range(4):
            assert table[(column * 1.0, row * 2.0)] == heights[row % 2, column % 3]
    assert (patch.mesh.face_normals()[:, 2] > 0).all()
    assert len(patch.mesh.faces) == 12
    assert patch.level == heights.mean()
    np.testing.assert_allclose(patch.size, [3, 4])


def test_sawtooth_has_its_angles_and_materials():
    patch = sawtooth(3, np.radians(30), np.radians(70))
    normals = patch.mesh.face_normals()
    angles = np.degrees(np.arctan2(normals[:, 0], normals[:, 2]))
    np.testing.assert_allclose(angles[patch.material == 0], -30, atol=1e-9)
    np.testing.assert_allclose(angles[patch.material == 1], 70, atol=1e-9)
    assert patch.materials == 2
    assert len(normals) == 12
    np.testing.assert_allclose(patch.mesh.bounds()[:, :2], [[0, 0], [1, 1]], atol=1e-12)


def test_a_side_may_be_upright():
    normals = sawtooth(2, np.pi / 2, np.pi / 4).mesh.face_normals()
    np.testing.assert_allclose(normals[0], [-1, 0, 0], atol=1e-12)


def test_gaussian_surface_has_gaussian_slopes():
    patch = gaussian_surface(0.4, cells=192, correlation=0.04, seed=3)
    normals = patch.mesh.face_normals()
    slopes = normals[:, :2] / normals[:, 2:]
    np.testing.assert_allclose(np.sqrt(np.mean(np.sum(slopes**2, axis=1))), 0.4, rtol=1e-12)
    # 192 x 192 cells hold about (1 / .04)^2 = 625 independent slopes.
    for axis in range(2):
        assert np.std(slopes[:, axis]) == pytest.approx(0.4 / np.sqrt(2), rel=0.1)
        assert np.mean(slopes[:, axis] ** 4) / np.var(slopes[:, axis]) ** 2 == pytest.approx(
            3, abs=0.5
        )
    assert gaussian_surface(0.0, cells=16, correlation=0.2).mesh.vertices[:, 2].max() == 0


def test_threads_are_closed_but_for_their_feet():
    length, lean = 0.25, 0.5
    patch = velvet(40, length, 0.01, lean, spread=0.0, azimuth=np.pi / 2, sides=5)
    mesh = patch.mesh
    tops = mesh.vertices[4:].reshape(40, 2, 5, 3)
    axis = (tops[:, 1] - tops[:, 0]).mean(axis=1)
    expected = length * np.tile([0, np.sin(lean), np.cos(lean)], (40, 1))
    np.testing.assert_allclose(axis, expected, atol=1e-15)
    np.testing.assert_array_equal(patch.material[:2], 0)
    assert (patch.material[2:] == 1).all()
    # The walls and the lid of one thread, seen from its middle, face away.
    faces = mesh.faces[2:].reshape(40, -1, 3)
    normals = mesh.face_normals()[2:].reshape(40, -1, 3)
    middle = tops.mean(axis=(1, 2))
    outward = mesh.vertices[faces].mean(axis=2) - middle[:, None]
    assert (np.einsum("tfi,tfi->tf", outward, normals) > 0).all()


def _far(patch: Patch, reach: int) -> Mesh:
    """The patch and as many neighbours on each side."""
    shifts = [(i, j) for i in range(-reach, reach + 1) for j in range(-reach, reach + 1)]
    vertices = [patch.mesh.vertices + np.append(s * patch.size, 0) for s in np.array(shifts)]
    faces = [patch.mesh.faces + k * len(patch.mesh.vertices) for k in range(len(shifts))]
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


@pytest.mark.parametrize("kind", ["heights", "leaning threads", "ridges"])
def test_the_endless_surface_is_met_where_many_copies_are(kind):
    rng = np.random.default_rng(1)
    patches = {
        "heights": height_field(0.3 * rng.uniform(size=(5, 4)), (1.0, 0.7)),
        "leaning threads": velvet(12, 0.6, 0.02, 0.7),
        "ridges": sawtooth(2, 0.3, 1.2),
    }
    patch = patches[kind]
    surface, far = PeriodicSurface(patch), _far(patch, 12)
    low, high = surface.bounds()
    count = 4000
    directions = rng.normal(size=(count, 3))
    directions[:, 2] *= rng.choice([0.05, 0.2, 1.0], count)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # The copies hold what a ray meets within eight periods: longer ones are not compared.
    origins = rng.uniform(low - 0.01, high + 0.01, (count, 3))
    mine, theirs = surface.first_hits(origins, directions), far.first_hits(origins, directions)
    near = np.where(theirs.hit, theirs.distance, 0) < 8 * patch.size.min()
    rises = (high[2] - low[2] + 0.02) / np.maximum(np.abs(directions[:, 2]), 1e-9)
    short = near & (theirs.hit | (rises < 8 * patch.size.min()))
    assert short.mean() > 0.8
    # Rays within float32's rounding of an edge may meet either face, or miss a thread.
    assert (mine.hit[short] == theirs.hit[short]).mean() > 0.998
    both = short & mine.hit & theirs.hit
    assert both.mean() > 0.3
    same = np.isclose(mine.distance[both], theirs.distance[both], rtol=1e-5, atol=1e-5)
    assert same.mean() > 0.998
    good = np.flatnonzero(both)[same]
    np.testing.assert_allclose(mine.points[good], theirs.points[good], atol=1e-4)
    blocked = surface.occluded(origins, directions)
    assert (blocked[short] == theirs.hit[short]).mean() > 0.998
    assert mine.face.max() < len(patch.mesh.faces)


def test_rays_from_far_away_arrive():
    surface = PeriodicSurface(sawtooth(2, 0.3, 1.2))
    point = np.array([[0.31, 0.4, 5.0]])
    towards = np.array([[-1.0, 0.3, -0.02]])
    near = surface.first_hits(point, towards)
    away = point - 40 * towards
    far = surface.first_hits(away, towards)
    assert near.hit.all()
    np.testing.assert_allclose(near.points, far.points, atol=1e-4)
    assert not surface.first_hits(point, -towards).hit.any()
    assert not surface.occluded(point, -towards).any()


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: height_field(np.full((2, 2), np.nan)), "finite"),
        (lambda: sawtooth(0), "at least one tooth"),
        (lambda: sawtooth(2, np.pi / 2, np.pi / 2), "upright"),
        (lambda: sawtooth(2, -0.1), "angles"),
        (lambda: velvet(0), "at least one thread"),
        (lambda: velvet(5, length=-1.0), "positive"),
        (lambda: gaussian_surface(0.3, cells=32, correlation=0.01), "correlation"),
        (lambda: velvet(5, length=3.0, lean=1.2), "larger"),
        (lambda: Patch.of(Mesh.icosphere(0), np.zeros(3, int)), "materials"),
        (lambda: Patch.of(Mesh.icosphere(0), None, np.zeros((2, 2))), "rectangle"),
    ],
)
def test_what_is_no_patch_is_refused(made, words):
    with pytest.raises(ValueError, match=words):
        made()
