"""What a blur does to samples: known only with the material and the light that they show."""

import numpy as np

from jaxrender.inverse.calibration.equations import NO_ROOM, State
from jaxrender.inverse.diagnosis.blurring import softening
from jaxrender.inverse.diagnosis.grounds import Grounds, gain_of
from jaxrender.inverse.diagnosis.light_parts import LightParts
from jaxrender.inverse.material_task import MaterialTask
from jaxrender.inverse.nuisances import Told


def softened(task: MaterialTask, told: Told, state: State, free: tuple[str, ...]) -> Told:
    """Say what a blur does to samples, as a state predicts them; nothing where none is free."""
    if "blur" not in free:
        return told
    observed = state.corrections.geometry(told)
    grounds = Grounds(
        observed,
        np.zeros(np.shape(observed.radiance)),
        gain_of(state.stop, np.asarray(observed.frame))[:, None],
        task.material(state.stop),
        LightParts.known(state.light),
        told.shape,
    )
    found = softening(grounds, float(state.corrections.blur[0]))
    if found is None:
        raise ValueError(f"blur cannot be freed: {NO_ROOM['blur']}")
    if not found.inside.any():
        width = float(np.sqrt(state.corrections.blur[0]))
        raise ValueError(
            f"blur cannot be freed: a blur of {width:.1f} pixels mixes every sample with what lies "
            "beside the object; give photographs of more pixels"
        )
    return told._replace(softening=found)
