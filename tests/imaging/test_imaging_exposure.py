"""Exposure.

Pinned down: photographs of one scene at different exposures become the same radiance; relative
exposures keep the first photograph's scale; what is refused, by frame.
"""

import numpy as np
import pytest

from jaxrender.imaging import relative_exposures, to_radiance


def test_photographs_at_two_exposures_agree():
    scene = np.random.default_rng(0).random((4, 5, 3))
    exposures = [1 / 30, 1 / 8]
    photographs = [7 * exposure * scene for exposure in exposures]
    relative = relative_exposures(exposures)
    radiances = [to_radiance(p, float(e)) for p, e in zip(photographs, relative, strict=True)]
    np.testing.assert_allclose(radiances[0], photographs[0])
    np.testing.assert_allclose(radiances[1], radiances[0])


@pytest.mark.parametrize("exposure", [0.0, -1.0, np.inf])
def test_bad_exposures_are_refused(exposure):
    with pytest.raises(ValueError, match="positive, finite time"):
        to_radiance(np.ones((1, 1, 3)), exposure)
    with pytest.raises(ValueError, match="exposure of frame 1"):
        relative_exposures([1.0, exposure])


def test_no_exposures_are_refused():
    with pytest.raises(ValueError, match="one for each photograph"):
        relative_exposures([])
