"""What a blur does to samples: known only with the material and the light that they show."""

import dataclasses

import numpy as np

from jaxrender.inverse.calibration.equations import NO_ROOM
from jaxrender.inverse.diagnosis.blurring import softening
from jaxrender.inverse.diagnosis.grounds import Grounds
from jaxrender.inverse.nuisances import Corrections, Told


def softened(told: Told, corrections: Corrections, grounds: Grounds) -> Told:
    """Say what a blur does to samples; ``grounds`` are these, with material and light."""
    observed, variance = corrections.geometry(told), float(corrections.blur[0])
    found = softening(dataclasses.replace(grounds, observations=observed), variance)
    if found is None:
        raise ValueError(f"blur cannot be freed: {NO_ROOM['blur']}")
    if not found.inside.any():
        width = float(np.sqrt(variance))
        raise ValueError(
            f"blur cannot be freed: a blur of {width:.1f} pixels mixes every sample with what lies "
            "beside the object; give photographs of more pixels"
        )
    return told._replace(softening=found)
