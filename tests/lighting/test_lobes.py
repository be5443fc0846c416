"""Smooth lobes of light as functions, and as environment images.

- The radiance is its definition, in NumPy; directions of any length; 1/e at the stated width.
- The energy of a lobe is 2 pi (1 - cos w) (1 - exp(-2 / (1 - cos w))) times its middle: in closed
  form, by a quadrature, and in the environment image.
- The environment image holds the function at its nodes.
- Widths that are no angles are refused.
"""

import numpy as np
import pytest

from jaxrender.harmonics import LatLongGrid
from jaxrender.lighting import SmoothLobes

DIRECTIONS = np.array([[0.9, 0.5, 0.4], [0.0, 0.0, 3.0]])
WIDTHS = np.radians([30.0, 60.0])
MIDDLE = np.array([[1.0, 0.9, 0.8], [0.1, 0.2, 0.3]])
# A few roundings of numbers near 1.
ROUNDING = 1e-13


@pytest.fixture
def lobes():
    return SmoothLobes(DIRECTIONS, WIDTHS, MIDDLE)


def unit_vectors(count):
    vectors = np.random.default_rng(0).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_radiance_is_its_definition(lobes):
    towards = unit_vectors(50)
    expected = np.zeros((50, 3))
    for direction, width, middle in zip(DIRECTIONS, WIDTHS, MIDDLE):
        cosine = towards @ (direction / np.linalg.norm(direction))
        expected += np.exp(-(1 - cosine) / (1 - np.cos(width)))[:, None] * middle
    np.testing.assert_allclose(lobes.radiance(towards), expected, rtol=ROUNDING)


def test_the_width_is_where_it_has_fallen_to_1_over_e():
    width = np.radians(25.0)
    lobe = SmoothLobes(np.array([[0.0, 0.0, 1.0]]), np.array([width]), np.ones((1, 3)))
    found = lobe.radiance(np.array([[0.0, 0.0, 1.0], [np.sin(width), 0.0, np.cos(width)]]))
    np.testing.assert_allclose(found[:, 0], [1, np.exp(-1)], rtol=ROUNDING)


def energy(width):
    """2 pi int exp((t - 1) / (1 - cos w)) dt over t from -1 to 1."""
    spread = 1 - np.cos(width)
    return 2 * np.pi * spread * (1 - np.exp(-2 / spread))


def test_the_image_holds_the_function_and_its_energy(lobes):
    environment = lobes.to_environment(32)
    grid = LatLongGrid(32, 64)
    np.testing.assert_allclose(
        np.asarray(environment.radiance).reshape(-1, 3),
        lobes.radiance(grid.directions().reshape(-1, 3)),
        rtol=ROUNDING,
    )
    expected = energy(WIDTHS) @ MIDDLE
    # The rule is spectrally accurate: lobes of 30 degrees have nothing left at degree 31.
    found = np.asarray(environment.nodes().irradiance).sum(axis=0)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("width", [0.0, -0.1, 3.2, np.nan])
def test_widths_that_are_no_angles(width):
    with pytest.raises(ValueError, match=r"give angles above 0 and up to pi radians"):
        SmoothLobes(DIRECTIONS[:1], np.array([width]), MIDDLE[:1])
