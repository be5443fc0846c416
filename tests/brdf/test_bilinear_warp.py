"""Densities on the unit square and the map that makes them uniform.

Pinned down: the map is the integral of the density by quadrature; and between tables, held beyond
them, Mitsuba's own.
"""

from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import dblquad

from jaxrender.brdf.tables.bilinear_warp import BilinearWarp, Place, blended


def test_the_warp_is_the_integral_of_the_density():
    values = np.random.default_rng(0).uniform(0, 2, (1, 3, 4))
    warp = BilinearWarp.of(values)
    blends = blended((jnp.array([0.0]),), (np.zeros(1),))

    def density(x, y):
        columns = [np.interp(x, np.linspace(0, 1, 4), row) for row in values[0]]
        return np.interp(y, np.linspace(0, 1, 3), columns)

    def integral(x, y):
        """Cell by cell, so that no kink is inside."""
        xs = [*np.arange(0, x, 1 / 3), x]
        ys = [*np.arange(0, y, 1 / 2), y]
        cells = [(a, b, c, d) for a, b in pairwise(xs) for c, d in pairwise(ys)]
        return sum(dblquad(lambda v, u: density(u, v), *cell)[0] for cell in cells)

    found = warp.flatten(Place(jnp.array([0.45]), jnp.array([0.8])), blends)
    assert float(found.y[0]) == pytest.approx(integral(1, 0.8) / integral(1, 1), rel=1e-9)
    strip = [integral(x, 0.8 + 1e-5) - integral(x, 0.8 - 1e-5) for x in (0.45, 1)]
    assert float(found.x[0]) == pytest.approx(strip[0] / strip[1], rel=1e-5)


def test_the_warp_is_mitsubas():
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    rng = np.random.default_rng(1)
    values = rng.uniform(0, 2, (3, 2, 4, 5)).astype(np.float32)
    nodes = np.array([0, 0.5, 2], np.float32), np.array([1, 2], np.float32)
    twin = mitsuba.MarginalContinuous2D2(values, [list(map(float, n)) for n in nodes])
    warp = BilinearWarp.of(values.reshape(6, 4, 5).astype(float))
    places, parameters = rng.uniform(0, 1, (50, 2)), rng.uniform(-0.2, 2.2, (50, 2))
    blends = blended((jnp.array(parameters[:, 0]), jnp.array(parameters[:, 1])), nodes)
    found = np.stack(warp.flatten(Place(*jnp.array(places.T)), blends), axis=-1)
    held = [np.clip(parameters[:, k], nodes[k][0], nodes[k][-1]) for k in range(2)]
    expected = [
        np.array(twin.invert(list(map(float, place)), list(map(float, p)))[0])
        for place, p in zip(places, np.stack(held, axis=-1))
    ]
    np.testing.assert_allclose(found, expected, atol=2e-6)
