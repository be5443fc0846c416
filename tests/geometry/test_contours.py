"""Pixels beside which the surface breaks off or bends sharply.

- Within the rim of a ball there are none, however small its picture is.
- A plate before another is left out on both sides of its edge, and nowhere else.
- The edges of a cube are found, its faces are not.
- Elsewhere a pixel's central ray shows what the whole pixel does, and at contours it does not.
"""

import numpy as np
import pytest
import trimesh

from jaxrender.geometry import Mesh, Pinhole, Sphere, contours, look_at, observe, sculpture
from jaxrender.imaging import erode

TOWARDS = np.array([1.0, 0.2, -0.4])


def mesh_of(*parts):
    """Faces that share no vertex, so that each keeps its own normal."""
    whole = trimesh.util.concatenate(parts)
    whole.unmerge_vertices()
    return Mesh(np.asarray(whole.vertices), np.asarray(whole.faces), whole.vertex_normals)


def plate(width, height):
    return trimesh.creation.box((width, width, 0.01)).apply_translation((0, 0, height))


@pytest.mark.parametrize("size", [16, 20, 30, 60, 200])
@pytest.mark.parametrize("distance", [1.5, 4.0, 30.0])
def test_a_ball_has_none_within_its_rim(size, distance):
    rim = 1 / np.sqrt(distance**2 - 1)
    view = observe(seen_from([0, 0, distance], size, 1.05 * rim), Sphere())
    assert erode(view.hit, 1).sum() > 0.3 * size**2
    assert not np.any(contours(view) & erode(view.hit, 1))


def seen_from(eye, size, half_width):
    """A pinhole towards the origin that sees so much to either side, as a tangent."""
    pose = look_at(np.array(eye, float), np.zeros(3), np.array([0.0, 1, 0]))
    return Pinhole(size, size, pose, fl_x=size / 2 / half_width)


def test_a_plate_before_another_ends_in_one():
    view = observe(seen_from([0, 0, 10], 50, 0.1), mesh_of(plate(4, -1), plate(0.7, 0)))
    front = view.points[..., 2] > -0.5
    assert 200 < front.sum() < 2000
    edge = (front & ~erode(front, 1)) | (~front & ~erode(~front, 1))
    inside = erode(np.ones_like(front), 1)
    np.testing.assert_array_equal((contours(view) & inside), (edge & inside))


def test_the_edges_of_a_cube_alone():
    view = observe(seen_from([6, 5, 4], 80, 0.2), mesh_of(trimesh.creation.box((1, 1, 1))))
    side = np.argmax(np.abs(view.geometric_normals), axis=-1)
    face = np.where(view.hit, side, 3)
    near = np.zeros_like(view.hit)
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            other = np.roll(face, (down, right), (0, 1))
            near |= (other != face) & (other < 3) & view.hit
    assert near.sum() > 100
    np.testing.assert_array_equal(contours(view), near)


def test_elsewhere_a_pixel_shows_what_its_central_ray_does():
    shape, size, parts = sculpture(4, seed=2), 48, 5
    view = observe(seen_from([0.5, -5, 2.5], size, 0.3), shape)
    fine = observe(seen_from([0.5, -5, 2.5], size * parts, 0.3), shape)

    def brightness(of):
        return 2 + of.normals @ TOWARDS

    def per_pixel(image):
        return image.reshape(size, parts, size, parts).mean(axis=(1, 3))

    whole = per_pixel(fine.hit.astype(float)) == 1
    off = np.abs(per_pixel(brightness(fine)) - brightness(view))
    sharp = contours(view)
    assert np.sum(sharp & whole) > 30
    rest = off[whole & ~sharp]
    assert np.sqrt(np.mean(off[whole & sharp] ** 2)) > 5 * np.sqrt(np.mean(rest**2))
    assert np.quantile(rest, 0.99) < 0.05
