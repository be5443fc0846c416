"""Noise apart from misfit, by neighbouring pixels."""

import numpy as np
import pytest

from jaxrender.geometry import SurfaceSamples
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.misfit import Left, measure_misfit, rows_of_three
from jaxrender.inverse.observations import Observations

SIDE, FRAMES = 40, 3
NOISE = NoiseModel(0.02, 0.003)


def photographs(seed=0):
    """Take pictures of smooth radiance, in an order that nobody may rely on; and the truth."""
    rng = np.random.default_rng(seed)
    row, column = np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij")
    pixel = np.tile(np.stack([row.ravel(), column.ravel()], axis=1), (FRAMES, 1))
    frame = np.repeat(np.arange(FRAMES), SIDE**2)
    place = pixel / SIDE
    truth = 0.5 + place[:, :1] ** 2 + np.stack([place[:, 1], 1 - place[:, 1], 0 * frame], axis=1)
    order = rng.permutation(len(frame))
    normals = np.tile([0.0, 0.0, 1.0], (len(frame), 1))
    measured = NOISE.add(truth, rng)
    pool = Observations(SurfaceSamples(normals, normals), measured, frame, pixel=pixel)
    return pool.take(order), truth[order]


def test_rows_are_neighbours_of_one_photograph_and_do_not_overlap():
    pool, _ = photographs()
    some = np.flatnonzero(np.random.default_rng(1).uniform(size=pool.count) < 0.8)
    thinner = pool.take(some)
    rows = rows_of_three(thinner, 10_000, 0)
    assert len(rows) > 200
    assert len(np.unique(rows)) == rows.size
    pixel, frame = np.asarray(thinner.pixel)[rows], np.asarray(thinner.frame)[rows]
    assert np.all(frame == frame[:, :1])
    assert np.all(pixel[:, :, 0] == pixel[:, :1, 0])
    assert np.all(np.diff(pixel[:, :, 1], axis=1) == 1)
    assert len(rows_of_three(thinner, 50, 0)) == 50


def test_no_rows_where_nobody_says_which_pixels_they_are():
    pool, _ = photographs()
    assert len(rows_of_three(pool._replace(pixel=None), 100, 0)) == 0


def test_clipped_pixels_are_in_no_row():
    pool, _ = photographs()
    clipped = pool._replace(radiance=np.minimum(pool.radiance, 1.2))
    rows = rows_of_three(clipped, 10_000, 0)
    assert 100 < len(rows) < len(rows_of_three(pool, 10_000, 0))
    assert np.max(np.asarray(clipped.radiance)[rows]) < 1.2


def measured(bias, noise=None):
    """Measure the misfit of a prediction that is wrong by a smooth part ``bias``."""
    pool, truth = photographs()
    wrong = 1 + bias * np.sin(3 * np.asarray(pool.pixel)[:, :1] / SIDE)
    rows = rows_of_three(pool, 1000, 0).ravel()
    fitted = Left(pool, truth * wrong)
    return measure_misfit(fitted, Left(pool.take(rows), (truth * wrong)[rows]), noise), truth, wrong


@pytest.mark.parametrize("bias", [0.0, 0.02, 0.1, 0.5])
def test_the_noise_is_that_of_the_pixels_whatever_the_model_leaves(bias):
    found, truth, wrong = measured(bias)
    level = np.sqrt(np.mean(truth**2, keepdims=True))
    ratio = found.noise.standard_deviation(level) / NOISE.standard_deviation(level)
    # Where the prediction is wrong by a half, so is the radiance that noise is told by.
    np.testing.assert_allclose(ratio, 1, atol=0.08 + 0.4 * bias)
    left = np.sqrt(np.sum((truth * (wrong - 1)) ** 2) / np.sum(truth**2))
    assert found.rms == pytest.approx(left, rel=0.05, abs=0.004)
    assert found.found == (bias > 0)
    if bias >= 0.1:
        assert found.correlation > 0.8
    if bias == 0:
        assert found.correlation < 0.1
        assert found.share < 0.1


def test_what_stands_for_no_pixel_changes_nothing():
    pool, truth = photographs()
    rows = rows_of_three(pool, 1000, 0)
    gone = np.zeros(pool.count, bool)
    gone[np.random.default_rng(2).choice(pool.count, 400, replace=False)] = True
    garbage = np.where(gone[:, None], 7.0, truth)
    weights = np.where(gone, 0.0, 1.0)
    thinner = pool._replace(stands_for=weights)
    with_garbage = measure_misfit(
        Left(thinner, garbage), Left(thinner.take(rows.ravel()), garbage[rows.ravel()]), None
    )
    whole, kept = rows[~gone[rows].any(axis=1)].ravel(), np.flatnonzero(~gone)
    without = measure_misfit(
        Left(pool.take(kept), truth[kept]), Left(pool.take(whole), truth[whole]), None
    )
    assert 0 < len(whole) < rows.size
    assert not with_garbage.found
    assert with_garbage.rms == without.rms
    assert with_garbage.noise == without.noise


def test_a_given_noise_is_taken():
    found, *_ = measured(0.0, NoiseModel(0.01, 0.0))
    assert found.noise.relative == 0.01
    assert found.found
    assert "beside a noise of 1 %" in found.sentence()


def test_without_neighbours_and_noise_nobody_knows():
    pool, truth = photographs()
    assert measure_misfit(Left(pool, truth), None, None) is None


def test_errors_of_the_integrals_are_no_misfit():
    pool, truth = photographs()
    exact = pool._replace(radiance=truth)
    rows = rows_of_three(exact, 1000, 0).ravel()
    nearly = truth * (1 + 1e-3 * np.sin(np.asarray(pool.pixel)[:, :1] / 5))
    found = measure_misfit(Left(exact, nearly), Left(exact.take(rows), nearly[rows]), None)
    assert not found.found
