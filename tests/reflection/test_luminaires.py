"""Direct light from luminaires by integration over area, and from point lights.

- A rectangle parallel to the surface is the known configuration factor, and any rectangle Lambert's
  polygon formula.  The unit square at height 3 of L = 1 and f_r = 1/pi gives .0341; the formulas as
  printed (ERRATA 66: cos t_i alone; ERRATA 69: 4 times) give .315 and .136.
- A uniform sphere is pi L (R/d)^2: so the area Jacobian of its (u, v) is in.
- A box seen from outside is the sum of its faces by the polygon formula; seen from within nothing,
  and pi L when its faces shine inwards.
- BRDF and light are asked in frames of their own: turning everything changes nothing, and a
  luminaire that shines one way only lights what lies there.
- A sphere that hides part of a rectangle takes away what an independent ray test says; so does a
  part of the luminaire itself.
- What leaves through an enclosing sphere is the power.
- A point light is I f_r cos t / r^2: .1535, not .955 (ERRATA 68); it is the limit of small spheres.
- Derivatives by the BRDF and by the coefficients; single precision; bad rules.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf.lambertian import Lambertian
from jaxrender.brdf.phong import Phong
from jaxrender.geometry import Mesh, Sphere, rotation
from jaxrender.lighting.luminaires.curved_surfaces import SphereSurface
from jaxrender.lighting.luminaires.luminaire import Luminaire
from jaxrender.lighting.luminaires.measured import compressed
from jaxrender.lighting.luminaires.parametric_surface import ParametricSurface
from jaxrender.lighting.luminaires.surfaces import Rectangle, box_faces
from jaxrender.lighting.positional import IsotropicIntensity, PointLight, SpotIntensity
from jaxrender.reflection.tracing.luminaires import (
    ShadedPoints,
    cell_rule,
    direct_light,
    from_point_light,
    gauss_rule,
)

RNG = np.random.default_rng(0)
WHITE = Lambertian(np.array([1 / np.pi]))
ONE = np.array([1.0])
UP = np.array([[0, 0, 1.0]])
FINE = gauss_rule(24)


def at(points, normals):
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return ShadedPoints.of(points, normals, normals)


def above(width: float, depth: float, height: float) -> Rectangle:
    """A rectangle that shines down, one corner above the origin."""
    corner = np.array([0, 0, height])
    return Rectangle(corner, np.array([0, depth, 0]), np.array([width, 0, 0]))


def polygon(corners: np.ndarray, point: np.ndarray, normal: np.ndarray) -> float:
    """Lambert: E = L / 2 sum of angle times n . unit normal of the edge's plane, for L = 1."""
    spokes = corners - point
    spokes = spokes / np.linalg.norm(spokes, axis=1, keepdims=True)
    following = np.roll(spokes, -1, axis=0)
    across = np.cross(spokes, following)
    sine = np.linalg.norm(across, axis=1)
    angle = np.arctan2(sine, np.einsum("ki,ki->k", spokes, following))
    return abs(float(np.sum(angle * (across @ normal) / sine)) / 2)


def corners_of(face: Rectangle) -> np.ndarray:
    u, v = face.along_u, face.along_v
    return face.corner + np.stack([0 * u, u, u + v, v])


def test_rectangle_above_is_the_configuration_factor():
    a, b = 1.0 / 0.8, 2.0 / 0.8
    factor = (
        a / np.sqrt(1 + a * a) * np.arctan(b / np.sqrt(1 + a * a))
        + b / np.sqrt(1 + b * b) * np.arctan(a / np.sqrt(1 + b * b))
    ) / (2 * np.pi)
    luminaire = Luminaire.uniform([above(1.0, 2.0, 0.8)], 3 * ONE)
    found = direct_light(at(np.zeros((1, 3)), UP), WHITE, luminaire, FINE)
    assert float(found[0, 0]) == pytest.approx(3 * factor, rel=1e-9)


def test_the_published_numbers():
    """Unit square at height 3: with cos t_e / r^2 left out it would be .315, with a 4 .136."""
    luminaire = Luminaire.uniform([above(1.0, 1.0, 3.0)], ONE)
    found = direct_light(at(np.array([[0.5, 0.5, 0]]), UP), WHITE, luminaire, FINE)
    assert float(found[0, 0]) == pytest.approx(0.0341, abs=5e-5)


def test_any_rectangle_is_the_polygon_formula():
    turn = np.asarray(rotation(0.7, 1.9, -0.4))
    face = Rectangle(np.array([1.0, 2, 1]), 1.5 * turn[:, 0], 0.8 * turn[:, 1])
    middle = face.at(np.array([[0.5, 0.5]]))
    points = middle.points + 2 * middle.normals + RNG.uniform(-1, 1, (20, 3))
    normals = middle.points - points
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    luminaire = Luminaire.uniform([face], ONE)
    found = np.asarray(direct_light(at(points, normals), WHITE, luminaire, FINE))[:, 0]
    expected = [polygon(corners_of(face), p, n) / np.pi for p, n in zip(points, normals)]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_uniform_sphere():
    ball = Luminaire.uniform([SphereSurface(np.array([1.0, 2, 3]), 0.5)], ONE)
    points = np.array([[0, 0, 0.0], [1.0, 2, 1.5]])
    normals = np.array([1.0, 2, 3]) - points
    found = direct_light(at(points, normals), WHITE, ball, cell_rule(256))[:, 0]
    expected = 0.25 / np.sum(normals**2, axis=1)
    np.testing.assert_allclose(found, expected, rtol=2e-3)


def test_box_from_outside_and_from_within():
    faces = box_faces(-np.ones(3), np.array([1.0, 2, 1]))
    box = Luminaire.uniform(faces, ONE, convex=True)
    point, normal = np.array([[4.0, 3, 2.5]]), np.array([[-4.0, -3, -2.5]])
    unit = normal[0] / np.linalg.norm(normal)
    seen = [faces[i] for i in (1, 3, 5)]
    expected = sum(polygon(corners_of(face), point[0], unit) for face in seen) / np.pi
    found = direct_light(at(point, normal), WHITE, box, FINE)
    assert float(found[0, 0]) == pytest.approx(expected, rel=1e-8)
    within = at(np.array([[0.1, 0.2, -0.3]]), UP)
    assert float(direct_light(within, WHITE, box, FINE)[0, 0]) == 0
    inwards = [Rectangle(face.corner, face.along_v, face.along_u) for face in faces]
    hollow = Luminaire.uniform(inwards, ONE, convex=True)
    found = direct_light(within, WHITE, hollow, cell_rule(128))
    assert float(found[0, 0]) == pytest.approx(1, rel=2e-3)


def beam(size: int, towards: np.ndarray) -> np.ndarray:
    """Samples of radiance about one direction of the patch's frame, brighter at larger u."""
    line = (np.arange(size) + 0.5) / size
    u, _, kappa, lam = np.meshgrid(line, line, line, line, indexing="ij")
    x, y = 2 * kappa - 1 - towards[0], 2 * lam - 1 - towards[1]
    return ((1 + u) * np.exp(-4 * (x * x + y * y)))[..., None]


def test_turning_everything_changes_nothing_and_frames_are_apart():
    window = above(1.0, 2.0, 1.5)
    tree = compressed(beam(8, np.array([0.5, -0.3])))
    brdf = Phong(np.array([0.1]), np.array([0.2]), 20.0)
    points = RNG.uniform([-1, -1, 0], [2, 2, 0.3], (10, 3))
    outgoing = RNG.normal(size=(10, 3)) * [1, 1, 0] + [0, 0, 1.0]
    outgoing /= np.linalg.norm(outgoing, axis=1, keepdims=True)
    normals = np.tile(UP, (10, 1))
    rule = gauss_rule(16)
    here = direct_light(
        ShadedPoints.of(points, normals, outgoing), brdf, Luminaire([window], [tree]), rule
    )
    turn = np.asarray(rotation(1.1, -2.0, 0.6))
    turned_face = Rectangle(*(turn @ v for v in (window.corner, window.along_u, window.along_v)))
    there = direct_light(
        ShadedPoints.of(points @ turn.T, normals @ turn.T, outgoing @ turn.T),
        brdf,
        Luminaire([turned_face], [tree]),
        rule,
    )
    # Haar's steps: a rounding may put a direction into the next cell.
    np.testing.assert_allclose(here, there, rtol=1e-6)


def test_a_luminaire_lights_where_it_shines():
    """The luminaire's +X is dx'/du = world +Y: a beam along it lights points on that side."""
    luminaire = Luminaire([above(0.2, 0.2, 1.0)], [compressed(beam(8, np.array([0.7, 0.0])))])
    points = np.array([[0.1, 1.1, 0], [0.1, -0.9, 0], [1.1, 0.1, 0], [-0.9, 0.1, 0]])
    found = np.asarray(
        direct_light(at(points, np.tile(UP, (4, 1))), WHITE, luminaire, gauss_rule(8))
    )
    assert found[0, 0] > 20 * found[1, 0]
    assert found[0, 0] > 4 * max(found[2, 0], found[3, 0])


def test_a_sphere_hides_part_of_a_rectangle():
    ball = Sphere(np.array([0.5, 0.5, 0.8]), 0.25)
    face = Rectangle(np.array([0, 0, 2.0]), np.array([0, 1.0, 0]), np.array([1.0, 0, 0]))
    luminaire = Luminaire.uniform([face], ONE)
    point = np.array([[0.2, 0.4, 0.0]])
    rule = cell_rule(200)
    found = float(direct_light(at(point, UP), WHITE, luminaire, rule, ball)[0, 0])
    nodes = face.at(rule.places).points
    segment = nodes - point
    length = np.linalg.norm(segment, axis=1)
    towards = np.array([0.5, 0.5, 0.8]) - point[0]
    # Distance of the centre from the segment's line, by the cross product.
    away = np.linalg.norm(np.cross(towards, segment), axis=1) / length
    kernel = np.where(away > 0.25, (segment[:, 2] / length) ** 2 / length**2, 0)
    assert found == pytest.approx(kernel.mean() / np.pi, rel=1e-4)
    free = float(direct_light(at(point, UP), WHITE, luminaire, rule)[0, 0])
    assert 0.2 * free < found < 0.8 * free


def test_points_on_the_occluder_see_past_their_own_surface():
    floor = Mesh(
        np.array([[-5.0, -5, 0], [5, -5, 0], [5, 5, 0], [-5, 5, 0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    luminaire = Luminaire.uniform([above(1.0, 1.0, 3.0)], ONE)
    here = at(np.array([[0.3, 0.1, 0]]), UP)
    free, hidden = (direct_light(here, WHITE, luminaire, FINE, o) for o in (None, floor))
    np.testing.assert_allclose(free, hidden)


def test_a_luminaire_hides_itself():
    """Two parallel sheets that shine down: the upper one is not seen through the lower."""
    sheets = [above(1.0, 1.0, 2.0), above(1.0, 1.0, 2.5)]
    both = Luminaire.uniform(sheets, ONE)
    one = Luminaire.uniform(sheets[:1], ONE)
    here = at(np.array([[0.5, 0.5, 0]]), UP)
    found = [
        float(direct_light(here, WHITE, luminaire, cell_rule(64))[0, 0])
        for luminaire in (both, one)
    ]
    assert found[0] == pytest.approx(found[1], rel=1e-12)


def test_a_curved_patch_hides_its_own_far_side():
    """An arch that shines inwards: from outside, its near half hides the far half's bright side."""
    arch = ParametricSurface(
        lambda p: jnp.stack([jnp.cos(np.pi * p[0]), 4 * p[1] - 2, jnp.sin(np.pi * p[0])])
    )
    luminaires = [Luminaire.uniform([arch], ONE, convex=convex) for convex in (False, True)]
    outside = at(np.array([[-1.5, 0, 0.6]]), np.array([[1.0, 0, 0]]))
    hidden, through = (
        float(direct_light(outside, WHITE, luminaire, cell_rule(24))[0, 0])
        for luminaire in luminaires
    )
    assert hidden == 0
    assert through > 0.05
    within = at(np.array([[0, 0, 0.0]]), UP)
    seen, free = (
        float(direct_light(within, WHITE, luminaire, cell_rule(24))[0, 0])
        for luminaire in luminaires
    )
    assert seen == pytest.approx(free, rel=1e-12)


def test_power_leaves_through_an_enclosing_sphere():
    size = 4
    faces = box_faces(-np.array([0.5, 0.4, 0.3]), np.array([0.5, 0.4, 0.3]))
    trees = [compressed(beam(size, RNG.uniform(-0.5, 0.5, 2))) for _ in faces]
    luminaire = Luminaire(faces, trees, convex=True)
    cosine, weight = np.polynomial.legendre.leggauss(48)
    azimuth = 2 * np.pi * (np.arange(96) + 0.5) / 96
    sine = np.sqrt(1 - cosine**2)
    normals = np.stack(
        [
            np.outer(sine, np.cos(azimuth)),
            np.outer(sine, np.sin(azimuth)),
            np.outer(cosine, np.ones(96)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    irradiance = direct_light(
        at(3 * normals, -normals), Lambertian(ONE), luminaire, cell_rule(size)
    )
    flux = 9 * np.repeat(weight, 96) * 2 * np.pi / 96 @ np.asarray(irradiance)[:, 0]
    assert flux == pytest.approx(float(luminaire.power()[0]), rel=5e-3)


def test_point_light_has_the_cosine_and_no_four():
    angle = np.radians(50)
    light = PointLight(2 * np.array([np.sin(angle), 0, np.cos(angle)]), IsotropicIntensity(3 * ONE))
    found = float(from_point_light(at(np.zeros((1, 3)), UP), WHITE, light)[0, 0])
    assert found == pytest.approx(3 / np.pi * np.cos(angle) / 4, rel=1e-12)
    assert found == pytest.approx(0.1535, abs=1e-4)
    # A small sphere of radiance L has intensity pi L R^2.
    ball = SphereSurface(np.asarray(light.position), 0.01)
    luminaire = Luminaire.uniform([ball], 3 * ONE / (np.pi * 1e-4))
    near = float(direct_light(at(np.zeros((1, 3)), UP), WHITE, luminaire, cell_rule(128))[0, 0])
    assert found == pytest.approx(near, rel=3e-3)


def test_point_light_in_the_shadow():
    light = PointLight(np.array([0, 0, 2.0]), SpotIntensity(ONE, 1.0), np.diag([1.0, -1, -1]))
    points = np.array([[0, 0, 0.0], [2.0, 0, 0]])
    ball = Sphere(np.array([0, 0, 1.0]), 0.3)
    found = np.asarray(from_point_light(at(points, np.tile(UP, (2, 1))), WHITE, light, ball))[:, 0]
    # cos^2 (beam and surface) over r^2 = 8 at 45 degrees.
    np.testing.assert_allclose(found, [0, 0.5 / 8 / np.pi], rtol=1e-9)


def test_derivatives_by_the_brdf_and_the_coefficients():
    tree = compressed(beam(4, np.zeros(2)))
    here, rule = at(np.array([[0.3, 0.4, 0]]), UP), gauss_rule(6)

    def light(scale):
        scaled = eqx.tree_at(
            lambda t: (t.root, t.values),
            tree,
            (tree.root * scale[0], jnp.asarray(tree.values) * scale[0]),
        )
        luminaire = Luminaire([above(1.0, 1.0, 1.0)], [scaled])
        return direct_light(here, Lambertian(ONE * scale[1]), luminaire, rule)[0, 0]

    start = jnp.array([1.0, 0.3])
    value, slopes = jax.jit(jax.value_and_grad(light))(start)
    # Linear in either.
    np.testing.assert_allclose(slopes, value / start, rtol=1e-9)


def test_single_precision_stays():
    luminaire = Luminaire.uniform([above(1.0, 1.0, 3.0)], ONE.astype(np.float32))
    here = ShadedPoints(*(np.asarray(p, np.float32) for p in at(np.array([[0.5, 0.5, 0]]), UP)))
    brdf = Lambertian(np.array([1 / np.pi], np.float32))
    found = direct_light(here, brdf, luminaire, gauss_rule(8))
    assert found.dtype == np.float32
    assert float(found[0, 0]) == pytest.approx(0.0341, abs=1e-4)
    light = PointLight(np.array([0, 0, 2.0]), IsotropicIntensity(ONE))
    assert from_point_light(here, brdf, light).dtype == np.float32


def test_bad_rules_are_refused():
    with pytest.raises(ValueError, match="at least one"):
        gauss_rule(0)
    with pytest.raises(ValueError, match="at least one"):
        cell_rule(0)
