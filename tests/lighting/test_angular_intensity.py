"""The angular distribution of a lamp.

Pinned down: nodes give their values, in the directions that the convention says (a single bright
node, nadir down); between nodes SciPy's interpolator agrees; the azimuth is periodic, also across
the last node; beyond the vertical range it is dark; the flux of a sphere, of a cosine lamp and of a
random table is the integral by quadrature; float32, derivatives and compiled functions work; bad
tables are refused.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.interpolate import RegularGridInterpolator

from jaxrender.lighting.photometric import AngularIntensity

shine = eqx.filter_jit(AngularIntensity.intensity)


def towards(vertical, horizontal):
    sine = np.sin(vertical)
    parts = [sine * np.cos(horizontal), sine * np.sin(horizontal), -np.cos(vertical)]
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def random_lamp(seed=0, last=np.pi, dtype=np.float64):
    rng = np.random.default_rng(seed)
    horizontal = np.sort(rng.uniform(0, 6.2, 7))
    vertical = np.concatenate([[0.0], np.sort(rng.uniform(0.1, last - 0.1, 6)), [last]])
    values = rng.uniform(0, 5, (7, 8, 2))
    return AngularIntensity(*(a.astype(dtype) for a in (horizontal, vertical, values)))


def by_quadrature(lamp, order=40):
    """Integrate cell by cell: Gauss-Legendre is exact for what is smooth."""
    x, w = np.polynomial.legendre.leggauss(order)
    pieces = []
    for nodes in (lamp.vertical, np.append(lamp.horizontal, lamp.horizontal[0] + 2 * np.pi)):
        ends = np.asarray(nodes)
        middle, half = (ends[1:] + ends[:-1]) / 2, (ends[1:] - ends[:-1]) / 2
        pieces.append(((middle[:, None] + half[:, None] * x).ravel(), np.outer(half, w).ravel()))
    (v, wv), (h, wh) = pieces
    values = shine(lamp, towards(v[:, None], h[None, :]))
    return np.einsum("v,h,vhc->c", wv * np.sin(v), wh, values)


def test_one_bright_node_is_where_the_convention_says():
    values = np.zeros((4, 3, 1))
    values[1, 1] = 7.0
    lamp = AngularIntensity(np.arange(4) * np.pi / 2, np.array([0, 1.0, 2.0]), values)
    # Horizontal 90 degrees is +Y; a vertical angle of 1 is below the horizon.
    bright = np.array([0, np.sin(1.0), -np.cos(1.0)])
    np.testing.assert_allclose(shine(lamp, bright), [7.0], rtol=1e-14)
    np.testing.assert_allclose(shine(lamp, bright * [1, -1, 1]), [0], atol=1e-14)
    np.testing.assert_allclose(shine(lamp, bright * [1, 1, -1]), [0], atol=1e-14)


def test_nadir_is_down():
    lamp = AngularIntensity(np.zeros(1), np.array([0, np.pi]), np.array([[[3.0], [0.0]]]))
    found = shine(lamp, np.array([[0, 0, -1.0], [0, 0, 1.0], [0.0, 1.0, 0.0]]))
    np.testing.assert_allclose(found, [[3], [0], [1.5]], atol=1e-15)


def test_interpolation_agrees_with_scipy():
    lamp = random_lamp()
    rng = np.random.default_rng(1)
    v, h = rng.uniform(0, np.pi, 500), rng.uniform(-6, 6, 500)
    around = np.concatenate([
        lamp.horizontal[-1:] - 2 * np.pi, lamp.horizontal, lamp.horizontal[:1] + 2 * np.pi
    ])  # fmt: skip
    values = np.concatenate([lamp.values[-1:], lamp.values, lamp.values[:1]])
    twin = RegularGridInterpolator((around, lamp.vertical), values)
    expected = twin(np.stack([h % (2 * np.pi), v], axis=-1))
    np.testing.assert_allclose(shine(lamp, towards(v, h)), expected, rtol=1e-10)


def test_dark_beyond_the_vertical_range():
    lamp = AngularIntensity(np.zeros(1), np.array([0.5, np.pi / 2]), np.ones((1, 2, 1)))
    v = np.array([0.0, 0.499, 0.501, np.pi / 2, np.pi / 2 + 1e-3, np.pi])
    found = shine(lamp, towards(v, 0.3))[:, 0]
    np.testing.assert_array_equal(found, [0, 0, 1, 1, 0, 0])


def test_flux_of_known_lamps():
    everywhere = AngularIntensity(np.zeros(1), np.linspace(0, np.pi, 5), np.ones((1, 5, 1)))
    np.testing.assert_allclose(everywhere.flux(), [4 * np.pi], rtol=1e-14)
    v = np.radians(np.arange(0, 91))
    cosine = AngularIntensity(np.zeros(1), v, np.cos(v)[None, :, None])
    np.testing.assert_allclose(cosine.flux(), [np.pi], rtol=1e-4)


@pytest.mark.parametrize("seed", [0, 1])
def test_flux_is_the_integral(seed):
    lamp = random_lamp(seed, last=2.0)
    np.testing.assert_allclose(lamp.flux(), by_quadrature(lamp), rtol=1e-12)


def test_float32_and_compiled():
    lamp, double = random_lamp(dtype=np.float32), random_lamp()
    directions = towards(*np.random.default_rng(2).uniform(0, 3, (2, 50)))
    found = shine(lamp, jnp.asarray(directions, jnp.float32))
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, shine(double, directions), atol=1e-4)
    np.testing.assert_allclose(lamp.flux(), double.flux(), rtol=1e-5)
    assert lamp.flux().dtype == jnp.float32


def test_derivatives():
    lamp = random_lamp()
    directions = towards(np.array([0.7, 1.9]), np.array([0.3, 4.0]))
    check_grads(lambda d: shine(lamp, d), (directions,), 1, rtol=1e-5)
    on_axis = jax.grad(lambda d: shine(lamp, d).sum())(jnp.array([0, 0, -1.0]))
    assert np.isfinite(on_axis).all()


H, V, ONE = np.zeros(1), np.array([0, 1.0]), np.ones((1, 2, 1))
BAD = {
    "one angle": (H, V[:1], ONE[:, :1], "1 x 1 angles: give at least 1 x 2"),
    "descending": (H, V[::-1], ONE, "vertical angles .* must ascend"),
    "degrees": (H, np.array([0, 90.0]), ONE, r"0 to 90: they lie in \[0, pi\] radians"),
    "a full turn": (np.array([0, 2 * np.pi]), V, np.ones((2, 2, 1)), r"in \[0, 2 pi\) radians"),
    "negative": (H, V, -ONE, r"values\[0, 0, 0\] is -1 \(2 such\)"),
    "nan": (H, V, ONE * np.nan, "is nan"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_tables(case):
    *arrays, expected = BAD[case]
    with pytest.raises(ValueError, match=expected):
        AngularIntensity(*arrays)
