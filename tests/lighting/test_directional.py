"""Directional sources: point masses at unit directions, checked when made, also inside jit.

Pinned down: normalisation, pass-through of irradiance, none, dtype, gradients, and each refusal.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.lighting.directional import DirectionalSources

ROUNDING = 1e-15


def test_sources_are_nodes_with_unit_directions():
    sources = DirectionalSources(np.array([[0, 3.0, 4], [-2, 0, 0]]), np.array([[1.0, 2], [3, 4]]))
    nodes = sources.nodes()
    np.testing.assert_allclose(nodes.directions, [[0, 0.6, 0.8], [-1, 0, 0]], atol=ROUNDING)
    np.testing.assert_array_equal(nodes.irradiance, [[1, 2], [3, 4]])


@pytest.mark.parametrize("channels", [1, 3])
def test_none_has_no_node(channels):
    nodes = DirectionalSources.none(channels).nodes()
    assert nodes.directions.shape == (0, 3)
    assert nodes.irradiance.shape == (0, channels)


def test_dtype_follows_the_input():
    single = DirectionalSources(np.ones((1, 3), np.float32), np.ones((1, 3), np.float32))
    assert single.directions.dtype == single.irradiance.dtype == jnp.float32
    mixed = DirectionalSources(np.ones((1, 3)), np.ones((1, 3), np.float32))
    assert mixed.directions.dtype == mixed.irradiance.dtype == jnp.float64


def test_made_inside_a_differentiated_function():
    """d/dz of z / |v| at v = (3, 0, 4) is (1 - 0.64) / 5."""

    @jax.jit
    @jax.grad
    def slope(z):
        direction = jnp.stack([jnp.array(3.0), jnp.array(0.0), z])[None, :]
        return DirectionalSources(direction, jnp.ones((1, 3))).nodes().directions[0, 2]

    assert slope(4.0) == pytest.approx(0.36 / 5, rel=1e-14)


@pytest.mark.parametrize(
    ("directions", "irradiance", "message"),
    [
        ([[0, 0, 1], [0, 0, 0]], [[1], [1]], r"source 1 has the direction .*finite and not zero"),
        ([[0, np.nan, 1]], [[1]], r"source 0 has the direction .*nan"),
        ([[0, 0, np.inf]], [[1]], r"source 0 has the direction .*inf"),
        ([[0, 0, 1]], [[np.nan]], r"source 0 has the irradiance \[nan\]: it must be finite"),
        ([[0, 0, 1]], [[1], [2]], r"1 directions but 2 irradiances: give one each"),
    ],
)
def test_misuse_is_refused(directions, irradiance, message):
    with pytest.raises(ValueError, match=message):
        DirectionalSources(np.array(directions, float), np.array(irradiance, float))
