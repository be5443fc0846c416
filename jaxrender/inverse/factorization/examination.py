"""What a factorization leaves: measured, explained, and absorbed by nuisances if asked for.

Where much is left, slow light is followed farther first (``band_limits``).  Nuisances are freed as
``settings.free`` says (``inverse.calibration.automatic``).
"""

import dataclasses
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.geometry import Shape
from jaxrender.inverse.blas import one_blas_thread
from jaxrender.inverse.calibration import Examined, check_free, free_what_is_named
from jaxrender.inverse.diagnosis import diagnose
from jaxrender.inverse.diagnosis.light_parts import LightParts
from jaxrender.inverse.factorization.account import Account, account_of
from jaxrender.inverse.factorization.band_limits import followed_farther
from jaxrender.inverse.factorization.calibrate import OF_LIGHT, Calibrated, absorbed, calibrate
from jaxrender.inverse.factorization.free_capture import Lit
from jaxrender.inverse.factorization.prediction import predict
from jaxrender.inverse.factorization.rounds import settle
from jaxrender.inverse.factorization.state import Round, State, Task, in_deviations
from jaxrender.inverse.factorization.suspicion import Found, Photographs, suspect_of
from jaxrender.inverse.factorization.widths import may_be_wide, pays, with_widths
from jaxrender.inverse.misfit import Left, Misfit, measure_misfit, rows_of_three
from jaxrender.inverse.nuisances import Corrections, Told
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.shadowing import concave
from jaxrender.shapes import Float

# So many rows of three neighbouring pixels tell the noise.  The light is a sum of few degrees and
# sources: less of the radiance than this it may leave without being wrong.
_ROWS, _LEAST_MISFIT = 1000, 0.01
# Where more of chi-squared than this is no noise, slow light is tried to more degrees.
_WORTH_FOLLOWING, _GROSS = 0.1, 0.5


class Asked(NamedTuple):
    """What is told and asked beside the samples, and how stages and rounds are announced.

    ``told`` are the samples as they were told, ``pool`` all pixels; None where nobody gives them.
    """

    gauge: str
    told: Told
    pool: Observations | None
    stage: Callable[[str], AbstractContextManager]
    watch: Callable[[Round], None]

    @property
    def shape(self) -> Shape | None:
        """The shape, where it is known."""
        return self.told.shape


class End(NamedTuple):
    """Where a search ended: material and light in a gauge, and what was freed along with them.

    ``coarse`` is the end before slow light was followed farther, where it was.
    """

    task: Task
    state: State
    account: Account
    brdf: Parametric
    gauge: str
    calibrated: Calibrated | None = None
    coarse: "End | None" = None

    @classmethod
    def of(
        cls, task: Task, state: State, asked: Asked, calibrated: Calibrated | None = None
    ) -> "End":
        """Put material and light into the gauge."""
        with asked.stage("account"):
            account = account_of(task, state, asked.gauge)
        value = account.parameters.value
        lobe = task.response.variant.with_numbers(
            {name: float(number) for name, number in value.numbers.items()}
        )
        brdf = lobe.with_amplitudes(*value.in_order(lobe.amplitude_names))
        return cls(task, state, account, brdf, asked.gauge, calibrated)

    @classmethod
    def calibrated_of(cls, found: Calibrated, asked: Asked) -> "End":
        """Put material and light that were found with corrections into the gauge."""
        return cls.of(found.lit.task, found.lit.state, asked, found)

    @property
    def predicted(self) -> Float[np.ndarray, "sample channel"]:
        """What the samples should be."""
        assert self.state.joint is not None
        return np.asarray(self.state.joint.solved.predicted)

    @property
    def relative_rms(self) -> float:
        """What is left, relative to the photographs."""
        return self.state.rounds[-1].relative_rms

    def lit(self, told: Told) -> Lit:
        """Say what goes on from here: corrections, with material and light."""
        corrections = Corrections.none(told)
        if self.calibrated is not None:
            corrections = self.calibrated.lit.corrections
        return Lit(corrections, self.task, self.state, 0.0)


def examine(task: Task, state: State, asked: Asked) -> Examined[End]:
    """Examine a factorization, and free nuisances as the settings say.

    Raises ``ValueError`` for a nuisance that there is none of, or that the photographs leave no
    room for.
    """
    free, begun = task.settings.free, Examined(End.of(task, state, asked), refused=OF_LIGHT)
    if free == "auto":
        return free_what_is_named(
            _explained(_with_widths(_followed(begun, asked), asked), asked),
            lambda now, names: _explained(_freed(now, asked, names), asked),
        )
    if free:
        return _explained(_freed(_measured(begun, asked), asked, check_free(free)), asked)
    return _explained(_with_widths(_followed(begun, asked), asked), asked)


def _freed(examined: Examined[End], asked: Asked, free: tuple[str, ...]) -> Examined[End]:
    """Free some nuisances: under light of few degrees first, and farther where that pays."""
    end, pixels = examined.end, in_deviations(examined.end.task, examined.end.state).noise
    if examined.misfit is not None:
        pixels = examined.misfit.noise
    begin, told = end.coarse or end, asked.told
    if end.calibrated is not None:
        told = end.calibrated.told
    with asked.stage("calibration"), one_blas_thread():
        found = calibrate(told, begin.lit(told), free, pixels, asked.watch, anew=True)
        found = calibrate(found.told, found.lit, free, pixels, asked.watch, anew=False)
    after = _followed(Examined(End.calibrated_of(found, asked)), asked)
    if after.end.coarse is not None:
        with asked.stage("calibration"), one_blas_thread():
            finer = after.end.lit(told)
            found = calibrate(found.told, finer, free, pixels, asked.watch, anew=False)
        end_now = End.calibrated_of(found, asked)._replace(coarse=after.end.coarse)
        after = _measured(Examined(end_now), asked)
    with asked.stage("calibration"):
        calibration = found.account(asked.gauge)._replace(
            absorbed=absorbed(end.lit(told), found.lit, pixels)
        )
    return dataclasses.replace(after, calibration=calibration)


def _followed(examined: Examined[End], asked: Asked) -> Examined[End]:
    """Measure what is left, and follow slow light farther where much is, and where that pays."""
    examined = _measured(examined, asked)
    misfit, end = examined.misfit, examined.end
    if misfit is None or misfit.share < _WORTH_FOLLOWING:
        return examined
    with asked.stage("refine"), one_blas_thread():
        # What is gross is hardly the light's.
        excess = 1 / (1 - min(misfit.share, _GROSS))
        farther = followed_farther(end.task, end.state, concave(asked.shape), excess)
        if farther is None:
            return examined
        task, state = farther[0], settle(*farther, asked.watch)
    there = End.of(task, state, asked, end.calibrated)._replace(coarse=end)
    again = _measured(dataclasses.replace(examined, end=there), asked)
    return again if again.end.relative_rms < end.relative_rms else examined


def _with_widths(examined: Examined[End], asked: Asked) -> Examined[End]:
    """Give sources a width, where that pays."""
    end = examined.end
    with asked.stage("refine"), one_blas_thread():
        if not may_be_wide(end.task, end.state):
            return examined
        state = settle(end.task, with_widths(end.state), asked.watch)
        if not pays(end.task, end.state, state):
            return examined
    there = End.of(end.task, state, asked, end.calibrated)._replace(coarse=end.coarse or end)
    return _measured(dataclasses.replace(examined, end=there), asked)


def _measured(examined: Examined[End], asked: Asked) -> Examined[End]:
    """Measure the noise between neighbouring pixels, and what is left above it."""
    if asked.pool is None:
        return examined
    with asked.stage("misfit"):
        return dataclasses.replace(examined, misfit=_misfit(examined.end, asked.pool, asked))


def _misfit(end: End, pool: Observations, asked: Asked) -> Misfit | None:
    rows = rows_of_three(pool, _ROWS, 0)
    neighbours = None
    if len(rows):
        some = pool.take(rows.ravel())
        if end.calibrated is not None:
            near_by = asked.told._replace(observations=some)
            lit, free = end.lit(asked.told), end.calibrated.free
            some = lit.corrections.observations(lit.softened(near_by, free))
            some = some._replace(transfer=None)
        neighbours = Left(some, predict(end.brdf, end.account.scene, some, asked.shape))
    fitted = Left(end.task.observations, end.predicted)
    return measure_misfit(fitted, neighbours, None, least=_LEAST_MISFIT)


def _explained(examined: Examined[End], asked: Asked) -> Examined[End]:
    """Say what would explain the rest."""
    end, misfit, pool = examined.end, examined.misfit, asked.pool
    if pool is None or misfit is None or not end.task.settings.diagnose:
        return examined
    with asked.stage("diagnosis"):
        scene = end.account.scene
        found = Found(end.brdf, LightParts.found(scene.slow, scene.points), asked.gauge)
        told = asked.told.observations
        photographs = Photographs(told, pool, asked.shape, examined.freed)
        suspect = suspect_of(end.task, end.state, found, photographs)
        return dataclasses.replace(examined, diagnosis=diagnose(suspect, misfit))
