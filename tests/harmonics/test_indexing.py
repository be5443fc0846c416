"""Flat index of coefficients.

Pinned down: the index runs through degrees and orders without gap or repeat; count and band limit
are inverse; what is not a square, not a degree, not an order is refused.
"""

import numpy as np
import pytest

from jaxrender.harmonics import band_limit_of, coefficient_count, degrees, flat_index, orders


@pytest.mark.parametrize("band_limit", [0, 1, 2, 7, 128])
def test_flat_index_counts_degrees_and_orders_in_turn(band_limit):
    pairs = [(deg, m) for deg in range(band_limit + 1) for m in range(-deg, deg + 1)]
    assert [flat_index(*pair) for pair in pairs] == list(range(coefficient_count(band_limit)))
    np.testing.assert_array_equal(degrees(band_limit), [deg for deg, _ in pairs])
    np.testing.assert_array_equal(orders(band_limit), [m for _, m in pairs])


def test_band_limit_inverts_the_count():
    for band_limit in range(300):
        assert band_limit_of(coefficient_count(band_limit)) == band_limit


@pytest.mark.parametrize("count", [-4, -1, 0, 2, 8, 10, 24])
def test_count_that_is_no_square_is_refused(count):
    with pytest.raises(ValueError, match=str(count)):
        band_limit_of(count)


def test_negative_degree_and_missing_order_are_refused():
    with pytest.raises(ValueError, match="band_limit is -1"):
        coefficient_count(-1)
    with pytest.raises(ValueError, match="order 3"):
        flat_index(2, 3)
    with pytest.raises(ValueError, match="degree -1 does not exist"):
        flat_index(-1, 0)
