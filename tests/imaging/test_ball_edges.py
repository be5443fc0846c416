"""A ball without a mask is found by its edges.

- Centre and radius within half a pixel, in noise, before a background with edges of its own, by
  whatever it reflects; the largest of concentric circles is the outline.
- Photographs without a ball are refused.
- Two real balls, where the data are there.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from jaxrender.imaging import circle_of, circle_of_edges
from jaxrender.io import read_image

PHOTOS = Path(__file__).parents[3] / "shared" / "data" / "photos"
ROW, COLUMN, RADIUS = 131.4, 170.7, 61.3


def photograph(seed, ball=True):
    """A ball that reflects patches, before stripes and boxes."""
    rng = np.random.default_rng(seed)
    rows, columns = np.indices((260, 340)) + 0.5
    picture = 0.4 + 0.2 * np.sign(np.sin(columns / 17 + seed))
    picture[200:230, 40:290] = 1.1
    picture += 0.1 * gaussian_filter(rng.normal(size=picture.shape), 6) * 20
    distance = np.hypot(rows - ROW, columns - COLUMN)
    patches = 0.9 + 0.6 * np.sign(gaussian_filter(rng.normal(size=picture.shape), 9))
    # A lamp's reflection is a circle, too.
    patches[np.hypot(rows - ROW + 20, columns - COLUMN) < 15] = 3.0
    covered = np.clip(RADIUS - distance + 0.5, 0, 1) * ball
    picture = covered * patches + (1 - covered) * picture
    return np.abs(picture + 0.03 * rng.normal(size=picture.shape))


@pytest.mark.parametrize("seed", range(3))
def test_a_ball_before_stripes(seed):
    found = circle_of_edges([photograph(seed), 0.25 * photograph(seed)])
    off = np.array([found.row - ROW, found.column - COLUMN, found.radius - RADIUS])
    assert np.abs(off).max() < 0.5
    assert found.support > 0.6


def test_the_outline_is_the_largest_circle():
    """What stands around is a sharper circle in the ball's middle."""
    rows, columns = np.indices((260, 340)) + 0.5
    distance = np.hypot(rows - ROW, columns - COLUMN)
    inner = 2.0 * np.clip(0.55 * RADIUS - distance + 0.5, 0, 1)
    found = circle_of_edges([photograph(1) + inner])
    assert found.radius == pytest.approx(RADIUS, abs=0.5)


def test_no_ball_is_refused():
    for seed in range(3):
        with pytest.raises(ValueError, match=r"edges"):
            circle_of_edges([photograph(seed, ball=False)])
    with pytest.raises(ValueError, match="no edges of a ball are seen"):
        circle_of_edges([np.full((60, 60), 0.3)])


@pytest.mark.skipif(not PHOTOS.is_dir(), reason="the shared photographs are not here")
def test_real_balls():
    mask = read_image(PHOTOS / "chrome/chrome.mask.tga").pixels.mean(axis=-1)
    wanted = circle_of(mask / mask.max())
    paths = [PHOTOS / f"chrome/chrome.{k}.tga" for k in range(0, 12, 3)]
    found = circle_of_edges([read_image(path).pixels.mean(axis=-1) for path in paths])
    np.testing.assert_allclose(found[:3], wanted[:3], atol=1.5)
