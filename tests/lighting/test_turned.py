"""Turned environments: what came from direction d comes from R d.

Pinned down: nothing turned is the same; a quarter about z is a shift of columns; smooth light is
the same function in turned directions; the energy stays, of a lone bright texel too; uniform light
stays uniform; and the kind of the image.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxrender.harmonics import LatLongGrid
from jaxrender.lighting import Environment
from jaxrender.lighting.panoramas import turned_latlong

ROWS = 24
GRID = LatLongGrid(ROWS, 2 * ROWS)
ANY = Rotation.from_rotvec([0.7, -0.4, 1.1]).as_matrix()
QUARTER = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def light(directions):
    """One smooth lobe for each channel, none about an axis."""
    axes = np.array([[0.8, 0.3, 0.5], [-0.5, 0.6, -0.6]])
    return np.exp(2 * (directions @ axes.T)) + 0.1


IMAGE = light(GRID.directions())


def test_an_environment_that_is_not_turned_is_the_same():
    np.testing.assert_array_equal(Environment(IMAGE).turned(np.eye(3)).radiance, IMAGE)


def test_a_quarter_about_z_shifts_columns():
    """The columns are those of azimuths, increasing: by a quarter of them."""
    shifted = np.roll(IMAGE, 2 * ROWS // 4, axis=1)
    found = np.asarray(Environment(IMAGE).turned(QUARTER).radiance)
    # Resampling blurs a little, most of all at the poles.
    np.testing.assert_allclose(found, shifted, rtol=0.05)
    # Beyond that it is exact: whatever was turned before is shifted.
    once, twice = turned_latlong(IMAGE, ANY), turned_latlong(IMAGE, QUARTER @ ANY)
    np.testing.assert_allclose(twice, np.roll(once, 2 * ROWS // 4, axis=1), rtol=1e-9)


def test_smooth_light_is_the_same_function_in_turned_directions():
    found = np.asarray(Environment(IMAGE).turned(ANY).radiance)
    np.testing.assert_allclose(found, light(GRID.directions() @ ANY), rtol=0.05)
    # Turned back it is what it was.
    back = np.asarray(Environment(found).turned(ANY.T).radiance)
    np.testing.assert_allclose(back, IMAGE, rtol=0.1)


@pytest.mark.parametrize("rotation", [QUARTER, ANY, np.diag([1.0, -1, -1])])
def test_the_energy_stays(rotation):
    before, after = (
        np.asarray(one.nodes().irradiance).sum(axis=0)
        for one in (Environment(IMAGE), Environment(IMAGE).turned(rotation))
    )
    np.testing.assert_allclose(after, before, rtol=2e-3)
    uniform = Environment(np.full((ROWS, 2 * ROWS, 1), 2.5)).turned(rotation)
    np.testing.assert_allclose(uniform.radiance, 2.5, rtol=1e-12)


def test_a_bright_texel_lands_where_its_direction_does():
    image = np.zeros((ROWS, 2 * ROWS, 1))
    image[7, 5] = 3.0
    turned = Environment(image).turned(ANY).nodes()
    energy = np.asarray(turned.irradiance)[:, 0]
    mean = energy @ np.asarray(turned.directions)
    mean /= np.linalg.norm(mean)
    assert np.arccos(mean @ ANY @ GRID.directions()[7, 5]) < np.pi / ROWS / 3
    before = np.asarray(Environment(image).nodes().irradiance).sum()
    assert energy.sum() == pytest.approx(before, rel=0.05)


def test_images_in_jax_are_turned_too():
    held = Environment(jnp.asarray(IMAGE)).turned(ANY)
    np.testing.assert_array_equal(held.radiance, turned_latlong(IMAGE, ANY))
