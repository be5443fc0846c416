"""Slow and fast light apart.

Pinned down: slow + sources is the light, in every cell and channel; discs come out with their
energy and direction, a wide bright disc as several sources; smooth light stays slow; the same light
at two resolutions splits alike, down to what the dual model makes of it; a wanted energy is reached
to within one source; black light, both precisions and the refusals.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import LatLongGrid, synthesise
from jaxrender.lighting import (
    DirectionalSources,
    Environment,
    candidates,
    split_to_energy,
    take,
)
from jaxrender.reflection import dual_columns, dual_light

ROUNDING = 1e-12
SIGMA = 0.12
DISCS = (((0.3, 0.2, 0.9), 0.07, 2.0), ((-0.8, 0.1, 0.4), 0.09, 3.0), ((0.1, -0.9, -0.3), 0.3, 2.0))
COLOUR = np.array([1.0, 0.8, 0.6])


def box_averaged(light_of, rows, finest=512):
    """An image of the same light at any resolution: the mean over each texel's solid angle."""
    grid = LatLongGrid(finest, 2 * finest)
    light = light_of(grid.directions())
    sines = np.broadcast_to(np.sin(grid.polar_angles())[:, None], light.shape)
    over = finest // rows

    def texels(values):
        return values.reshape(rows, over, 2 * rows, over).sum((1, 3))

    return Environment((texels(sines * light) / texels(sines))[..., None] * COLOUR)


def discs(directions):
    """Gaussian lobes, each of a given irradiance, over a slow ambient of radiance near 1."""
    light = 1 + 0.5 * directions[..., 2]
    for direction, radius, irradiance in DISCS:
        towards = np.array(direction) / np.linalg.norm(direction)
        lobe = np.exp((directions @ towards - 1) / radius**2) / (2 * np.pi * radius**2)
        light = light + irradiance * lobe
    return light


def disc(radius, radiance, ambient, towards=(0.6, 0, 0.8)):
    def light_of(directions):
        return ambient + radiance * (directions @ np.array(towards) > np.cos(radius))

    return light_of


def total(light):
    return np.asarray(light.nodes().irradiance).sum(axis=0)


def energies(found):
    return np.asarray(found.sources.irradiance).sum(axis=1)


ROOM = box_averaged(discs, 64)


@pytest.mark.parametrize("count", [0, 1, 40, 10**6])
@pytest.mark.parametrize("rows", [64, 100])
def test_slow_and_sources_are_the_light(count, rows):
    values = np.random.default_rng(0).lognormal(0, 1.5, (rows, 2 * rows, 3))
    environment = Environment(values)
    found = candidates(environment, SIGMA)
    split = take(environment, found, count, SIGMA)
    np.testing.assert_allclose(total(split.slow) + total(split.sources), total(environment))
    # Every texel keeps its colour, and what it lost went to the source of its own cell.
    lost = np.asarray(environment.radiance - split.slow.radiance)
    assert lost.min() >= 0
    shares = lost / values
    np.testing.assert_allclose(shares, shares[..., :1] * np.ones(3), atol=ROUNDING)
    taken = found.cell[:count]
    inside = np.isin(found.cells.index, taken)
    assert np.all(lost[~inside] == 0)
    for cell, irradiance in list(zip(taken, split.sources.irradiance))[:40]:
        own = found.cells.index == cell
        own_energy = (lost * environment.grid.weights()[..., None])[own].sum(axis=0)
        np.testing.assert_allclose(own_energy, irradiance, rtol=1e-10)


def test_slow_energy_is_the_fraction_left():
    split = take(ROOM, candidates(ROOM, SIGMA), 30, SIGMA)
    expected = total(split.slow).sum() / total(ROOM).sum()
    assert split.slow_energy == pytest.approx(expected, rel=ROUNDING)
    assert 0.3 < split.slow_energy < 0.95


def test_candidates_fall_in_strength():
    found = candidates(ROOM, SIGMA)
    assert np.all(np.diff(energies(found)) <= 0)
    assert len(found.cell) == len(set(found.cell.tolist())) == len(energies(found))


@pytest.mark.parametrize("ambient", [0.0, 1.0])
def test_a_disc_comes_out_with_its_energy_and_direction(ambient):
    radius = 0.05
    radiance = 3 / (2 * np.pi * (1 - np.cos(radius)))
    found = candidates(box_averaged(disc(radius, radiance, ambient), 128), SIGMA)
    irradiance, directions = np.asarray(found.sources.irradiance), found.sources.directions
    # Sampling by texels loses up to 1 % of so small a disc, the envelope below it 1 % more.
    np.testing.assert_allclose(irradiance.sum(axis=0), 3 * COLOUR, rtol=0.02)
    mean = irradiance[:, 0] @ np.asarray(directions)
    angle = np.arccos(min(1.0, mean @ [0.6, 0, 0.8] / np.linalg.norm(mean)))
    assert angle < 0.005
    assert len(irradiance) < 20


def test_a_wide_bright_disc_becomes_several_sources():
    """Radius .4: the area of a hundred cells or more, each with its share of the energy."""
    radius, radiance = 0.4, 10.0
    environment = box_averaged(disc(radius, radiance, 0.2), 64)
    found = candidates(environment, SIGMA)
    strong = energies(found) > 0.2 * energies(found)[0]
    assert strong.sum() > np.pi * radius**2 / (0.5 * SIGMA) ** 2
    assert energies(found)[0] < 0.02 * energies(found).sum()
    away = np.arccos(np.clip(np.asarray(found.sources.directions) @ [0.6, 0, 0.8], -1, 1))
    assert away[strong].max() < radius + 0.5 * SIGMA
    energy = radiance * 2 * np.pi * (1 - np.cos(radius)) * COLOUR.sum()
    assert energies(found)[strong].sum() == pytest.approx(energy, rel=0.05)


@pytest.mark.parametrize("rows", [32, 50, 128])
def test_uniform_light_is_slow(rows):
    found = candidates(Environment(np.full((rows, 2 * rows, 3), 2.0)), SIGMA)
    assert len(found.cell) == 0


@pytest.mark.parametrize(("sigma", "energy"), [(0.05, 1e-3), (0.12, 0.07)])
def test_smooth_light_has_no_strong_sources(sigma, energy):
    """Light of degree 3.  At sigma = .12 slow means degree 2.5: some stands out, spread thinly."""
    coefficients = 0.3 * np.random.default_rng(0).normal(size=(16, 3))
    coefficients[0] = 4
    environment = Environment(synthesise(LatLongGrid(64, 128), coefficients))
    found = candidates(environment, sigma)
    assert energies(found).sum() < energy * total(environment).sum()
    assert energies(found).max(initial=0) < 1e-3 * total(environment).sum()


def test_linear_light_is_slow():
    """1 + z / 5 at sigma = .1: the low pass at degree 3 keeps .85 of z, within the tolerance."""
    z = LatLongGrid(64, 128).directions()[..., 2:]
    found = candidates(Environment(1 + 0.2 * z), 0.1)
    assert len(found.cell) == 0


def columns(split, band_limit=26):
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(60, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cosine = rng.uniform(0.15, 1, (60, 1))
    across = np.cross(normals, rng.normal(size=(60, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    samples = SurfaceSamples(normals, normals * cosine + across * np.sqrt(1 - cosine**2))
    brdf = Microfacet(np.ones(3), np.ones(3), SIGMA, 1.5)
    light = dual_light(split, DirectionalSources.none(), band_limit)
    return np.asarray(eqx.filter_jit(dual_columns)(brdf, samples, light))


def test_the_answer_does_not_depend_on_the_resolution():
    """The same light on 64 x 128 and 256 x 512 texels."""
    coarse, fine = ROOM, box_averaged(discs, 256)
    of_coarse, of_fine = candidates(coarse, SIGMA), candidates(fine, SIGMA)
    assert of_coarse.cells.rows == of_fine.cells.rows == 64
    assert len(of_coarse.cell) == pytest.approx(len(of_fine.cell), rel=0.02)
    shares = [
        energies(found).sum() / total(light).sum()
        for found, light in ((of_coarse, coarse), (of_fine, fine))
    ]
    assert shares[0] == pytest.approx(shares[1], rel=0.01)
    strongest = [np.asarray(found.sources.directions)[0] for found in (of_coarse, of_fine)]
    assert np.arccos(min(1.0, strongest[0] @ strongest[1])) < 0.25 * SIGMA
    count = 100
    expected = columns(take(fine, of_fine, count, SIGMA))
    error = np.abs(columns(take(coarse, of_coarse, count, SIGMA)) - expected)
    for lobe in (0, 1):
        assert error[:, lobe].max() < 0.01 * expected[:, lobe].max()


@pytest.mark.parametrize("wanted", [0.3, 0.7, 0.9])
def test_a_wanted_energy_is_reached_within_one_source(wanted):
    split = split_to_energy(ROOM, SIGMA, wanted)
    weakest = np.asarray(split.sources.irradiance).sum(axis=1).min() / total(ROOM).sum()
    assert wanted - weakest - 1e-9 <= split.slow_energy <= wanted + 1e-8


def test_all_or_nothing():
    everything, nothing = split_to_energy(ROOM, SIGMA, 0.0), split_to_energy(ROOM, SIGMA, 1.0)
    assert everything.slow_energy < 1e-8
    np.testing.assert_allclose(total(everything.sources), total(ROOM), rtol=1e-8)
    assert nothing.sources.directions.shape == (0, 3)
    np.testing.assert_array_equal(nothing.slow.radiance, ROOM.radiance)


def test_a_lower_envelope_takes_more():
    taken = [energies(candidates(ROOM, SIGMA, scale)).sum() for scale in (1.0, 0.5, 0.0)]
    assert taken[0] < taken[1] < taken[2]
    assert taken[2] == pytest.approx(total(ROOM).sum(), rel=ROUNDING)


@pytest.mark.parametrize("wanted", [0.0, 0.4, 1.0])
def test_black_light(wanted):
    split = split_to_energy(Environment(np.zeros((16, 32, 3))), SIGMA, wanted)
    assert split.sources.directions.shape == (0, 3)
    assert split.slow_energy == 1


def test_single_precision_stays_single():
    room = Environment(np.asarray(ROOM.radiance, np.float32))
    split = split_to_energy(room, SIGMA, 0.8)
    assert split.slow.radiance.dtype == split.sources.irradiance.dtype == jnp.float32
    double = split_to_energy(ROOM, SIGMA, 0.8)
    assert split.slow_energy == pytest.approx(double.slow_energy, rel=1e-3)


@pytest.mark.parametrize("wanted", [-0.1, 1.1, float("nan")])
def test_a_fraction_outside_is_refused(wanted):
    with pytest.raises(ValueError, match=r"slow_energy=.*a fraction from 0 to 1 is meant"):
        split_to_energy(ROOM, SIGMA, wanted)
