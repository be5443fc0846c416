"""Known light made ready for a fit.

- Zero light is refused; light of one photograph joins what is shared with its own.
- The sources of all photographs are stacked by frame, padded with dark ones.
- The exact integral's point masses carry all of the light's energy, condensed or not, and each
  source; dark texels are left out.
- The dual light is the whole light again: split off, in parts, by energy, or automatic.
- The automatic split meets its goal, or says by how much it missed; uniform light needs no source.
- Wrong names of splits are refused.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import SOURCES, ball_samples, known_light, material

from jaxrender.harmonics import LatLongGrid
from jaxrender.inverse import KnownLight, Observations
from jaxrender.inverse.light_nodes import exact_nodes, frame_nodes
from jaxrender.inverse.prepared_light import band_limit_for, prepare_light
from jaxrender.lighting import DirectionalSources, Environment
from jaxrender.spectra import light_coefficients

# Sums of some thousand float64.
SUMS = 1e-10


def speckled(rows=32, seed=0):
    """Smooth light with a few bright texels."""
    directions = LatLongGrid(rows, 2 * rows).directions()
    rng = np.random.default_rng(seed)
    light = 1 + directions[..., 2:] * np.ones(3)
    for row, column in rng.integers(8, rows - 8, (6, 2)):
        light[row, column] += 60 * rng.uniform(0.5, 1, 3)
    return Environment(light)


def dark_but_one(rows=16):
    image = np.zeros((rows, 2 * rows, 3))
    image[5, 7] = 2.0
    return Environment(image)


def observations():
    samples, frame = ball_samples()
    return Observations(samples, np.ones((len(frame), 3)), frame)


def test_zero_light_is_refused():
    with pytest.raises(ValueError, match="the light is zero"):
        KnownLight(None, DirectionalSources.none())
    with pytest.raises(ValueError, match="the light is zero"):
        KnownLight(Environment(np.zeros((4, 8, 3))), DirectionalSources.none())


def moving_light():
    one, two = (
        DirectionalSources(np.eye(3)[:count], np.full((count, 3), float(count))) for count in (1, 2)
    )
    return KnownLight(None, SOURCES, (one, two))


def test_light_of_one_photograph_joins_shared_and_own():
    light = moving_light()
    for frame, count in ((0, 3), (1, 4)):
        one = light.of_frame(frame)
        assert one.per_frame is None
        assert one.directional.directions.shape == (count, 3)
        np.testing.assert_allclose(one.directional.irradiance[:2], SOURCES.irradiance)
        np.testing.assert_array_equal(one.directional.irradiance[2:], frame + 1)


def test_sources_of_frames_are_stacked_with_dark_ones():
    frame = np.array([1, 0, 1])
    nodes = frame_nodes(moving_light(), frame)
    assert nodes is not None
    assert nodes.directions.shape == (2, 2, 3)
    np.testing.assert_array_equal(nodes.irradiance[:, :, 0], [[1, 0], [2, 2]])
    np.testing.assert_array_equal(nodes.directions[1], np.eye(3)[:2])
    np.testing.assert_array_equal(nodes.frame_of_sample, frame)
    assert frame_nodes(known_light(8), frame) is None


@pytest.mark.parametrize("angle_per_sigma", [None, 0.5])
def test_point_masses_carry_all_of_the_light(angle_per_sigma):
    environment = speckled()
    light = KnownLight(environment, SOURCES)
    (nodes,) = exact_nodes(light, np.zeros(3, int), 0.2, angle_per_sigma)
    expected = np.sum(environment.nodes().irradiance, axis=0) + np.sum(SOURCES.irradiance, axis=0)
    np.testing.assert_allclose(np.sum(nodes.irradiance, axis=0), expected, rtol=SUMS)
    np.testing.assert_allclose(nodes.directions[:2], SOURCES.directions, rtol=SUMS)
    fewer = len(nodes.directions) < environment.grid.height * environment.grid.width
    assert fewer == (angle_per_sigma is not None)


def test_dark_texels_are_left_out_and_frames_are_a_part_of_their_own():
    (nodes,) = exact_nodes(
        KnownLight(dark_but_one(), DirectionalSources.none()), np.zeros(1, int), 0.2
    )
    assert nodes.directions.shape == (1, 3)
    parts = exact_nodes(moving_light(), np.array([0, 1]), 0.2)
    assert [part.irradiance.ndim for part in parts] == [2, 3]


@pytest.mark.parametrize("split", ["off", "rough", "auto", 0.7])
def test_slow_part_and_sources_are_the_whole_light(split):
    environment = speckled()
    light = KnownLight(environment, DirectionalSources.none())
    prepared = prepare_light(light, observations(), material().as_metal(), split, 15)
    whole = light_coefficients(environment, 15)
    together = prepared.dual.slow + light_coefficients(prepared.dual.sources, 15)
    np.testing.assert_allclose(together, whole, atol=SUMS * np.abs(whole).max())
    taken = prepared.dual.sources.directions.shape[0]
    assert (taken == 0) == (split == "off")
    if split == 0.7:
        # The last source taken overshoots by less than itself.
        assert prepared.split is not None
        assert 0.5 < prepared.split.slow_energy <= 0.7


def test_the_automatic_split_meets_its_goal():
    # At grazing exit the lobe is not round, and no split makes up for it: steep samples alone.
    steep, frame = ball_samples(lowest_cosine=0.6)
    seen = Observations(steep, np.ones((len(frame), 3)), frame)
    needed = prepare_light(known_light(), seen, material().as_metal(), "auto", None).needed
    assert needed is not None
    assert needed.error < 0.015 < needed.error_without
    assert 0 < needed.count < 1024


def test_uniform_light_needs_no_source():
    light = KnownLight(Environment(np.ones((32, 64, 3))), DirectionalSources.none())
    prepared = prepare_light(light, observations(), material().as_metal(), "auto", 15)
    assert prepared.needed is not None
    assert prepared.needed.count == 0
    assert prepared.dual.sources.directions.shape == (0, 3)


def test_light_without_an_environment_is_its_sources():
    light = KnownLight(None, SOURCES)
    prepared = prepare_light(light, observations(), material(), "auto", None)
    assert prepared.split is None
    assert prepared.dual.band_limit == 0
    np.testing.assert_array_equal(prepared.dual.slow, jnp.zeros((1, 3)))
    np.testing.assert_allclose(prepared.dual.sources.irradiance, SOURCES.irradiance)


@pytest.mark.parametrize(
    ("sigma", "rows", "limit"), [(0.16, 64, 31), (0.16, 256, 32), (0.02, 512, 128)]
)
def test_the_band_limit_is_the_lobes_the_grids_or_the_highest(sigma, rows, limit):
    environment = Environment(np.ones((rows, 2 * rows, 1)))
    assert band_limit_for(environment, sigma) == limit


def test_a_wrong_split_lists_the_right_ones():
    light = KnownLight(speckled(), DirectionalSources.none())
    with pytest.raises(ValueError, match="choose auto, off"):
        prepare_light(light, observations(), material(), "sharp", 15)
