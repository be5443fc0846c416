"""Free nuisances of a capture: on some samples first, and then on all."""

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.calibration.account import Calibrated, account_of
from jaxrender.inverse.calibration.capture import Divided, FreeCapture, Weighing
from jaxrender.inverse.calibration.equations import State
from jaxrender.inverse.calibration.softened import softened
from jaxrender.inverse.material_task import MaterialTask
from jaxrender.inverse.nuisances import Corrections, Told
from jaxrender.inverse.passes import Stop, descend


def calibrate(
    task: MaterialTask,
    told: Told,
    begin: Stop,
    free: tuple[str, ...],
    noise: NoiseModel,
    corrections: Corrections | None = None,
) -> Calibrated:
    """Free some nuisances, and find them with the material; ``begin`` is a fit without them.

    ``noise`` is that of single pixels.  ``corrections`` are those known so far.  It works on some
    of the samples, under light in coarse cells; ``finish`` takes all of both.

    Raises ``ValueError`` for a nuisance that the photographs or the light leave no room for.
    """
    corrections = corrections or Corrections.none(told)
    index = Divided.of(task, told, begin)
    few = told._replace(observations=told.observations.take(index.some))
    capture = FreeCapture(task, few, free, task.width(begin))
    weighing = Weighing.of(begin, noise)
    light = corrections.light(told)
    capture = capture.softened(State(corrections, light, begin, 0.0))
    begun = capture.fitted(corrections, begin, weighing)
    now, settled = capture.searched(begun, weighing)
    others = told._replace(observations=told.observations.take(index.held_out))
    checked = capture._replace(told=others)
    before, after = (
        checked.softened(state).above_noise(state, weighing, noise) for state in (begun, now)
    )
    absorbed = 1 - after / before if before > 0 else 1.0
    if task.settings.noise is None:
        # Less is left now than what the samples were weighed by.
        again = finish(task, few, account_of(task, few, now, free, settled))
        weighing = Weighing.of(again.stop, noise)
        begun = capture.softened(now).fitted(now.corrections, again.stop, weighing)
        now, settled = capture.searched(begun, weighing)
    found = finish(task, few, account_of(task, few, now, free, settled))
    return found._replace(absorbed=absorbed)


def finish(task: MaterialTask, told: Told, calibrated: Calibrated) -> Calibrated:
    """Fit the material to all samples, as they are corrected now."""
    corrections, before, free = calibrated.corrections, calibrated.stop, calibrated.free
    told = softened(task, told, State(corrections, calibrated.light, before, 0.0), free)
    observed, light = corrections.observations(told), corrections.light(told)
    nodes = task.nodes(light, observed, task.width(before))
    stop = descend(
        task.problem, task.integral(observed, nodes), observed, before.onward(None), task.settings
    )
    state = State(corrections, light, stop, 0.0)
    return account_of(task, told, state, free, calibrated.settled)
