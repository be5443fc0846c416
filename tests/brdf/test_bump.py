"""BRDFs under perturbed normals, and maps of them:

- radiance of a tilted BRDF is that of a facet turned by SciPy, for an anisotropic model as well
- a tilted Lambertian: kd max(0, n'.w_i) E exactly; by uniform light (1 + cos t) / 2 of its albedo
- the shifted coordinates of L 7.11 and the cosine that is left out (ERRATA 72) go red
- zero where either direction is below either horizon; an untilted one is the BRDF itself
- ``projected``: reciprocal, and the mean over a shallow sawtooth's sides is what a
  gonioreflectometer measures where nothing hides anything
- normals of heights: SymPy-free closed form of a wave, the right way up; of perturbations: added
- quantised normals are near, few and unit; equal ones are joined
- a bump pyramid: its top is the mean of the tilted BRDFs' tables (L 7.12), and not the BRDF under
  the mean normal
- float32, gradients in the normal, bad input
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.blinn_phong import BlinnPhong
from jaxrender.brdf.lambertian import Lambertian
from jaxrender.brdf.properties import directional_albedo, reciprocity_error
from jaxrender.brdf.tables.cell_means import tabulate
from jaxrender.brdf.textures.bump import (
    Tilted,
    bump_texture,
    normals_of_heights,
    normals_of_perturbations,
    quantised,
)
from jaxrender.brdf.textures.pyramid import BRDFPyramid
from jaxrender.brdf.ward import Ward
from jaxrender.geometry import NUSSELT
from jaxrender.geometry.height_fields import height_field, sawtooth
from jaxrender.reflection.tracing.gonioreflectometer import Gonioreflectometer, MeasureSettings

RNG = np.random.default_rng(11)
evaluate = eqx.filter_jit(BRDF.evaluate)
GLOSSY = BlinnPhong(np.array([0.1]), np.array([0.6]), 12.0)
BRUSHED = Ward(np.array([0.1]), np.array([0.2]), 0.2, 0.5)


def directions(count: int) -> np.ndarray:
    found = RNG.normal(size=(count, 3))
    found[:, 2] = np.abs(found[:, 2])
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def leaning(angle: float, azimuth: float = 0.7) -> np.ndarray:
    sine = np.sin(angle)
    return np.array([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(angle)])


@pytest.mark.parametrize("brdf", [GLOSSY, BRUSHED])
def test_radiance_is_that_of_a_turned_facet(brdf):
    normal = leaning(0.5)
    turn = Rotation.from_rotvec(0.5 * np.array([-np.sin(0.7), np.cos(0.7), 0]))
    np.testing.assert_allclose(turn.apply([0, 0, 1]), normal, atol=1e-12)
    towards, away = directions(100), directions(100)
    local = [turn.inv().apply(w) for w in (towards, away)]
    facet = np.asarray(evaluate(brdf, *local)) * np.maximum(towards @ normal, 0)[:, None]
    found = np.asarray(evaluate(Tilted(brdf, normal), towards, away)) * towards[:, 2:]
    assert (facet > 0).mean() > 0.5
    np.testing.assert_allclose(found, facet, rtol=1e-10, atol=1e-13)


def test_tilted_lambertian():
    normal, kd = leaning(0.6), np.array([0.2, 0.3])
    tilted = Tilted(Lambertian(kd), normal)
    towards, away = directions(100), directions(100)
    seen = (away @ normal > 0)[:, None]
    radiance = np.asarray(evaluate(tilted, towards, away)) * towards[:, 2:] * 2.5
    expected = kd * np.maximum(towards @ normal, 0)[:, None] * 2.5 * seen
    np.testing.assert_allclose(radiance, expected, atol=1e-13)


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.0])
def test_white_furnace(angle):
    """By uniform light, a facet leaning by t gets (1 + cos t) / 2 of what an upright one does."""
    cosines = [1.0, 0.8]
    tilted = Tilted(Lambertian(np.array([1 / np.pi])), leaning(angle))
    found = directional_albedo(tilted, cosines, fixed="outgoing", nodes=300)[:, 0]
    np.testing.assert_allclose(found, (1 + np.cos(angle)) / 2, atol=2e-3)


def test_shifted_coordinates_are_something_else():
    """L 7.11: coordinates shifted by the normal's, and no ratio of cosines."""
    normal, pair = leaning(0.4), (leaning(0.6, 0.2)[None], leaning(0.5, 2.0)[None])
    right = float(evaluate(Tilted(GLOSSY, normal), *pair)[0, 0])
    shift = -normal[:2] / 2
    places = [np.asarray(NUSSELT.square_from_direction(w)) + shift for w in pair]
    moved = [np.asarray(NUSSELT.direction_from_square(place)) for place in places]
    printed = float(evaluate(GLOSSY, *moved)[0, 0])
    turn = Rotation.from_rotvec(0.4 * np.array([-np.sin(0.7), np.cos(0.7), 0]))
    turned = float(evaluate(GLOSSY, *(turn.inv().apply(w) for w in pair))[0, 0])
    ratio = float(pair[0][0] @ normal / pair[0][0, 2])
    assert right == pytest.approx(turned * ratio, rel=1e-12)
    assert abs(printed / turned - 1) > 0.01
    assert abs(printed / right - 1) > 0.05


def test_horizons():
    normal = leaning(0.5, 0.0)
    tilted = Tilted(GLOSSY, normal)
    up, behind = np.array([[0.0, 0, 1]]), np.array([[-0.95, 0, np.sqrt(1 - 0.95**2)]])
    beneath = np.array([[np.sin(1.8), 0, np.cos(1.8)]])
    assert (behind @ normal < 0).all()
    assert (beneath @ normal > 0).all()
    for direction in (behind, beneath):
        assert not np.any(evaluate(tilted, direction, up))
        assert not np.any(evaluate(tilted, up, direction))
    assert np.all(evaluate(tilted, up, up) > 0)


def test_untilted_is_the_brdf():
    pair = directions(100), directions(100)
    for projected in (False, True):
        same = Tilted(GLOSSY, np.array([0.0, 0, 1]), projected)
        np.testing.assert_allclose(evaluate(same, *pair), evaluate(GLOSSY, *pair), rtol=1e-12)
        assert (same.reciprocal, same.isotropic) == (GLOSSY.reciprocal, GLOSSY.isotropic)
        assert same.conserves_energy == GLOSSY.conserves_energy
    tilted = Tilted(GLOSSY, leaning(0.3))
    promises = tilted.reciprocal, tilted.isotropic, tilted.conserves_energy
    assert not any(promises)
    assert reciprocity_error(tilted) > 0.1
    facet = Tilted(GLOSSY, leaning(0.3), projected=True)
    assert facet.reciprocal
    assert reciprocity_error(facet) < 1e-9


def test_projected_facets_are_a_real_surface():
    angle, brdf = 0.35, GLOSSY
    instrument = Gonioreflectometer.of(sawtooth(2, angle, angle), [brdf, brdf])
    towards = np.stack([leaning(0.2, 1.0), leaning(0.9, 0.3), leaning(1.0, 3.5)])
    away = leaning(0.7, 2.5)
    settings = MeasureSettings(samples=16 * 1000, bounces=1)
    found, _ = instrument.pairs(towards, away, settings, np.random.default_rng(0))
    sides = [Tilted(brdf, leaning(angle, azimuth), True) for azimuth in (0.0, np.pi)]
    away = np.tile(away, (3, 1))
    expected = np.mean([evaluate(side, towards, away) for side in sides], axis=0)
    # A lattice of 1000 places an exit direction finds the sides' shares to about 1e-3.
    np.testing.assert_allclose(found, expected, rtol=1e-3)
    plain = np.mean([evaluate(Tilted(brdf, s.normal), towards, away) for s in sides], axis=0)
    assert np.abs(plain / expected - 1).max() > 0.03


def test_normals_of_heights():
    rows, columns, height = 64, 128, 0.02
    v, u = 1 - (np.arange(rows) + 0.5) / rows, (np.arange(columns) + 0.5) / columns
    heights = height * (np.sin(2 * np.pi * u)[None, :] + np.cos(4 * np.pi * v)[:, None])
    found = normals_of_heights(heights, (2.0, 1.0))
    across = height * np.pi * np.cos(2 * np.pi * u)[None, :] + 0 * v[:, None]
    up = -height * 4 * np.pi * np.sin(4 * np.pi * v)[:, None] + 0 * u[None, :]
    expected = np.stack([-across, -up, np.ones_like(up)], axis=-1)
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    np.testing.assert_allclose(found, expected, atol=2e-3)
    # The rows of a patch of micro-geometry count upwards.
    mesh = height_field(heights[::-1], (2.0, 1.0)).mesh
    normals, places = mesh.face_normals(), mesh.vertices[mesh.faces].mean(axis=1)
    column = np.clip(places[:, 0] / 2 * columns, 0, columns - 1).astype(int)
    row = np.clip((1 - places[:, 1]) * rows, 0, rows - 1).astype(int)
    assert np.abs(normals - found[row, column]).max() < 0.05


def test_normals_of_perturbations():
    vectors = np.zeros((1, 2, 3))
    vectors[0, 1] = [1.0, 0, 0]
    found = normals_of_perturbations(vectors)
    np.testing.assert_allclose(found[0], [[0, 0, 1], [np.sqrt(0.5), 0, np.sqrt(0.5)]], atol=1e-15)
    vectors[0, 1] = [0, 0, -1.5]
    with pytest.raises(ValueError, match=r"perturbations\[0, 1\]"):
        normals_of_perturbations(vectors)


def test_quantised_normals():
    normals = normals_of_heights(0.03 * RNG.normal(size=(16, 16)))
    row, found = quantised(normals, 0.1)
    assert len(found) < 256
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-15)
    apart = np.linalg.norm((found[row] - normals)[..., :2], axis=-1)
    assert 0.03 < apart.max() <= 0.1 / np.sqrt(2) + 1e-12
    row, found = quantised(np.tile(normals[:1], (2, 1, 1)))
    assert len(found) == 16
    np.testing.assert_allclose(found[row], np.tile(normals[:1], (2, 1, 1)), atol=1e-12)
    with pytest.raises(ValueError, match="smaller"):
        quantised(leaning(0.7, 0.0).reshape(1, 1, 3), 1.0)
    with pytest.raises(ValueError, match="step=-1"):
        quantised(normals, -1.0)


def test_bump_pyramid_is_the_mean_of_tilted_brdfs():
    normals = np.stack([leaning(0.5, 0.0), leaning(0.5, np.pi)] * 2).reshape(2, 2, 3)
    texture = bump_texture(GLOSSY, normals, size=8)
    assert len(texture.trees) == 2
    top = BRDFPyramid.averaging(texture).level(1).trees[0].samples()
    tables = [
        tabulate(Tilted(GLOSSY, n), 8, dtype=np.float64).values
        for n in (normals[0, 0], normals[0, 1])
    ]
    np.testing.assert_allclose(top, np.mean(tables, axis=0), atol=1e-13)
    upright = tabulate(GLOSSY, 8, dtype=np.float64).values
    assert np.abs(top - upright).max() > 0.5 * upright.max()


def test_precision_and_gradients():
    pair = [np.asarray(w, np.float32) for w in (directions(5), directions(5))]
    single = Tilted(
        BlinnPhong(np.array([0.1], np.float32), np.array([0.6], np.float32), 12.0), leaning(0.3)
    )
    assert evaluate(single, *pair).dtype == jnp.float32
    towards, away = leaning(0.2, 1.0)[None], leaning(0.3, 2.0)[None]

    @jax.jit
    @jax.value_and_grad
    def radiance(slope):
        normal = jnp.stack([slope, jnp.zeros(()), jnp.sqrt(1 - slope**2)])
        return Tilted(GLOSSY, normal).evaluate(towards, away)[0, 0]

    found = float(radiance(0.1)[1])
    apart = float(radiance(0.1 + 1e-6)[0] - radiance(0.1 - 1e-6)[0]) / 2e-6
    assert found == pytest.approx(apart, rel=1e-6)


@pytest.mark.parametrize("normal", [[0, 0, 2.0], [0, 0, -1.0], [1.0, 0, 0]])
def test_bad_normals_are_refused(normal):
    with pytest.raises(ValueError, match="above the horizon"):
        Tilted(GLOSSY, np.array(normal))
