"""Pinned down: the circle of a ball from its silhouette.

- Of a mask of whole pixels, centre and radius to .05 of a pixel; of coverage, to .01; and the
  stated standard error is of the size of the error.
- A stand, a hole and a cropped side do no harm.
- Masks without an outline, and outlines that are no circle, are refused.
"""

import numpy as np
import pytest

from jaxrender.imaging.silhouette import circle_of

ROW, COLUMN, RADIUS = 61.37, 77.81, 43.29
SHAPE = (130, 150)
# Half-pixel steps of some 340 outline points average to .5 / sqrt(12 x 170) = .011.
WHOLE_PIXELS = 0.05
COVERED = 0.01


def distance(shape=SHAPE, factor=1):
    rows, columns = ((np.arange(n * factor) + 0.5) / factor for n in shape)
    return np.hypot(rows[:, None] - ROW, columns[None, :] - COLUMN)


def off(circle):
    return np.abs(np.array([circle.row - ROW, circle.column - COLUMN, circle.radius - RADIUS]))


def test_whole_pixels_give_a_fraction_of_one():
    found = circle_of(distance() < RADIUS)
    assert off(found).max() < WHOLE_PIXELS
    assert found.support == 1
    assert off(found).max() < 4 * found.standard_error < WHOLE_PIXELS * 2


def test_coverage_is_finer():
    fine = (distance(factor=8) < RADIUS).astype(float)
    coverage = fine.reshape(SHAPE[0], 8, SHAPE[1], 8).mean(axis=(1, 3))
    assert off(circle_of(coverage)).max() < COVERED


def test_stand_hole_and_cropping_do_no_harm():
    mask = distance() < RADIUS
    mask[90:, 70:90] = True
    mask[50:60, 60:75] = False
    mask = mask[:, 45:]
    found = circle_of(mask)
    found = found._replace(column=found.column + 45)
    assert off(found).max() < 2 * WHOLE_PIXELS
    assert found.support < 0.9


@pytest.mark.parametrize(
    ("mask", "message"),
    [
        (np.zeros((20, 20), bool), "outline has 0 points"),
        (np.ones((20, 20), bool), "outline has 0 points"),
        (np.pad(np.ones((4, 100), bool), 5), "lie on one circle"),
    ],
)
def test_what_is_no_ball_is_refused(mask, message):
    with pytest.raises(ValueError, match=message):
        circle_of(mask)
