"""Measured isotropic reflectance: the table over half and difference angles, and its fit.

Pinned down: the angles are those of rotating w_i into the half vector's frame, written out here by
matrices; exchanging the directions changes no coordinate; nodes are hit exactly; a table of a known
model converges to it; derivatives against finite differences, and finite where angles mean nothing;
precision follows the directions; the albedo decides about energy; a fit to samples of a known model
with 1 % noise is as near to it as it says, and stays within them; missing values are counted and
left out; every refusal; and measured paints, where they are at hand.
"""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import (
    BRDF,
    CookTorrance,
    HalfDifference,
    IsotropicTable,
    Lambertian,
    TorranceSparrow,
    Ward,
    directional_albedo,
    fit_isotropic_table,
    half_difference,
    reciprocity_error,
)
from jaxrender.brdf.tables.isotropic import node_angles, pair_at
from jaxrender.geometry import Components

PAINTS = Path(__file__).parents[3] / "shared" / "data" / "paints"

ROUNDING = 1e-12
KD, KS = np.array([0.05, 0.1]), np.array([0.3, 0.2])
GLOSSY = CookTorrance(KD, KS, 0.25, np.array([0.14, 1.5]), np.array([4.0, 1.9]))


evaluate = eqx.filter_jit(BRDF.evaluate)
compiled_angles = jax.jit(half_difference)


def upper(count, seed, lowest=0.15):
    rng = np.random.default_rng(seed)
    cosine, azimuth = rng.uniform(lowest, 1, count), rng.uniform(0, 2 * np.pi, count)
    sine = np.sqrt(1 - cosine**2)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)


def angles_by_rotation(incoming, outgoing):
    """Turn the half vector's azimuth away, then its polar angle; what w_i becomes is d."""
    half = (incoming + outgoing) / np.linalg.norm(incoming + outgoing)
    theta, phi = np.arccos(half[2]), np.arctan2(half[1], half[0])
    c, s = np.cos(-phi), np.sin(-phi)
    about_normal = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    c, s = np.cos(-theta), np.sin(-theta)
    about_side = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    d = about_side @ about_normal @ incoming
    return theta, np.arccos(d[2]), np.arctan2(d[1], d[0]) % np.pi


def coordinates(incoming, outgoing):
    found = compiled_angles(Components.of(incoming), Components.of(outgoing))
    return np.stack([np.asarray(angle) for angle in found], axis=-1)


def test_angles_are_those_of_two_rotations():
    a, b = upper(50, 0), upper(50, 1)
    expected = [angles_by_rotation(*pair) for pair in zip(a, b, strict=True)]
    np.testing.assert_allclose(coordinates(a, b), expected, atol=1e-7)


def test_exchanged_directions_have_the_same_angles():
    a, b = upper(500, 2), upper(500, 3)
    np.testing.assert_allclose(coordinates(a, b), coordinates(b, a), atol=4e-16)
    table = IsotropicTable(np.random.default_rng(0).uniform(size=(7, 6, 5, 2)))
    assert table.reciprocal
    assert reciprocity_error(table) < ROUNDING


def test_in_plane_pairs_are_reciprocal_across_the_seam():
    angle = np.radians(np.array([10.0, 40.0, 70.0]))
    a = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1)
    b = a[[1, 2, 0]] * [-1, 1, 1]
    table = IsotropicTable(np.random.default_rng(0).uniform(size=(7, 6, 5, 1)))
    np.testing.assert_allclose(evaluate(table, a, b), evaluate(table, b, a), rtol=ROUNDING)


def test_phi_goes_round():
    """Half way between the last node and pi, which is the first again."""
    values = np.random.default_rng(0).uniform(size=(7, 6, 5, 1))
    angles = HalfDifference(
        *(np.array([v]) for v in (np.pi / 2 * (3 / 7) ** 2, np.pi / 6, 0.9 * np.pi))
    )
    found = IsotropicTable(values).evaluate(*pair_at(angles))
    assert found[0, 0] == pytest.approx(values[3, 2, [4, 0], 0].mean(), rel=1e-9)


def test_turning_both_directions_changes_nothing():
    a, b, turn = upper(50, 4), upper(50, 5), 1.1
    rotation = np.array(
        [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    table = IsotropicTable(np.random.default_rng(0).uniform(size=(7, 6, 5, 1)))
    turned = evaluate(table, a @ rotation.T, b @ rotation.T)
    np.testing.assert_allclose(evaluate(table, a, b), turned, rtol=1e-9)


def test_a_node_has_its_own_value():
    shape, node = (9, 8, 12), (3, 2, 5)
    values = np.zeros((*shape, 1))
    values[node] = 2.0
    theta_h, theta_d, phi_d = np.pi / 2 * (3 / 9) ** 2, np.pi / 2 * 2 / 8, np.pi * 5 / 12
    pair = pair_at(HalfDifference(*(np.array([v]) for v in (theta_h, theta_d, phi_d))))
    np.testing.assert_allclose(coordinates(*pair)[0], [theta_h, theta_d, phi_d], atol=1e-12)
    assert IsotropicTable(values).evaluate(*pair)[0, 0] == pytest.approx(2, rel=1e-9)
    inside = node_angles(shape)
    np.testing.assert_allclose([a[node] for a in inside], [theta_h, theta_d, phi_d], rtol=ROUNDING)


def relative_error(table, brdf):
    a, b = upper(4000, 6), upper(4000, 7)
    truth = np.asarray(evaluate(brdf, a, b))
    return np.sqrt(np.mean((np.asarray(evaluate(table, a, b)) - truth) ** 2) / np.mean(truth**2))


def test_a_table_converges_to_its_model():
    errors = [relative_error(IsotropicTable.of(GLOSSY, (n, n, n)), GLOSSY) for n in (15, 30, 60)]
    # Linear interpolation: a quarter for half the step, while kinks and the horizon cost a little.
    assert errors[2] < 0.02
    assert errors[1] < errors[0] / 2.5
    assert errors[2] < errors[1] / 2.5


def test_nothing_comes_from_below_the_horizon():
    table = IsotropicTable(np.ones((3, 3, 2, 1)))
    up, down = np.array([[0.6, 0, 0.8]]), np.array([[0.6, 0, -0.8]])
    assert table.evaluate(up, up)[0, 0] == pytest.approx(1, rel=ROUNDING)
    assert table.evaluate(up, down)[0, 0] == 0
    assert table.evaluate(down, up)[0, 0] == 0


def test_derivatives_are_those_of_finite_differences():
    table = IsotropicTable(np.random.default_rng(1).uniform(size=(6, 6, 8, 2)))
    a, b = upper(1, 8)[0], upper(1, 9)[0]

    @jax.jit
    def value(values, incoming, outgoing):
        return IsotropicTable(values).evaluate(incoming, outgoing)[1]

    arguments = [jnp.asarray(v) for v in (table.values, a, b)]
    slopes = [np.asarray(s) for s in jax.grad(value, (0, 1, 2))(*arguments)]
    rng = np.random.default_rng(2)
    for place, slope in enumerate(slopes):
        step = 1e-6 * rng.normal(size=slope.shape)
        ends = []
        for sign in (1, -1):
            moved = list(arguments)
            moved[place] = moved[place] + sign * step
            ends.append(float(value(*moved)))
        assert (ends[0] - ends[1]) / 2 == pytest.approx(np.sum(slope * step), rel=1e-5)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_derivatives_are_finite_where_angles_mean_nothing(dtype):
    table = IsotropicTable(np.random.default_rng(3).uniform(size=(6, 6, 8, 1)))
    up = np.array([0, 0, 1], dtype)
    leaning, mirrored = np.array([0.6, 0, 0.8], dtype), np.array([-0.6, 0, 0.8], dtype)
    pairs = [(up, up), (leaning, leaning), (leaning, mirrored), (up, leaning), (up, -up)]
    slope = jax.jit(jax.grad(lambda a, b: table.evaluate(a, b).sum(), (0, 1)))
    for a, b in pairs:
        assert np.all(np.isfinite(np.array(slope(jnp.asarray(a), jnp.asarray(b)))))


def test_precision_follows_the_directions_and_batches_are_pairs():
    table = IsotropicTable(np.random.default_rng(4).uniform(1, 2, size=(6, 6, 8, 2)))
    a, b = upper(40, 10), upper(40, 11)
    single = evaluate(table, a.astype(np.float32), b.astype(np.float32))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, evaluate(table, a, b), rtol=1e-4)
    mapped = jax.jit(jax.vmap(table.evaluate))(a, b)
    np.testing.assert_allclose(mapped, evaluate(table, a, b), rtol=ROUNDING)


def test_energy_is_measured():
    bright, dark = np.full((4, 4, 2, 2), 1.01 / np.pi), np.full((4, 4, 2, 2), 1 / np.pi)
    assert IsotropicTable(dark).conserves_energy
    assert not IsotropicTable(bright).conserves_energy
    np.testing.assert_allclose(directional_albedo(IsotropicTable(dark), [0.5]), 1, rtol=1e-6)


BROKEN = {
    "one node": (np.ones((1, 4, 4, 1)), "at least 2 nodes"),
    "no channel": (np.ones((4, 4, 4, 0)), "at least 2 nodes"),
    "negative": (np.full((4, 4, 4, 1), -1.0), r"values\[0, 0, 0, 0\] is -1 \(64 such\)"),
    "not a number": (np.full((4, 4, 4, 1), np.nan), "fill entries that were not measured"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_tables_that_are_refused(case):
    values, expected = BROKEN[case]
    with pytest.raises(ValueError, match=expected):
        IsotropicTable(values)


def test_anisotropic_models_are_refused():
    with pytest.raises(ValueError, match="Ward is anisotropic"):
        IsotropicTable.of(Ward(KD, KS, 0.1, 0.4), (4, 4, 4))


MATERIAL = TorranceSparrow(KD, KS, 0.3, 1.5, masking="smith")


def samples(noise, count=1000, seed=0, lowest=0.35):
    """Half of the pairs near each other's mirror direction, as a gonioreflectometer is sent.

    Nearer to grazing, a sum of squares would be that of one or two values.
    """
    a, b = upper(count, seed, lowest), upper(count, seed + 1, lowest)
    near = count // 2
    b[:near] = a[:near] * [-1, -1, 1] + 0.3 * b[:near]
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    values = np.asarray(evaluate(MATERIAL, a, b))
    return a, b, values * (1 + noise * np.random.default_rng(seed + 2).normal(size=values.shape))


def test_a_fit_is_as_near_as_it_says():
    """Between the measurements; what is said includes their noise, 1 %."""
    fit = fit_isotropic_table(*samples(0.01), shape=(36, 36, 24))
    a, b, truth = samples(0.0, seed=50, lowest=0.4)
    error = np.asarray(evaluate(fit.brdf, a, b)) - truth
    relative = np.sqrt(np.sum(error**2, axis=0) / np.sum(truth**2, axis=0))
    assert np.all(relative < fit.relative_rms)
    assert np.all(fit.relative_rms < 0.05)
    assert np.all(np.median(np.abs(error), axis=0) / np.median(truth, axis=0) < fit.typical)
    assert np.all(fit.typical < 0.01)
    assert np.all(fit.residual < fit.relative_rms)


def test_missing_values_are_counted_and_left_out():
    a, b, values = samples(0.0, 300)
    shape = (12, 12, 8)
    whole = fit_isotropic_table(a[14:], b[14:], values[14:, :1], shape=shape)
    values[:10, 0], values[10:14, 0] = -1.0, np.nan
    fit = fit_isotropic_table(a, b, values, shape=shape)
    np.testing.assert_array_equal(fit.masked, [14, 0])
    np.testing.assert_array_equal(fit.used, [286, 300])
    np.testing.assert_allclose(fit.brdf.values[..., :1], whole.brdf.values, rtol=1e-9)
    np.testing.assert_allclose(fit.relative_rms[:1], whole.relative_rms, rtol=1e-9)


def test_the_fit_stays_within_its_measurements():
    """Cubics overshoot a lone bright value; the table does not."""
    a, b, values = samples(0.0, 300)
    values[0] *= 100
    fit = fit_isotropic_table(a, b, values, shape=(12, 12, 8))
    table = np.asarray(fit.brdf.values)
    assert np.all(table.max(axis=(0, 1, 2)) <= values.max(axis=0) * (1 + ROUNDING))
    assert np.all(table.min(axis=(0, 1, 2)) >= values.min(axis=0) * (1 - ROUNDING))


def test_pairs_measured_both_ways_are_one_point():
    a, b, values = samples(0.0, 300)
    both = [np.concatenate(pair) for pair in ((a, b), (b, a), (values, values))]
    shape = (12, 12, 8)
    once, twice = (fit_isotropic_table(*data, shape=shape) for data in ((a, b, values), both))
    np.testing.assert_allclose(twice.brdf.values, once.brdf.values, rtol=1e-6)


def test_a_white_surface_stays_white():
    a, b, _ = samples(0.0, 200)
    values = np.asarray(evaluate(Lambertian(KD), a, b))
    fit = fit_isotropic_table(a, b, values, shape=(8, 8, 6))
    np.testing.assert_allclose(fit.brdf.values, np.broadcast_to(KD, (8, 8, 6, 2)), rtol=1e-9)


def test_measurements_that_are_refused():
    a, b, values = samples(0.0, 100)
    with pytest.raises(ValueError, match=r"incoming\[3\] is .*above the horizon"):
        fit_isotropic_table(np.where(np.arange(100)[:, None] == 3, -a, a), b, values)
    with pytest.raises(ValueError, match=r"outgoing\[0\] is .*unit vectors"):
        fit_isotropic_table(a, 2 * b, values)
    with pytest.raises(ValueError, match="a channel has 30 usable values"):
        fit_isotropic_table(a[:30], b[:30], values[:30])
    with pytest.raises(ValueError, match="folds=1"):
        fit_isotropic_table(a, b, values, folds=1)
    with pytest.raises(ValueError, match="do not spread"):
        fit_isotropic_table(a, a, values)


@pytest.mark.skipif(not PAINTS.exists(), reason="the measured paints are not on this machine")
@pytest.mark.parametrize("paint", ["krylon_blue", "acryl_blue"])
def test_measured_paints(paint):
    """Blue, brightest about the mirror direction, and known to a few percent where smooth."""
    # Imported here: tests of reflectance need files for this one thing.
    from jaxrender.imaging import rgb_of_reflectance
    from jaxrender.io import read_cornell

    data = read_cornell(PAINTS / f"{paint}.brdf")
    colours = rgb_of_reflectance(data.wavelengths, data.values)
    fit = fit_isotropic_table(data.incoming, data.outgoing, colours, shape=(30, 30, 24))
    np.testing.assert_array_equal(fit.used, 1439)
    assert fit.typical[2] < 0.1
    assert fit.brdf.conserves_energy
    albedo = directional_albedo(fit.brdf, [0.9])[0]
    assert albedo[2] > 3 * albedo[0]
    lean = np.array([[np.sin(0.8), 0, np.cos(0.8)]])
    mirror, retro = (np.asarray(fit.brdf.evaluate(lean, lean * [s, 1, 1])).mean() for s in (-1, 1))
    assert mirror > 5 * retro
