"""Directions with their components apart.

Pinned down: they are the array's own components, turned into a frame like ``to_local`` does, with
NumPy's inner product, also between one direction and many.
"""

import numpy as np

from jaxrender.geometry import Components, to_local, world_from_local

ROUNDING = 1e-15
RNG = np.random.default_rng(0)
DIRECTIONS = RNG.normal(size=(7, 3))
NORMAL = np.array([0.48, -0.6, 0.64])


def stacked(components):
    return np.stack([np.asarray(c) for c in components], axis=-1)


def test_components_of_an_array():
    np.testing.assert_array_equal(stacked(Components.of(DIRECTIONS)), DIRECTIONS)
    batch = DIRECTIONS[:6].reshape(2, 3, 3)
    np.testing.assert_array_equal(stacked(Components.of(batch)), batch)


def test_in_frame_is_to_local():
    frame = world_from_local(NORMAL)
    expected = [to_local(frame, direction) for direction in DIRECTIONS]
    found = stacked(Components.of(DIRECTIONS).in_frame(frame))
    np.testing.assert_allclose(found, expected, rtol=0, atol=10 * ROUNDING)


def test_the_normal_is_the_third_axis_of_its_frame():
    found = stacked(Components.of(NORMAL).in_frame(world_from_local(NORMAL)))
    np.testing.assert_allclose(found, [0, 0, 1], atol=ROUNDING)


def test_inner_product():
    one = Components.of(NORMAL)
    many = Components.of(DIRECTIONS)
    expected = DIRECTIONS @ NORMAL
    np.testing.assert_allclose(many.dot(one), expected, atol=10 * ROUNDING)
    np.testing.assert_allclose(one.dot(many), expected, atol=10 * ROUNDING)
