"""The table over two polar angles and the azimuth between them.

Pinned down: linear and B-spline are SciPy's on a table continued by hand over both poles and round
the azimuth; samples stand where they are said to, the azimuth measured from the incoming to the
outgoing direction; turning both directions changes nothing; samples that are symmetric are
reciprocal between them too; the error against a model falls with the step's square; derivatives;
precision; nothing from below the horizon; energy; every refusal.
"""

import equinox as eqx
import jax
import numpy as np
import pytest
from brdf_problems import single_precision, upper_directions
from jax.test_util import check_grads
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import map_coordinates

from jaxrender.brdf import BRDF, Lambertian, Phong, TorranceSparrow, Ward, reciprocity_error
from jaxrender.brdf.tables.polar_isotropic import PolarIsotropicTable

SIZE = (5, 7, 8)
VALUES = np.random.default_rng(0).uniform(size=(*SIZE, 2))
MODEL = TorranceSparrow(np.array([0.1, 0.05]), np.array([0.2, 0.3]), 0.4)

evaluate = eqx.filter_jit(BRDF.evaluate)


def pairs(count, seed):
    return upper_directions(count, seed), upper_directions(count, seed + 1)


def positions(a, b):
    """Places in the table, in samples."""
    polar = [np.arccos(d[:, 2]) / (np.pi / 2) * n - 0.5 for d, n in zip((a, b), SIZE, strict=False)]
    turn = np.arctan2(b[:, 1], b[:, 0]) - np.arctan2(a[:, 1], a[:, 0])
    return np.stack([*polar, turn % (2 * np.pi) / (2 * np.pi) * SIZE[2] - 0.5])


def padded(by=3):
    table = VALUES
    for axis in (0, 1):
        turned = np.roll(table, SIZE[2] // 2, axis=2).take(range(by), axis=axis)
        table = np.concatenate([np.flip(turned, axis=axis), table], axis=axis)
        table = np.pad(table, [(0, by if k == axis else 0) for k in range(4)], mode="edge")
    return np.pad(table, [(0, 0), (0, 0), (by, by), (0, 0)], mode="wrap")


def test_linear_is_scipys():
    a, b = pairs(400, 1)
    table = padded()
    grid = RegularGridInterpolator([np.arange(n) for n in table.shape[:3]], table)
    found = evaluate(PolarIsotropicTable(VALUES, "linear"), a, b)
    np.testing.assert_allclose(found, grid(positions(a, b).T + 3), rtol=1e-9)


def test_b_spline_is_scipys():
    a, b = pairs(400, 3)
    table, at = padded(), positions(a, b) + 3
    expected = [map_coordinates(table[..., c], at, order=3, prefilter=False) for c in range(2)]
    found = evaluate(PolarIsotropicTable(VALUES, "b-spline"), a, b)
    np.testing.assert_allclose(found, np.stack(expected, axis=-1), rtol=1e-9)


@pytest.mark.parametrize("reconstruction", ["constant", "linear", "cubic"])
def test_a_sample_has_its_own_value(reconstruction):
    angles = np.pi / 2 * 1.5 / 5, np.pi / 2 * 4.5 / 7, 2 * np.pi * 2.5 / 8
    a = np.array([[np.sin(angles[0]), 0, np.cos(angles[0])]])
    b = np.array(
        [
            [
                np.sin(angles[1]) * np.cos(angles[2]),
                np.sin(angles[1]) * np.sin(angles[2]),
                np.cos(angles[1]),
            ]
        ]
    )
    found = evaluate(PolarIsotropicTable(VALUES, reconstruction), a, b)
    np.testing.assert_allclose(found[0], VALUES[1, 4, 2], rtol=1e-9)


def test_turning_both_directions_changes_nothing():
    a, b = pairs(100, 5)
    c, s = np.cos(1.1), np.sin(1.1)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    table = PolarIsotropicTable(VALUES, "cubic")
    assert table.isotropic
    turned = evaluate(table, a @ turn.T, b @ turn.T)
    np.testing.assert_allclose(turned, evaluate(table, a, b), rtol=1e-8)


def test_symmetric_samples_are_reciprocal():
    table = PolarIsotropicTable.of(MODEL, (6, 6, 8), "cubic")
    assert table.reciprocal
    assert reciprocity_error(table) < 1e-9
    # Exchanged directions see the azimuth the other way round, which a handed table tells apart.
    any_values = VALUES[:, :5]
    back = any_values.transpose(1, 0, 2, 3)
    handed = PolarIsotropicTable(any_values + back[:, :, ::-1], "cubic")
    assert handed.reciprocal
    assert reciprocity_error(handed) < 1e-9
    assert not PolarIsotropicTable(any_values + back).reciprocal
    assert not PolarIsotropicTable.of(MODEL, (6, 5, 8)).reciprocal
    phong = Phong(np.ones(1) * 0.1, np.ones(1), 9.0)
    assert not PolarIsotropicTable.of(phong, (6, 6, 8)).reciprocal


def test_a_table_converges_to_its_model():
    a, b = upper_directions(3000, 7, 0.3), upper_directions(3000, 8, 0.3)
    truth = evaluate(MODEL, a, b)
    errors = []
    for n in (12, 24):
        table = PolarIsotropicTable.of(MODEL, (n, n, 2 * n))
        errors.append(np.sqrt(np.mean((evaluate(table, a, b) - truth) ** 2) / np.mean(truth**2)))
    assert errors[1] < 0.03
    assert errors[1] < errors[0] / 3


def test_energy():
    assert PolarIsotropicTable.of(Lambertian(np.array([0.9 / np.pi])), (3, 3, 4)).conserves_energy
    bright = PolarIsotropicTable(np.full((3, 3, 4, 1), 1.01 / np.pi))
    assert not bright.conserves_energy


def test_derivatives_horizon_and_precision():
    table = PolarIsotropicTable(VALUES, "cubic")
    a, b = (d[0] for d in pairs(1, 9))

    @jax.jit
    def value(values, incoming, outgoing):
        return PolarIsotropicTable(values, "cubic").evaluate(incoming, outgoing)[1]

    check_grads(value, (VALUES, a, b), 1, ("fwd", "rev"), rtol=1e-5, atol=1e-6)
    slopes = jax.jit(jax.grad(value, (1, 2)))
    up, down = np.array([0.0, 0, 1]), np.array([0.6, 0, -0.8])
    for pair in ((up, up), (up, b), (down, up), (b, b)):
        assert np.all(np.isfinite(slopes(VALUES, *pair)))
    a, b = pairs(20, 11)
    assert not np.any(evaluate(table, a * [1, 1, -1], b))
    single = evaluate(table, single_precision(a), single_precision(b))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, evaluate(table, a, b), rtol=1e-3, atol=1e-5)


def test_what_is_refused():
    with pytest.raises(ValueError, match="even number of azimuths"):
        PolarIsotropicTable(np.ones((3, 3, 5, 1)))
    with pytest.raises(ValueError, match="finite"):
        PolarIsotropicTable(np.full((3, 3, 4, 1), np.nan))
    with pytest.raises(ValueError, match="choose one of"):
        PolarIsotropicTable(VALUES, "quintic")
    with pytest.raises(ValueError, match="anisotropic"):
        PolarIsotropicTable.of(Ward(np.ones(1), np.ones(1), 0.2, 0.4), (3, 3, 4))
    with pytest.raises(ValueError, match="three positive"):
        PolarIsotropicTable.of(MODEL, (3, 0, 4))
