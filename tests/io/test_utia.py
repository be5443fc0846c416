"""UTIA's tables of anisotropic reflectance, and the BRDF over polar nodes that they become.

Pinned down: one marked entry, written at the offset that the format states, is seen from the pair
of directions with its angles and half as bright half-way to the next; between the nodes SciPy's
interpolator agrees, also across azimuth 0; beyond 75 degrees the value is held and below the
horizon zero; a smooth BRDF put on the nodes comes back; negative entries are counted and dark;
reciprocity is promised where it holds; float32 and derivatives; bad files and tables are refused.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.interpolate import RegularGridInterpolator

from jaxrender.brdf import BRDF, Ward, reciprocity_error
from jaxrender.brdf.tables.polar_nodes import PolarNodesTable, node_directions
from jaxrender.errors import InputError
from jaxrender.io.utia import LARGEST_POLAR, UtiaTable, read_utia

SIZE = 3 * 288 * 288

evaluate = eqx.filter_jit(BRDF.evaluate)


def towards(polar, azimuth):
    t, p = np.radians(polar), np.radians(azimuth)
    parts = [np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)]
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def small_table(shape=(3, 5, 4, 6, 2), seed=0, dtype=np.float64):
    return PolarNodesTable(np.random.default_rng(seed).uniform(0, 1, shape).astype(dtype), 1.2)


@pytest.mark.parametrize("channel", [0, 1, 2])
def test_a_marked_entry_is_where_it_belongs(tmp_path, channel):
    numbers = np.zeros(SIZE)
    # theta_i 30 degrees, phi_i 45; theta_v 60, phi_v 352.5.
    numbers[channel * 288**2 + 288 * (48 * 2 + 6) + 48 * 4 + 47] = 0.5
    path = tmp_path / "m.bin"
    path.write_bytes(numbers.astype("<f8").tobytes())
    brdf = read_utia(path).brdf(scale=2.0)
    light, view = towards(30, 45), towards(60, 352.5)
    expected = np.where(np.arange(3) == channel, 1.0, 0)
    np.testing.assert_allclose(evaluate(brdf, light, view), expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(evaluate(brdf, view, light), 0, atol=1e-12)
    half = evaluate(brdf, light, towards(60, 356.25))
    np.testing.assert_allclose(half, expected / 2, rtol=1e-9, atol=1e-12)
    half = evaluate(brdf, towards(37.5, 45), view)
    np.testing.assert_allclose(half, expected / 2, rtol=1e-9, atol=1e-12)


def test_interpolation_agrees_with_scipy():
    table = small_table()
    rng = np.random.default_rng(1)
    polar, azimuth = rng.uniform(0, 1.2, (2, 400)), rng.uniform(0, 2 * np.pi, (2, 400))
    closed = np.concatenate([table.values, table.values[:, :1]], axis=1)
    closed = np.concatenate([closed, closed[:, :, :, :1]], axis=3)
    axes = [np.linspace(0, end, n) for end, n in zip([1.2, 2 * np.pi] * 2, closed.shape)]
    twin = RegularGridInterpolator(axes, closed)
    expected = twin(np.stack([polar[0], azimuth[0], polar[1], azimuth[1]], axis=-1))
    directions = towards(np.degrees(polar), np.degrees(azimuth))
    np.testing.assert_allclose(evaluate(table, *directions), expected, rtol=1e-10)


def test_held_beyond_the_last_node_and_dark_below():
    brdf = UtiaTable(np.random.default_rng(2).uniform(0, 1, (3, 6, 48, 6, 48))).brdf()
    edge = evaluate(brdf, towards(75, 10), towards(75, 200))
    beyond = evaluate(brdf, towards(89, 10), towards(80, 200))
    np.testing.assert_allclose(beyond, edge, rtol=1e-10)
    assert np.all(np.asarray(evaluate(brdf, towards(91, 10), towards(30, 0))) == 0)
    assert np.all(np.asarray(evaluate(brdf, towards(30, 10), towards(91, 0))) == 0)


def test_a_smooth_brdf_comes_back():
    model = Ward(np.full(3, 0.1), np.full(3, 0.1), 0.5, 0.8)
    nodes = node_directions((6, 48), LARGEST_POLAR).reshape(-1, 3)
    raw = np.array(
        [np.asarray(evaluate(model, np.broadcast_to(d, nodes.shape), nodes)) for d in nodes]
    )
    table = UtiaTable(np.moveaxis(raw, -1, 0).reshape(3, 6, 48, 6, 48)).brdf()
    rng = np.random.default_rng(3)
    pairs = towards(rng.uniform(5, 65, (2, 300)), rng.uniform(0, 360, (2, 300)))
    found, truth = evaluate(table, *pairs), evaluate(model, *pairs)
    # Cells of 15 degrees and a lobe of .5: a few per cent.
    np.testing.assert_allclose(found, truth, rtol=0.12)
    assert np.median(np.abs(np.asarray(found / truth) - 1)) < 0.02


def test_negative_entries_are_counted_and_dark():
    raw = np.full((3, 6, 48, 6, 48), 0.2)
    raw[1, 2, 3] = -0.1
    table = UtiaTable(raw)
    assert table.negative == 288
    seen = evaluate(table.brdf(), towards(30, 22.5), towards(40, 0))
    np.testing.assert_allclose(seen, [0.2, 0, 0.2], atol=1e-12)


def test_reciprocity_is_promised_where_it_holds():
    values = np.random.default_rng(4).uniform(0, 1, (4, 6, 4, 6, 1))
    both = (values + np.moveaxis(values, (0, 1), (2, 3))) / 2
    assert not PolarNodesTable(values, 1.0).reciprocal
    table = PolarNodesTable(both, 1.0)
    assert table.reciprocal
    assert reciprocity_error(table) < 1e-12
    assert reciprocity_error(PolarNodesTable(values, 1.0)) > 0.1
    assert PolarNodesTable(np.full((2, 3, 2, 3, 1), 0.9 / np.pi), 1.0).conserves_energy
    assert not PolarNodesTable(np.full((2, 3, 2, 3, 1), 1.1 / np.pi), 1.0).conserves_energy


def test_float32_and_derivatives():
    table = small_table()
    pairs = towards(np.array([[20.0, 50], [33, 60]]), np.array([[10.0, 200], [99, 301]]))
    single = evaluate(small_table(dtype=np.float32), *jnp.asarray(pairs, jnp.float32))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, evaluate(table, *pairs), rtol=1e-4)
    check_grads(lambda *d: evaluate(table, *d), tuple(pairs), 1, modes=["rev"], rtol=1e-5)
    pole = jnp.array([[0, 0, 1.0]] * 2)
    found = jax.grad(lambda d: evaluate(table, d, d).sum())(pole)
    assert np.isfinite(found).all()


ONES = np.ones((2, 3, 2, 3, 1))
TABLES = {
    "one angle": (ONES[:1], 1.0, "at least 2 polar angles"),
    "degrees": (ONES, 75.0, r"largest_polar=75: it lies in \(0, pi/2\]"),
    "negative": (-ONES, 1.0, r"values\[0, 0, 0, 0, 0\] is -1 \(36 such\)"),
    "nan": (ONES * np.nan, 1.0, "is nan"),
}


@pytest.mark.parametrize("case", TABLES)
def test_bad_tables(case):
    values, largest, expected = TABLES[case]
    with pytest.raises(ValueError, match=expected):
        PolarNodesTable(values, largest)


def test_a_bad_scale():
    with pytest.raises(ValueError, match=r"scale=0\.0: give a positive number"):
        UtiaTable(np.zeros((3, 6, 48, 6, 48))).brdf(0.0)


def test_bad_files(tmp_path):
    path = tmp_path / "m.bin"
    with pytest.raises(InputError, match=r"m\.bin: no such file"):
        read_utia(path)
    for content in (b"", b"\0" * 1000, b"\0" * (SIZE * 8 + 1)):
        path.write_bytes(content)
        with pytest.raises(InputError, match=rf"m\.bin: {len(content)} bytes; .* has 1990656"):
            read_utia(path)
    numbers = np.zeros(SIZE)
    numbers[5] = np.inf
    path.write_bytes(numbers.tobytes())
    with pytest.raises(InputError, match=r"m\.bin: inf at byte 40; wanted a finite number"):
        read_utia(path)
