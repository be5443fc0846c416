"""Transfer vectors.

Pinned down: of a convex object they are A_l Y_lm(n): exactly, and by plain quadrature to 1e-3 at
1024 directions for degrees up to 2 (to degree 8 at 2048); in a notch they are the integrals by
hand; on a sculpture they are the sum over brute-force rays, whichever way they are found; the
stated errors are the errors; no more light than on the open; the irradiance they give is the
integral with visibility of the same light; interpolation; what is refused.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import Lambertian
from jaxrender.geometry import (
    Mesh,
    Sphere,
    SurfacePlaces,
    SurfaceSamples,
    fibonacci_sphere,
    sculpture,
    visible,
)
from jaxrender.harmonics import LatLongGrid, degrees, real_basis, synthesise
from jaxrender.lighting import Environment
from jaxrender.reflection import (
    Quadrature,
    integral_columns,
    interpolated,
    irradiance,
    shadowed_irradiance,
    transfer,
    transfer_vectors,
)
from jaxrender.spectra import lambertian_transfer

ROUNDING = 1e-12
BALL = Mesh.icosphere(3)
ON_BALL = SurfacePlaces.of_vertices(BALL)
STATUE = sculpture(3, seed=1)
SOME = np.random.default_rng(0).choice(len(STATUE.vertices), 60, replace=False)


def on_statue(chosen=SOME):
    about = SurfacePlaces.of_vertices(STATUE)
    return SurfacePlaces(*(rows[chosen] for rows in about)), STATUE.normals[chosen]


def open_transfer(normals, band_limit):
    basis = np.asarray(real_basis(normals, band_limit))
    return basis * lambertian_transfer(band_limit)[degrees(band_limit)]


@pytest.mark.parametrize(("shape", "places"), [(BALL, ON_BALL), (Sphere(), ON_BALL)])
def test_convex_shapes_are_exact(shape, places):
    found = transfer_vectors(shape, places, BALL.normals, 6)
    np.testing.assert_allclose(found.values, open_transfer(BALL.normals, 6), atol=ROUNDING)
    np.testing.assert_array_equal(found.errors, 0)


@pytest.mark.parametrize(("directions", "band_limit"), [(1024, 2), (2048, 8)])
def test_plain_quadrature_of_convex_shapes(directions, band_limit):
    """The largest error of any coefficient at any vertex."""
    plain = Quadrature(directions, plain=True)
    found = transfer_vectors(BALL, ON_BALL, BALL.normals, band_limit, plain)
    expected = open_transfer(BALL.normals, band_limit)
    np.testing.assert_allclose(found.values, expected, rtol=0, atol=1e-3)


def test_a_notch_by_hand():
    """On the floor by a wall that hides all beyond the angle a from +x, turning about the y axis.

    With w = (cos t sin u, cos u, sin t sin u): int z = (1 - cos a) pi / 2,
    int x z = (2 / 3) sin^2 a, int z^2 = (2 a - sin 2 a) / 3, and int y z = 0.
    """
    half = 200.0
    vertices = np.array(
        [[0, -half, 0], [1, -half, 0], [1, half, 0], [0, half, 0], [0, -half, 1], [0, half, 1]]
    )
    notch = Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 5], [0, 5, 4]]))
    x = np.array([0.4, 0.7, 0.9])
    up = np.tile([0.0, 0, 1], (3, 1))
    places = SurfacePlaces(np.stack([x, np.zeros(3), np.zeros(3)], axis=-1), up)
    offset = 1e-4 * notch.diagonal()
    a = np.pi - np.arctan2(1 - offset, x)
    c0, c1 = np.sqrt(1 / (4 * np.pi)), np.sqrt(3 / (4 * np.pi))
    expected = np.stack(
        [
            c0 * (1 - np.cos(a)) * np.pi / 2,
            np.zeros(3),
            c1 * (2 * a - np.sin(2 * a)) / 3,
            c1 * 2 / 3 * np.sin(a) ** 2,
        ],
        axis=-1,
    )
    for plain in (False, True):
        found = transfer_vectors(notch, places, up, 1, Quadrature(20_000, plain=plain))
        # The wall's ends, and the quadrature of an indicator function.
        np.testing.assert_allclose(found.values, expected, atol=2e-3)


def test_it_is_the_sum_over_brute_force_rays(monkeypatch):
    """With one rotation, the directions are known: every ray against every triangle."""
    few = SOME[:12]
    places, normals = on_statue(few)
    monkeypatch.setattr(transfer, "_ROTATIONS", 1)
    sets = []

    def remember(shape, some, directions):
        sets.append(directions)
        return visible(shape, some, directions)

    monkeypatch.setattr(transfer, "visible", remember)
    plain = transfer_vectors(STATUE, places, normals, 4, Quadrature(120, 5, plain=True))
    clever = transfer_vectors(STATUE, places, normals, 4, Quadrature(120, 5))
    directions = sets[0]
    assert directions.shape == (120, 3)
    basis = np.asarray(real_basis(directions, 4))
    open_places = open_transfer(normals, 4)
    for place, (point, normal) in enumerate(zip(*places)):
        origins = np.tile(point + 1e-4 * STATUE.diagonal() * normal, (120, 1))
        free = ~STATUE.occluded_brute_force(origins, directions) & (directions @ normal > 0)
        cosines = np.maximum(directions @ normals[place], 0) * 4 * np.pi / 120
        np.testing.assert_allclose(plain.values[place], (free * cosines) @ basis, atol=ROUNDING)
        expected = open_places[place] - (~free * cosines) @ basis
        np.testing.assert_allclose(clever.values[place], expected, atol=ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("plain", [False, True])
def test_the_stated_errors_are_the_errors(plain):
    places, normals = on_statue()
    # Eight times fewer errors than what is judged.
    reference = transfer_vectors(STATUE, places, normals, 4, Quadrature(10_000, seed=9))
    stated, true = [], []
    for seed in range(5):
        found = transfer_vectors(STATUE, places, normals, 4, Quadrature(600, seed, plain))
        stated.append(found.errors)
        true.append(np.sqrt(np.mean((found.values - reference.values) ** 2, axis=1)))
    stated, true = (np.sqrt(np.mean(np.square(rows))) for rows in (stated, true))
    assert stated == pytest.approx(true, rel=0.15)
    assert true < 4e-3


def test_open_places_gain_from_what_is_known():
    """The most open tenth; elsewhere the silhouettes' edges decide."""
    places, normals = on_statue()
    known, plain = (
        transfer_vectors(STATUE, places, normals, 4, Quadrature(600, 0, plain)).errors
        for plain in (False, True)
    )
    assert np.quantile(known, 0.1) < 0.8 * np.quantile(plain, 0.1)
    assert np.median(known) < 1.1 * np.median(plain)


def test_no_place_receives_more_than_an_open_one():
    places, normals = on_statue()
    found = transfer_vectors(STATUE, places, normals, 0)
    limit = np.pi * np.sqrt(1 / (4 * np.pi))
    assert np.all(found.values > 0)
    assert np.all(found.values <= limit)
    assert np.mean(found.values < 0.9 * limit) > 0.2


def test_irradiance_is_the_integral_with_visibility():
    rng = np.random.default_rng(2)
    light = rng.normal(size=(25, 3))
    light[0] = 25
    grid = LatLongGrid(64, 128)
    nodes = Environment(np.asarray(synthesise(grid, light))).nodes()
    places, normals = on_statue()
    found = transfer_vectors(STATUE, places, normals, 4, Quadrature(4096))
    seen = visible(STATUE, places, nodes.directions)
    columns = integral_columns(
        Lambertian(np.ones(3)), SurfaceSamples(normals, normals), nodes, seen
    )
    expected = np.asarray(columns)[:, 0]
    found = np.asarray(shadowed_irradiance(light, found.values))
    # The integral is a sum over texels, cut by shadows: a part in a thousand of the light.
    np.testing.assert_allclose(found, expected, atol=4e-3 * expected.max())
    unshadowed = np.asarray(irradiance(jnp.asarray(light), jnp.asarray(normals)))
    assert np.abs(found - unshadowed).max() > 0.1 * expected.max()


def test_irradiance_takes_the_degrees_that_both_have():
    light = np.random.default_rng(3).normal(size=(16, 2))
    vectors = np.random.default_rng(4).normal(size=(5, 9))
    expected = vectors @ light[:9]
    np.testing.assert_allclose(shadowed_irradiance(light, vectors), expected, rtol=1e-9)
    np.testing.assert_allclose(
        shadowed_irradiance(light[:4], vectors), vectors[:, :4] @ light[:4], rtol=1e-9
    )
    single = shadowed_irradiance(light.astype(np.float32), vectors)
    assert single.dtype == jnp.float32


def test_neither_chunks_nor_order_show(monkeypatch):
    places, normals = on_statue()
    whole = transfer_vectors(STATUE, places, normals, 3, Quadrature(200))
    monkeypatch.setattr(transfer, "_PLACES_AT_ONCE", 1)
    parts = transfer_vectors(STATUE, places, normals, 3, Quadrature(200))
    np.testing.assert_allclose(parts.values, whole.values, atol=ROUNDING)
    none = SurfacePlaces(np.zeros((0, 3)), np.zeros((0, 3)))
    assert transfer_vectors(STATUE, none, np.zeros((0, 3)), 3).values.shape == (0, 16)


def test_interpolation():
    rng = np.random.default_rng(5)
    face = rng.integers(0, len(STATUE.faces), 50)
    weights = rng.dirichlet(np.ones(3), 50)
    places = SurfacePlaces.on_faces(STATUE, face, weights)
    found = interpolated(STATUE.vertices, STATUE.faces, face, weights)
    np.testing.assert_allclose(found, places.points, atol=ROUNDING)
    corner = interpolated(STATUE.normals, STATUE.faces, face, np.tile([0.0, 1, 0], (50, 1)))
    np.testing.assert_array_equal(corner, STATUE.normals[STATUE.faces[face, 1]])
    scalar = interpolated(STATUE.vertices[:, 0], STATUE.faces, face, weights)
    np.testing.assert_allclose(scalar, places.points[:, 0], atol=ROUNDING)
    with pytest.raises(ValueError, match="no face"):
        interpolated(STATUE.vertices, STATUE.faces, np.array([-1]), np.zeros((1, 3)))


def test_directions_must_be_halved():
    with pytest.raises(ValueError, match="7 directions: give an even number"):
        transfer_vectors(STATUE, *on_statue(), 2, Quadrature(7))


def test_the_directions_turned_are_even():
    """Coefficients of degree 1 and above integrate to nothing over any turned set."""
    mean = np.asarray(real_basis(fibonacci_sphere(1024), 8)).mean(axis=0)
    assert np.abs(mean[1:]).max() < 1e-3
