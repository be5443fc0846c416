"""The virtual gonioreflectometer against surfaces whose BRDF is known otherwise.

- A flat patch has the BRDF of its facets, at every pair of directions, without noise.
- A V-groove of Lambertian sides, two colours, has the BRDF that marching through its profile finds,
  shadows and masking included; direct light only.
- White grooves send back all light, and no more, when all bounces are followed; direct light alone
  sends back less.
- What is measured is reciprocal within its standard errors, which are right: pulls have unit
  scatter against a far better measurement.
- A rough surface of narrow-lobed Gaussian facets is a microfacet BRDF (loosely).
- Regions of a patch average to the whole patch, and see their neighbours' shadows.
- Blocks come in any order, and depend on nothing but the seed; bad settings are refused.
"""

import numpy as np
import pytest

from jaxrender.brdf import Lambertian, Microfacet, Phong
from jaxrender.geometry import NUSSELT, POLAR
from jaxrender.geometry.height_fields import gaussian_surface, height_field, sawtooth
from jaxrender.reflection.tracing.gonioreflectometer import (
    Gonioreflectometer,
    Measurement,
    MeasureSettings,
)

FLAT = height_field(np.zeros((2, 2)))
RED, BLUE = np.array([0.3, 0.02]), np.array([0.01, 0.25])
WHITE = Lambertian(np.ones(1) / np.pi)
# 16 lattices: a pull has Student's distribution of 15 degrees of freedom, of this rms.
PULL_RMS = np.sqrt(15 / 13)


def cosine_directions(count, seed):
    """Evenly over the Nusselt disc."""
    rng = np.random.default_rng(seed)
    radius = np.sqrt((np.arange(count) + rng.random()) / count)
    azimuth = 2 * np.pi * (np.arange(count) * 0.6180339887498949 + rng.random())
    x, y = radius * np.cos(azimuth), radius * np.sin(azimuth)
    return np.stack([x, y, np.sqrt(1 - radius**2)], axis=-1)


def test_flat_lambertian_is_its_facets():
    found = Gonioreflectometer.of(FLAT, [Lambertian(RED)]).measure(
        MeasureSettings((6, 5, 4, 3), samples=16)
    )
    assert found.values.shape == (6, 5, 4, 3, 2)
    lit = np.asarray(NUSSELT.covers(NUSSELT.centres((6, 5))))
    seen = np.asarray(NUSSELT.covers(NUSSELT.centres((4, 3))))
    pairs = lit[:, :, None, None] & seen
    np.testing.assert_allclose(found.values[pairs], np.tile(RED, (pairs.sum(), 1)), rtol=1e-12)
    assert not found.values[~pairs].any()
    assert found.standard_errors.max() < 1e-12


@pytest.mark.parametrize("embedding", [NUSSELT, POLAR])
def test_flat_phong_is_phong(embedding):
    # Phong's BRDF is not reciprocal: exchanging the directions would show.
    phong = Phong(np.array([0.1]), np.array([0.4]), 12.0)
    settings = MeasureSettings((4, 5, 3, 6), embedding, samples=16)
    found = Gonioreflectometer.of(FLAT, [phong]).measure(settings).values
    light, exits = embedding.cell_directions((4, 5)), embedding.cell_directions((3, 6))
    expected = np.asarray(phong.evaluate(
        np.broadcast_to(light[:, :, None, None], (4, 5, 3, 6, 3)),
        np.broadcast_to(exits, (4, 5, 3, 6, 3)),
    ))  # fmt: skip
    inside = np.asarray(embedding.covers(embedding.centres((4, 5))))[:, :, None, None]
    inside = inside & np.asarray(embedding.covers(embedding.centres((3, 6))))
    np.testing.assert_allclose(found[inside], expected[inside], rtol=1e-9)


def groove_by_marching(angles, brdfs, incoming, outgoing, places=500):
    """rho of one endless V-groove, by following both lines of sight along its profile."""
    runs = 1 / np.tan(angles)
    height, crest = 1 / runs.sum(), runs[0] / runs.sum()

    def profile(x):
        x = x % 1
        return np.where(x < crest, x / crest * height, (1 - x) / (1 - crest) * height)

    x = (np.arange(places) + 0.5) / places
    steps = np.concatenate([np.linspace(1e-4, 0.1, 50), np.linspace(0.1, 4, 1000)])

    def free(direction):
        if abs(direction[0]) < 1e-12:
            return np.ones(places, bool)
        slope = direction[2] / abs(direction[0])
        along = x[:, None] + np.sign(direction[0]) * steps
        return (profile(along) <= profile(x)[:, None] + slope * steps + 1e-9).all(axis=1)

    rising = x < crest
    normals = np.where(
        rising[:, None], [-np.sin(angles[0]), 0, np.cos(angles[0])],
        [np.sin(angles[1]), 0, np.cos(angles[1])],
    )  # fmt: skip
    both = free(incoming) & free(outgoing)
    cosines = np.maximum(normals @ incoming, 0) * np.maximum(normals @ outgoing, 0)
    weight = both * cosines / normals[:, 2] / (incoming[2] * outgoing[2])
    return np.mean(weight[:, None] * np.where(rising[:, None], brdfs[0], brdfs[1]), axis=0)


@pytest.mark.parametrize("angles", [(0.6, 0.6), (0.35, 1.2)])
def test_direct_light_in_a_groove(angles):
    patch = sawtooth(3, *angles)
    meter = Gonioreflectometer.of(patch, [Lambertian(RED), Lambertian(BLUE)])
    incoming = cosine_directions(6, 1)
    settings = MeasureSettings(samples=2048, bounces=1)
    rng = np.random.default_rng(5)
    for outgoing in cosine_directions(4, 2):
        values, errors = meter.pairs(incoming, outgoing, settings, rng)
        expected = [
            groove_by_marching(np.array(angles), (RED, BLUE), w, outgoing) for w in incoming
        ]
        # The march is good to its steps, 1 / 500 of the profile, the lattice to its own.
        np.testing.assert_allclose(values, expected, atol=4e-3, rtol=1e-2)
        assert errors.max() < 5e-3


def albedo(meter, outgoing, bounces):
    """The share of light from everywhere that goes one way; from there, by reciprocity."""
    settings = MeasureSettings(samples=4096, bounces=bounces)
    rng = np.random.default_rng(0)
    lights = cosine_directions(100, 0)
    return np.array([
        np.pi * meter.pairs(lights, way, settings, rng)[0].mean() for way in outgoing
    ])  # fmt: skip


def test_white_grooves_keep_energy():
    meter = Gonioreflectometer.of(sawtooth(1, 1.1, 0.7), [WHITE, WHITE])
    ways = cosine_directions(3, 3)
    all_bounces, direct = (albedo(meter, ways, bounces) for bounces in (16, 1))
    # 40 bounces change no digit of four; 4096 paths scatter by 1 %.
    np.testing.assert_allclose(all_bounces, 1, atol=0.04)
    assert abs(all_bounces.mean() - 1) < 0.02
    assert (direct < 0.9).all()


@pytest.mark.slow
def test_errors_are_right_and_pairs_reciprocal():
    meter = Gonioreflectometer.of(sawtooth(1, 1.1, 0.7), [WHITE, WHITE])
    directions = cosine_directions(24, 7)
    good, poor = (MeasureSettings(samples=n, bounces=4) for n in (2048, 128))
    one, other = directions[:4], directions[4:]
    pulls, there = [], np.zeros((len(other), 4))
    for number, outgoing in enumerate(other):
        rng = np.random.default_rng(number)
        truth, small = meter.pairs(one, outgoing, good, rng)
        value, error = meter.pairs(one, outgoing, poor, rng)
        pulls.append(((value - truth) / np.hypot(error, small))[:, 0])
        there[number] = truth[:, 0]
    # Pulls of one exit direction are correlated: twenty independent ones remain.
    assert 0.7 * PULL_RMS < np.sqrt(np.mean(np.square(pulls))) < 1.35 * PULL_RMS
    for number, outgoing in enumerate(one):
        back, small = meter.pairs(other, outgoing, good, np.random.default_rng(99 + number))
        np.testing.assert_allclose(back[:, 0], there[:, number], atol=6 * small.max())
        assert small.max() < 0.02


@pytest.mark.slow
def test_rough_surface_of_narrow_facets_is_a_microfacet_brdf():
    slope, narrow = 0.3, 0.08
    facet = Microfacet(np.zeros(1), np.ones(1), narrow, None, "half", "smith", "beckmann")
    patch = gaussian_surface(slope, cells=128, correlation=0.03, seed=2)
    meter = Gonioreflectometer.of(patch, [facet])
    # Slopes add up: to those of the facets come half those within them, of the same sign of m.
    expected = Microfacet(
        np.zeros(1), np.ones(1), float(np.hypot(slope, narrow)), None, "half", "smith", "beckmann"
    )
    settings = MeasureSettings(samples=4096, bounces=1)
    outgoing = np.array([np.sin(0.5), 0, np.cos(0.5)])
    angles = np.radians([0, 15, 30, 45])
    incoming = np.stack([-np.sin(angles), np.zeros(4), np.cos(angles)], axis=-1)
    values, _ = meter.pairs(incoming, outgoing, settings, np.random.default_rng(1))
    wanted = np.asarray(expected.evaluate(incoming, np.broadcast_to(outgoing, (4, 3))))
    # One period holds 600 independent slopes, 20 % of scatter at each half vector.
    np.testing.assert_allclose(values, wanted, rtol=0.25)


def test_regions_average_to_the_whole_and_keep_their_neighbours():
    meter = Gonioreflectometer.of(sawtooth(1, 0.9, 0.9), [WHITE, WHITE])
    incoming, outgoing = np.array([[0.8, 0.0, 0.6]]), np.array([-0.1, 0.2, 0.97])
    outgoing /= np.linalg.norm(outgoing)

    def of(*region):
        settings = MeasureSettings(samples=2048, bounces=3, region=region)
        return meter.pairs(incoming, outgoing, settings, np.random.default_rng(2))[0][0, 0]

    parts = [of(*p) for p in ((0, 0, 0.5, 1), (0.5, 0, 1, 0.25), (0.5, 0.25, 1, 1))]
    whole = of(0, 0, 1, 1)
    assert 0.5 * parts[0] + 0.125 * parts[1] + 0.375 * parts[2] == pytest.approx(whole, rel=0.02)
    # Light from the right does not reach the rising side, whose neighbour hides it.
    assert parts[0] < 0.4 * parts[1]


def test_blocks_come_in_any_order():
    meter = Gonioreflectometer.of(sawtooth(2), [WHITE, WHITE])
    settings = MeasureSettings((3, 3, 3, 2), samples=32, bounces=2, seed=4)
    whole = meter.measure(settings)
    rest = list(meter.blocks(settings, done={1}))
    assert [block.row for block in rest] == [0, 2]
    again = Measurement.of([*rest, meter.block(settings, 1)])
    np.testing.assert_array_equal(whole.values, again.values)
    other = meter.measure(settings._replace(seed=5))
    assert not np.array_equal(whole.values, other.values)
    with pytest.raises(ValueError, match="each row once"):
        Measurement.of(rest)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"samples": 0}, "at least 1"),
        ({"size": (0, 4, 4, 4)}, "at least 1"),
        ({"region": (0.5, 0, 0.5, 1)}, "region"),
    ],
)
def test_settings_are_checked(changes, words):
    meter = Gonioreflectometer.of(FLAT, [WHITE])
    with pytest.raises(ValueError, match=words):
        meter.measure(MeasureSettings(**changes))


def test_misuse_is_refused():
    with pytest.raises(ValueError, match="one for each material"):
        Gonioreflectometer.of(sawtooth(2), [WHITE])
    with pytest.raises(ValueError, match="all alike"):
        Gonioreflectometer.of(sawtooth(2), [WHITE, Lambertian(RED)])
    meter, rng = Gonioreflectometer.of(FLAT, [WHITE]), np.random.default_rng(0)
    below = np.array([0.0, 0.0, -1.0])
    with pytest.raises(ValueError, match="below"):
        meter.pairs(-below[None], below, MeasureSettings(), rng)
