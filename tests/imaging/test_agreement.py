"""Pinned down: photographs of one scene are held against one another before they are merged.

- Exposures measured by the pixels are the true ones, to their stated errors; an exposure that is
  wrong is named, and a rounded time is not.
- A wrong response is told from a wrong exposure.
- Photographs that share no well exposed pixels tell nothing of one another.
- Shifts are found to a fiftieth of a pixel, against SciPy's own; beyond the limit they are refused.
"""

import numpy as np
import pytest
from bracket_problems import bracketed, scene, stored
from scipy import ndimage

from jaxrender.imaging import (
    SRGB,
    Bracket,
    Linear,
    Shift,
    aligned,
    check_shifts,
    measure_exposures,
    measure_shifts,
    shift_between,
)

EXPOSURES = 4.0 ** np.arange(-3, 1)
NAMES = ("a.jpg", "b.jpg", "c.jpg", "d.jpg")


def test_true_exposures_are_confirmed():
    found = measure_exposures(bracketed(scene(), EXPOSURES), SRGB())
    assert found.wrong == []
    assert found.said(NAMES) is None
    assert np.abs(found.measured / EXPOSURES - 1).max() < 0.01
    assert found.relative_error.max() < 0.005
    assert found.exponent == pytest.approx(1, abs=0.01)


def test_a_wrong_exposure_is_named_and_measured():
    brackets = bracketed(scene(), EXPOSURES)
    brackets[2] = brackets[2]._replace(exposure=1.5 * EXPOSURES[2])
    found = measure_exposures(brackets, SRGB())
    assert found.wrong == [2]
    np.testing.assert_allclose(found.measured, EXPOSURES, rtol=0.01)
    said = found.said(NAMES)
    assert said is not None
    assert said.startswith("the pixels contradict the stated exposures (c.jpg: 0.375 stated, 0.25")


def test_a_rounded_time_is_no_lie():
    brackets = bracketed(scene(), 1 / np.array([64.0, 16.0, 4.0]))
    rounded = [b._replace(exposure=1 / t) for b, t in zip(brackets, (60.0, 15.0, 4.0))]
    assert measure_exposures(rounded, SRGB()).wrong == []


def test_a_wrong_response_is_told_from_wrong_exposures():
    said = measure_exposures(bracketed(scene(), EXPOSURES), Linear()).said(NAMES)
    assert said is not None
    assert said.startswith("the pixels follow the stated exposures to the power 0.5")
    assert said.endswith("the response is wrong rather than the exposures")


def test_photographs_that_share_nothing():
    low, high = np.full((8, 8, 1), 0.5), np.full((8, 8, 1), 1.0)
    found = measure_exposures([Bracket(low, 1.0), Bracket(high, 50.0)])
    np.testing.assert_allclose(found.measured, [1, 50], rtol=1e-12)
    assert np.isinf(found.relative_error).all()
    assert found.wrong == []


def moved_by(shifts, seed=3):
    """Photograph a larger scene, moved before it is cropped, each at four times the exposure."""
    rng, large = np.random.default_rng(seed), np.log(scene(2, (130, 150)))
    photographs = []
    for t, shift in zip(EXPOSURES, shifts):
        there = np.exp(ndimage.shift(large, (*shift, 0), order=3))[15:-15, 15:-15]
        photographs.append(Bracket(stored(there, t, rng), float(t)))
    return photographs


def test_shifts_across_exposures():
    true = [(0.0, 0.0), (0.3, -0.2), (2.4, -1.6), (-5.3, 7.1)]
    found = measure_shifts(moved_by(true), SRGB())
    for (down, right), shift in zip(true, found):
        assert shift.rows == pytest.approx(down, abs=0.02)
        assert shift.columns == pytest.approx(right, abs=0.02)
        assert shift.standard_error < 0.02
    with pytest.raises(ValueError, match=r"c\.jpg: the picture lies 2\.40 pixels down and -1\.6"):
        check_shifts(found, NAMES)
    check_shifts(found, NAMES, limit=10.0)
    # Whole pixels leave up to half a pixel along rows and along columns.
    left = measure_shifts(aligned(moved_by(true), found), SRGB())
    check_shifts(left, NAMES, limit=np.hypot(0.5, 0.5))


def test_an_even_picture_tells_no_shift():
    wall = np.full((20, 20), 0.5)
    assert shift_between(wall, wall).standard_error == np.inf
    edge = np.where(np.arange(20) < 10, 0.2, 0.8) + np.zeros((20, 1))
    assert shift_between(edge, edge).standard_error == np.inf
    check_shifts([Shift(9.0, 0.0, np.inf)], ["wall.jpg"])
