"""Surfaces that light leaves through.

- Frames are rotations whose axes are those of finite differences of the map, areas those of a
  finite parallelogram; whole areas are the known ones (sphere, cylinder, graph by quadrature).
- Normals of closed surfaces point outwards: the divergence theorem gives the volume.
- Rays cross a surface at the place whose point lies on the ray, and miss it where they should.
- A rectangle's solid angle is that of quadrature, and 4 pi / 6 for a face seen from the middle.
- Drawn places have the density that is stated: means of functions over draws are integrals.
- Bad rectangles, boxes, radii and grids are refused.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.lighting.luminaires.curved_surfaces import CylinderSurface, SphereSurface
from jaxrender.lighting.luminaires.parametric_surface import ParametricSurface
from jaxrender.lighting.luminaires.surfaces import Rectangle, box_faces

RNG = np.random.default_rng(0)


def wave(place):
    """A graph z = f(x, y) over a rectangle."""
    x, y = 2 * place[0], 3 * place[1]
    return jnp.stack([x, y, 0.3 * jnp.sin(x) * jnp.cos(y)])


SURFACES = {
    "rectangle": Rectangle(np.array([1.0, 2, 3]), np.array([0, 2.0, 0]), np.array([0, 0, 0.5])),
    "sphere": SphereSurface(np.array([1.0, -1, 2]), 0.7),
    "cylinder": CylinderSurface(np.array([1.0, 0, 0]), np.array([1.0, 2, -0.5]), 0.4),
    "bilinear": ParametricSurface.of_grid(
        np.array([[[0, 0, 0], [0, 1, 0.3]], [[1.0, 0, 0.2], [1.2, 1.1, -0.2]]])
    ),
    "wave": ParametricSurface(wave),
}


@pytest.fixture(params=SURFACES, name="surface")
def a_surface(request):
    return SURFACES[request.param]


def inner_places(count: int) -> np.ndarray:
    return RNG.uniform(0.02, 0.98, (count, 2))


def test_frames_and_areas_are_those_of_finite_differences(surface):
    places, step = inner_places(50), 1e-5
    on = surface.at(places)
    along = [
        (surface.at(places + d).points - surface.at(places - d).points) / (2 * step)
        for d in step * np.eye(2)
    ]
    across = np.cross(*along)
    area = np.linalg.norm(across, axis=1)
    np.testing.assert_allclose(on.area, area, rtol=1e-6)
    np.testing.assert_allclose(on.normals, across / area[:, None], atol=1e-6)
    tangent = along[0] / np.linalg.norm(along[0], axis=1, keepdims=True)
    np.testing.assert_allclose(on.frames[:, :, 0], tangent, atol=1e-6)
    gram = np.einsum("pij,pik->pjk", on.frames, on.frames)
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(3), gram.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(on.frames), 1, atol=1e-12)


def test_whole_areas():
    nodes, weights = np.polynomial.legendre.leggauss(24)
    line = (nodes + 1) / 2
    places = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    weight = np.outer(weights, weights).ravel() / 4
    x, y = 2 * places[:, 0], 3 * places[:, 1]
    slopes = 1 + 0.09 * ((np.cos(x) * np.cos(y)) ** 2 + (np.sin(x) * np.sin(y)) ** 2)
    axis = np.linalg.norm([1, 2, -0.5])
    known = {
        "rectangle": 1.0,
        "sphere": 4 * np.pi * 0.7**2,
        "cylinder": 2 * np.pi * 0.4 * axis,
        "wave": 6 * weight @ np.sqrt(slopes),
    }
    for name, area in known.items():
        assert weight @ SURFACES[name].at(places).area == pytest.approx(area, rel=1e-9)


def test_normals_point_outwards():
    # int x . n dA = 3 volumes.
    faces = box_faces(np.array([1.0, 2, 3]), np.array([2.0, 4, 6]))
    middle = np.array([[0.5, 0.5]])
    flux = sum(
        float((f.at(middle).points * f.at(middle).normals).sum() * f.at(middle).area[0])
        for f in faces
    )
    assert flux == pytest.approx(3 * 6)
    on = SURFACES["sphere"].at(inner_places(20))
    outwards = (on.points - np.array([1.0, -1, 2])) / 0.7
    np.testing.assert_allclose(on.normals, outwards, atol=1e-12)


def test_rays_cross_at_the_place_whose_point_is_on_them(surface):
    places = inner_places(200)
    on = surface.at(places)
    origins = on.points + 0.3 * on.normals + 0.1 * RNG.normal(size=(200, 3))
    towards = on.points - origins
    reach = np.linalg.norm(towards, axis=1)
    towards /= reach[:, None]
    distance, found = surface.crossings(origins, towards)
    assert np.isfinite(distance).all()
    np.testing.assert_allclose(
        surface.at(found).points, origins + distance[:, None] * towards, atol=1e-9
    )
    # Nothing is met behind, and what is first is not farther than the goal.
    assert (distance <= reach + 1e-9).all()
    same = np.abs(distance - reach) < 1e-9
    assert same.mean() > 0.7
    np.testing.assert_allclose(found[same], places[same], atol=1e-7)
    away = surface.crossings(on.points + 50 * on.normals, on.normals).distance
    assert np.isinf(away).all()


def test_open_cylinder_is_seen_from_within_and_missed_along_its_axis():
    cylinder = CylinderSurface(np.zeros(3), np.array([0, 0, 2.0]), 1.0)
    origins = np.array([[0, 0, 1.0], [0, 0, 5.0], [0.0, 0, 5], [3.0, 0, 2.1]])
    directions = np.array([[0.6, 0, 0.8], [0, 0, -1.0], [0.6, 0, -0.8], [-1.0, 0, 0]])
    distance = cylinder.crossings(origins, directions).distance
    # From within towards z = 1 + 4/3 there is no side any more; nor along the axis.
    assert np.isinf(distance[[0, 1, 3]]).all()
    assert np.isinf(distance[2])
    assert cylinder.crossings(origins[:1], np.array([[1.0, 0, 0]])).distance[0] == pytest.approx(1)


def test_solid_angle_of_a_rectangle():
    face = box_faces(-np.ones(3), np.ones(3))[0]
    inwards = Rectangle(face.corner, face.along_v, face.along_u)
    middle = np.zeros((1, 3))
    assert inwards.importance(middle)[0] == pytest.approx(4 * np.pi / 6)
    assert face.importance(middle)[0] == 0
    window = Rectangle(np.zeros(3), np.array([2.0, 0, 0]), np.array([0, 1.0, 0]))
    points = np.array([[3.0, 2, 0.5], [1, 0.5, 0.7], [-1.0, 0.3, 0.2]])
    nodes, weights = np.polynomial.legendre.leggauss(80)
    places = np.stack(np.meshgrid((nodes + 1) / 2, (nodes + 1) / 2), axis=-1).reshape(-1, 2)
    towards = points[:, None] - window.at(places).points[None]
    kernel = 2 * towards[..., 2] / np.linalg.norm(towards, axis=-1) ** 3
    angles = kernel @ (np.outer(weights, weights).ravel() / 4)
    np.testing.assert_allclose(window.importance(points), angles, rtol=1e-8)


@pytest.mark.parametrize("name", ["rectangle", "sphere", "cylinder"])
def test_drawn_places_have_the_stated_density(name):
    """E[g / p] over draws = int g dw, for g = cos t_e + height: by quadrature over the area."""
    surface = SURFACES[name]
    point = np.array([3.0, 1.5, 2.9])

    def values(places):
        on = surface.at(places)
        towards = point - on.points
        distance = np.linalg.norm(towards, axis=1)
        cosine = np.einsum("pi,pi->p", on.normals, towards) / distance
        g = np.maximum(cosine, 0) + on.points[:, 2] ** 2
        return np.where(cosine > 0, g, 0), np.maximum(cosine, 0) / distance**2 * on.area

    line = (np.arange(1000) + 0.5) / 1000
    places = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    g, solid = values(places)
    integral = (g * solid).mean()
    count = 200_000
    points = np.broadcast_to(point, (count, 3))
    drawn = surface.drawn(points, RNG.uniform(size=(count, 2)))
    density = surface.density(points, drawn)
    assert (density > 0).mean() > 0.9999
    estimates = values(drawn)[0] / np.where(density > 0, density, 1)
    error = estimates.std() / np.sqrt(count)
    assert abs(estimates.mean() - integral) < 4 * error + 2e-4 * integral


def test_a_small_far_sphere_keeps_its_digits():
    sphere = SphereSurface(np.array([0, 0, 1e5]), 1.0)
    assert sphere.importance(np.zeros((1, 3)))[0] == pytest.approx(np.pi * 1e-10, rel=1e-9)


def test_bad_surfaces_are_refused():
    edge = np.array([1.0, 0, 0])
    with pytest.raises(ValueError, match="not perpendicular"):
        Rectangle(np.zeros(3), edge, np.array([1.0, 1, 0]))
    with pytest.raises(ValueError, match="not zero"):
        Rectangle(np.zeros(3), edge, np.zeros(3))
    with pytest.raises(ValueError, match="must be the larger"):
        box_faces(np.zeros(3), np.array([1.0, -1, 1]))
    with pytest.raises(ValueError, match="positive radius"):
        SphereSurface(np.zeros(3), 0.0)
    with pytest.raises(ValueError, match="axis is zero"):
        CylinderSurface(np.zeros(3), np.zeros(3), 1.0)
    with pytest.raises(ValueError, match="two or more"):
        ParametricSurface.of_grid(np.zeros((1, 4, 3)))
    with pytest.raises(ValueError, match="at least one"):
        ParametricSurface(wave, (0, 4))
