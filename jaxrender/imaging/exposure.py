"""Photographs of different exposure on one radiometric scale.

A sensor's linear value is radiance times exposure, up to a constant of the camera (aperture,
sensitivity) that no exposure time tells: results are relative to it.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxrender.shapes import checked


@checked
def to_radiance(
    values: Float[np.ndarray, "row column channel"], exposure: float
) -> Float[np.ndarray, "row column channel"]:
    """Linear values divided by the exposure (seconds, or a factor of any unit)."""
    return np.asarray(values, np.float64) / _checked("exposure", exposure)


def relative_exposures(exposures: Sequence[float]) -> Float[np.ndarray, "frame"]:
    """Exposures as multiples of the first one, so that the first photograph keeps its scale."""
    if not exposures:
        raise ValueError("no exposures given: give one for each photograph")
    checked = [_checked(f"exposure of frame {i}", e) for i, e in enumerate(exposures)]
    return np.array(checked) / checked[0]


def _checked(name: str, exposure: float) -> float:
    if not (np.isfinite(exposure) and exposure > 0):
        raise ValueError(f"{name} is {exposure}: give a positive, finite time or factor")
    return float(exposure)
