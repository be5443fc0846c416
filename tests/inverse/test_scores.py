"""Score tests: how much more columns would explain.

- A score test is the fit with more columns, to first order: least squares themselves are its
  oracle.
"""

import numpy as np
import pytest

from jaxrender.inverse.diagnosis.derivatives import Derivatives
from jaxrender.inverse.diagnosis.scores import Leftover


def test_a_score_is_least_squares_with_more_columns():
    rng = np.random.default_rng(2)
    own, more = rng.normal(size=(200, 4)), rng.normal(size=(200, 3))
    more[:, 0] += own @ [1.0, 2, 0, 0]
    measured = own @ [1.0, -1, 2, 0] + more @ [0.3, 0, 0.2] + 0.1 * rng.normal(size=200)
    start = np.linalg.lstsq(own, measured, rcond=None)[0]
    left = measured - own @ start
    both = np.concatenate([own, more], axis=1)
    end = np.linalg.lstsq(both, measured, rcond=None)[0]
    score = Leftover(left, own).score(more)
    assert score.explained == pytest.approx(left @ left - np.sum((measured - both @ end) ** 2))
    np.testing.assert_allclose(score.shift, (end[:4] - start), atol=1e-9)
    assert score.columns == 3
    assert score.gain > 100


def test_columns_that_the_fit_makes_itself_explain_nothing():
    rng = np.random.default_rng(4)
    own, left = rng.normal(size=(100, 3)), rng.normal(size=100)
    score = Leftover(left, own).score(own @ rng.normal(size=(3, 2)))
    assert (score.columns, score.gain, score.explained) == (0, 0.0, 0.0)
    assert not Leftover(left, own).score(np.zeros((100, 2))).columns


def test_values_that_are_dark_and_known_to_be_do_not_count():
    rng = np.random.default_rng(5)
    own, more, left = rng.normal(size=(80, 2)), rng.normal(size=(80, 1)), rng.normal(size=80)
    dark = np.zeros(300)
    padded = [np.concatenate([part, np.zeros((300, part.shape[1]))]) for part in (own, more)]
    alone = Leftover(left, own).score(more)
    beside = Leftover(np.concatenate([left, dark]), padded[0]).score(padded[1])
    assert beside.gain == pytest.approx(alone.gain)


def test_no_value_is_surer_than_the_integrals():
    rng = np.random.default_rng(7)
    weights = 10 ** rng.uniform(-2, 9, (40, 2))
    radiance, own = rng.normal(size=(40, 2)), rng.normal(size=(40, 2, 3))
    prior = tuple(rng.normal(size=(40, 5)) for _ in range(2))
    known = Derivatives(
        weights * radiance,
        weights[:, :, None] * own,
        weights,
        tuple(w[:, None] * part for w, part in zip(weights.T, prior)),
        np.eye(13),
    )
    held = known.no_surer_than(1e-3)
    # Variances add.
    np.testing.assert_allclose(held.weights**-2, weights**-2.0 + 1e-6)
    np.testing.assert_allclose(held.residual, held.weights * radiance)
    np.testing.assert_allclose(held.by_unknown, held.weights[:, :, None] * own)
    for weight, found, part in zip(held.weights.T, held.prior, prior):
        np.testing.assert_allclose(found, weight[:, None] * part)


def test_values_left_out_are_not_in_the_fit():
    rng = np.random.default_rng(6)
    own = rng.normal(size=(50, 2, 2))
    left = 0.01 * rng.normal(size=(50, 2))
    left[:10, 1] += 3
    clipped = (np.arange(50) < 10)[:, None] & np.array([False, True])
    known = Derivatives(left, own, np.ones((50, 2)), (), np.eye(2))
    whole, others = (Leftover(one.left, one.jacobian) for one in (known, known.without(clipped)))
    score = whole.compared(others, 1)
    kept = ~clipped.ravel()
    flat, columns = left.ravel()[kept], own.reshape(-1, 2)[kept]
    expected, squares, *_ = np.linalg.lstsq(columns, flat, rcond=None)
    np.testing.assert_allclose(score.shift, expected)
    np.testing.assert_allclose(others.left @ others.left, squares[0])
    assert score.gain > 100


def test_unknowns_under_a_prior_are_as_good_as_solved_for():
    # Least squares with a row for each of them, which says that it is zero give or take one.
    rng = np.random.default_rng(8)
    weights, left = rng.uniform(1, 3, (60, 2)), rng.normal(size=(60, 2))
    own, more = rng.normal(size=(60, 2, 3)), rng.normal(size=(60, 2, 2))
    prior = tuple(rng.normal(size=(60, 25)) for _ in range(2))
    known = Derivatives(left, own, weights, prior, np.eye(53))
    score = Leftover(known.left, known.jacobian).score(known.weighted(more))
    held = np.zeros((60, 2, 50))
    held[:, 0, :25], held[:, 1, 25:] = prior

    def least(columns):
        dense = np.concatenate([columns, held], axis=2).reshape(120, -1)
        rows = np.concatenate([np.zeros((50, columns.shape[2])), np.eye(50)], axis=1)
        dense = np.concatenate([dense, rows])
        values = np.concatenate([left.ravel(), np.zeros(50)])
        found, squares, *_ = np.linalg.lstsq(dense, values, rcond=None)
        return found, squares[0]

    (without, before), (with_more, after) = (
        least(own),
        least(np.concatenate([own, weights[:, :, None] * more], axis=2)),
    )
    assert score.explained == pytest.approx(before - after)
    expected = np.concatenate([with_more[:3] - without[:3], with_more[5:] - without[3:]])
    np.testing.assert_allclose(score.shift, expected[:3], atol=1e-9)
    np.testing.assert_allclose(known.moved(score.shift, score.change), expected, atol=1e-9)


def test_noise_leaves_what_is_expected_beside_unknowns_under_a_prior():
    rng = np.random.default_rng(9)
    weights, deviation = rng.uniform(1, 3, (80, 1)), rng.uniform(0.1, 0.5, (80, 1))
    prior = (5 * rng.normal(size=(80, 10)),)
    many = []
    for _ in range(400):
        noise = weights * deviation * rng.normal(size=(80, 1))
        known = Derivatives(noise, np.zeros((80, 1, 0)), weights, prior, np.eye(10))
        many.append(np.sum(known.left**2))
    assert known.expected(deviation) == pytest.approx(np.mean(many), rel=0.03)
