"""Maps: site values as images.

- Row 0 is the first row of texels; unknown texels are NaN; single numbers make one channel.
- Dilation gives holes the nearest known value, no further than asked, leaves the known alone, and
  goes round the seam if asked.
"""

import numpy as np
import pytest

from jaxrender.inverse.texture import dilated, image_of_sites


def test_sites_fill_the_image_row_by_row():
    values = np.arange(18.0).reshape(6, 3)
    known = np.array([True, True, False, True, True, True])
    image = image_of_sites(values, (2, 3), known)
    np.testing.assert_array_equal(image[0, 1], values[1])
    np.testing.assert_array_equal(image[1, 0], values[3])
    assert np.isnan(image[0, 2]).all()
    assert np.isfinite(image).sum() == 15
    assert image_of_sites(values[:, 0], (3, 2)).shape == (3, 2, 1)
    with pytest.raises(ValueError, match="6 sites do not make 2 x 2 texels"):
        image_of_sites(values, (2, 2))


def test_dilation_takes_the_nearest_no_further_than_asked():
    image = np.full((5, 7, 1), np.nan)
    image[2, 2], image[2, 5] = 1.0, 2.0
    found = dilated(image, 1)[..., 0]
    assert np.isfinite(found).sum() == 10
    assert found[1, 2] == found[2, 3] == 1
    assert found[2, 4] == 2
    assert np.isnan(found[1, 1])
    far = dilated(image, 9)[..., 0]
    assert np.isfinite(far).all()
    np.testing.assert_array_equal(far[2], [1, 1, 1, 1, 2, 2, 2])


def test_dilation_goes_round_the_seam_if_asked():
    image = np.full((3, 8, 1), np.nan)
    image[1, 7] = 4.0
    assert dilated(image, 1, wrap=True)[1, 0, 0] == 4
    assert np.isnan(dilated(image, 1)[1, 0, 0])


def test_nothing_to_fill_or_to_fill_with_stays_as_it_is():
    full = np.ones((2, 2, 3))
    np.testing.assert_array_equal(dilated(full, 3), full)
    assert np.isnan(dilated(np.full((2, 2, 3), np.nan), 3)).all()
    holes = np.array([[[1.0], [np.nan]]])
    np.testing.assert_array_equal(dilated(holes, 0), holes)
