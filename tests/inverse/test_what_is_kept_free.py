"""What is freed stays free if it does what was foretold of it.

- Gross faults are judged by squares: a robust loss, which hardly counts them, sees a third of what
  is done away with.
- What does less than was foretold is refused, by either measure, and where nothing is measured the
  robust loss decides alone.
"""

import numpy as np
import pytest

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.calibration import Calibration, Examined
from jaxrender.inverse.diagnosis import Diagnosis
from jaxrender.inverse.misfit import Misfit

FORETOLD = 0.65


def examined(rms, absorbed=None):
    """Leave so much of the radiance, with the cameras named, or freed with that success."""
    misfit = None if rms is None else Misfit(NoiseModel(0.01, 0.0), rms, 0.9, 0.9, True)
    named = (Diagnosis("camera", "cameras are turned", FORETOLD, 1900.0, np.zeros(3)),)
    if absorbed is None:
        return Examined("before", misfit, named)
    nothing = Calibration(None, None, ("camera",), {}, np.zeros((3, 0)), True, (), absorbed)
    return Examined("after", misfit, (), nothing)


@pytest.mark.parametrize(
    ("before", "after", "absorbed", "kept"),
    [
        (0.47, 0.21, 0.30, True),
        (0.47, 0.40, 0.30, False),
        (0.02, 0.019, 0.40, True),
        (None, None, 0.40, True),
        (None, None, 0.30, False),
        (0.47, None, 0.30, False),
        (0.0, 0.0, 0.30, False),
    ],
)
def test_what_is_freed_is_to_do_half_of_what_was_foretold(before, after, absorbed, kept):
    end = examined(before).and_then(examined(after, absorbed))
    assert end.end == ("after" if kept else "before")
    assert end.refused == (() if kept else ("camera",))
    assert end.freed == (("camera",) if kept else ())
