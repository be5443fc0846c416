"""What a camera sees of a shape.

Pinned down: a sphere's image is a disc of the right size with exact normals, the pixel of a known
point, outgoing directions towards the camera, positive exit cosines; everything is zero off the
shape; backs of faces and normals that face away are not hits; Embree's chunks give the image of the
twin.
"""

import numpy as np
import pytest

from jaxrender.geometry import Mesh, Orthographic, Pinhole, Sphere, look_at, observe

ROUNDING = 1e-12
UP = np.array([0.0, 0, 1])
POSE = look_at(np.array([4.0, 1.0, 2.0]), np.zeros(3), UP)


@pytest.mark.parametrize(
    "camera", [Pinhole(64, 48, POSE, fl_x=80.0), Orthographic(64, 48, POSE, scale=0.05)]
)
def test_points_normals_and_exit_directions_of_a_sphere(camera):
    view = observe(camera, Sphere())
    assert view.hit.shape == (48, 64)
    np.testing.assert_allclose(view.points[view.hit], view.normals[view.hit], atol=ROUNDING)
    cosines = np.einsum("rci,rci->rc", view.normals, view.outgoing)
    np.testing.assert_allclose(view.exit_cosines, cosines, atol=ROUNDING)
    assert np.all(view.exit_cosines[view.hit] > 0)
    np.testing.assert_allclose(view.outgoing, -camera.rays().directions * view.hit[..., None])
    for image in (view.points, view.normals, view.outgoing, view.exit_cosines):
        np.testing.assert_array_equal(image[~view.hit], 0)
    rows, columns = np.nonzero(view.hit)
    pixels = camera.project(view.points[view.hit])
    np.testing.assert_allclose(pixels, np.stack([columns, rows], axis=-1) + 0.5, atol=1e-9)


def test_the_image_of_a_sphere_is_a_disc_of_the_right_area():
    view = observe(Orthographic(200, 200, POSE, scale=0.0125), Sphere())
    # Gauss's circle problem: the count of pixel centres errs by far less than the perimeter.
    np.testing.assert_allclose(view.hit.sum() * 0.0125**2, np.pi, rtol=3e-3)
    nearest = np.unravel_index(view.exit_cosines.argmax(), view.hit.shape)
    assert set(nearest) <= {99, 100}


def test_up_in_the_world_is_up_in_the_image():
    view = observe(Pinhole(40, 40, POSE, fl_x=60.0), Sphere())
    heights = view.points[..., 2]
    top = heights[view.hit.any(axis=1)][0].max()
    bottom = heights[view.hit.any(axis=1)][-1].min()
    assert top > 0.5 > -0.5 > bottom


def test_a_mesh_in_several_chunks_looks_like_its_sphere():
    camera = Pinhole(200, 150, POSE, fl_x=300.0)
    exact, faceted = observe(camera, Sphere()), observe(camera, Mesh.icosphere(5))
    both = exact.hit & faceted.hit
    assert both.sum() > 0.995 * exact.hit.sum()
    inner = both & (exact.exit_cosines > 0.2)
    np.testing.assert_allclose(faceted.normals[inner], exact.normals[inner], atol=3e-3)


def test_the_back_of_a_face_is_not_seen():
    triangle = np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]])
    mesh = Mesh(triangle, np.array([[0, 1, 2]]))
    above = look_at(np.array([0.0, 0, 3]), np.zeros(3), np.array([0.0, 1, 0]))
    below = look_at(np.array([0.0, 0, -3]), np.zeros(3), np.array([0.0, 1, 0]))
    assert observe(Orthographic(9, 9, above, scale=0.05), mesh).hit.all()
    assert not observe(Orthographic(9, 9, below, scale=0.05), mesh).hit.any()
    towards_below = Mesh(mesh.vertices, mesh.faces, -mesh.normals)
    assert not observe(Orthographic(9, 9, below, scale=0.05), towards_below).hit.any()


def test_interpolated_normals_that_face_away_are_not_hits():
    triangle = np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]])
    turned = np.array([[0.0, 0, 1], [1, 0, -0.5], [0, 0, 1]])
    mesh = Mesh(triangle, np.array([[0, 1, 2]]), turned)
    above = look_at(np.array([0.0, 0, 3]), np.zeros(3), np.array([0.0, 1, 0]))
    view = observe(Orthographic(64, 64, above, scale=0.03), mesh)
    covered = observe(
        Orthographic(64, 64, above, scale=0.03), Mesh(triangle, np.array([[0, 1, 2]]))
    )
    lost = covered.hit & ~view.hit
    assert lost.any()
    assert view.hit.any()
    assert np.all(view.normals[view.hit][:, 2] > 0)
    np.testing.assert_array_equal(view.points[lost], 0)
