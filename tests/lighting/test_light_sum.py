"""What every light is, and that a sum of lights is a light.

- Every kind of light is point masses from unit directions, in line with its coefficients, and twice
  itself is twice as bright.
- Its nodes are those of its parts, its coefficients their sum; sums of sums are flat.
- What is no light, and lights of different colours, are refused.
- Lobes as point masses have their integral.
"""

import inspect

import numpy as np
import pytest

from jaxrender.harmonics import real_basis
from jaxrender.lighting import (
    ClearSky,
    DirectionalSources,
    Environment,
    HarmonicLight,
    Light,
    LightSum,
    OvercastSky,
    PointSources,
    SmoothLobes,
)
from jaxrender.spectra import light_coefficients

SKY = OvercastSky(np.array([0.5, 0.6, 0.7]))
SOURCE = DirectionalSources(np.array([[0.0, 0.6, 0.8]]), np.array([[1.0, 0.9, 0.8]]))
PROBE = Environment(np.random.default_rng(0).uniform(size=(16, 32, 3)))
LOBES = SmoothLobes(np.array([[1.0, 1.0, 1.0]]), np.array([0.3]), np.array([[2.0, 1.0, 0.5]]))
LIGHTS = {
    "overcast sky": SKY,
    "clear sky": ClearSky(np.array([0.6, 0.0, 0.8]), np.array([0.5, 0.6, 0.7])),
    "sources": SOURCE,
    "environment": PROBE,
    "lobes": LOBES,
    "harmonics": HarmonicLight(np.random.default_rng(1).normal(size=(9, 3))),
    "sum": PROBE + SOURCE,
}
# The sky about the sun is steep.
NODES_MISS = 2e-3


def kinds(of: type) -> set[type]:
    """List the classes below one of which there are instances."""
    below = of.__subclasses__()
    made = {kind for kind in below if not inspect.isabstract(kind)}
    return made.union(*(kinds(kind) for kind in below))


def test_every_light_is_tried():
    ours = {kind for kind in kinds(Light) if kind.__module__.startswith("jaxrender.")}
    # Point sources have no point masses but as a place sees them: test_point_sources.py.
    assert ours == {PointSources} | {type(light) for light in LIGHTS.values()}


@pytest.mark.parametrize("name", LIGHTS)
def test_every_light_is_its_point_masses(name):
    light = LIGHTS[name]
    directions, irradiance = (np.asarray(part) for part in light.nodes())
    assert directions.shape == (len(irradiance), 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=1e-12)
    summed = np.einsum("nk,nc->kc", real_basis(directions, 2), irradiance)
    expected = np.asarray(light_coefficients(light, 2))
    np.testing.assert_allclose(summed, expected, atol=NODES_MISS * np.abs(expected).max())


@pytest.mark.parametrize("name", LIGHTS)
def test_twice_a_light_is_twice_as_bright(name):
    once = np.asarray(light_coefficients(LIGHTS[name], 4))
    twice = np.asarray(light_coefficients(LIGHTS[name] + LIGHTS[name], 4))
    np.testing.assert_allclose(twice, 2 * once, rtol=1e-12, atol=1e-12)


def test_nodes_and_coefficients_add_up():
    light = PROBE + SOURCE + SKY
    assert isinstance(light, LightSum)
    assert light.parts == (PROBE, SOURCE, SKY)
    counts = [len(part.nodes().directions) for part in light.parts]
    nodes = light.nodes()
    assert len(nodes.directions) == sum(counts)
    np.testing.assert_array_equal(nodes.irradiance[counts[0]], SOURCE.irradiance[0])
    expected = sum(np.asarray(light_coefficients(part, 6)) for part in light.parts)
    np.testing.assert_allclose(light_coefficients(light, 6), expected, atol=1e-12)


def test_sums_of_sums_are_flat():
    one = (PROBE + SOURCE) + (SKY + SOURCE)
    assert one.parts == (PROBE, SOURCE, SKY, SOURCE)
    assert (PROBE + one).parts == (PROBE, *one.parts)


def test_a_lobe_is_the_point_masses_that_it_integrates_to():
    """int exp(-(1 - c) / k) = 2 pi k (1 - exp(-2 / k)), k = 1 - cos width."""
    k = 1 - np.cos(0.3)
    expected = 2 * np.pi * k * (1 - np.exp(-2 / k)) * np.asarray(LOBES.middle[0])
    np.testing.assert_allclose(LOBES.nodes().irradiance.sum(axis=0), expected, rtol=1e-6)
    assert (LOBES + SOURCE).parts == (LOBES, SOURCE)


def test_what_cannot_be_added():
    with pytest.raises(TypeError):
        PROBE + 1.0
    with pytest.raises(ValueError, match="without lights"):
        LightSum(())
    grey = HarmonicLight(np.ones((4, 1)))
    with pytest.raises(ValueError, match="lights of 1 and 3 channels"):
        (grey + SOURCE).nodes()
