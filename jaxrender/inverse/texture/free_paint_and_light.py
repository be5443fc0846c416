"""Nuisances of a capture that are found with a texture and its light, both unknown.

They are found on some pixels: one of each photograph for each of some sites.  Paint, lobe and light
answer to every step as the diagnosis lets them (:mod:`.suspicion`).  Then all of both is recovered
anew from corrected pixels.  Pixels keep their sites, so nothing is freed that moves them.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from jaxrender.inverse.calibration import (
    Columns,
    Examined,
    Pull,
    Weighing,
    calibration_of,
    check_free,
    free_what_is_named,
    search,
)
from jaxrender.inverse.calibration.search import Capture, Corrected
from jaxrender.inverse.clusters import Clusters
from jaxrender.inverse.diagnosis import Suspect
from jaxrender.inverse.diagnosis.grounds import Grounds
from jaxrender.inverse.diagnosis.scores import Leftover
from jaxrender.inverse.nuisances import NUISANCES, Corrections, Told
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.texture.estimate import TextureEstimate
from jaxrender.inverse.texture.examination import pixels_of_sites
from jaxrender.inverse.texture.suspicion import LitPixels
from jaxrender.inverse.weights import standard_deviations
from jaxrender.shapes import Float, Int

# Nuisances that are freed with paint and light: those of pixels and of normals.
FREED_WITH_LIGHT = ("exposure", "black", "response", "normals")
# What all photographs share of these, light and paint make as well.
_RELATIVE = ("exposure",)
# So many times as many pixels are looked at as causes are tested on.
_MORE, _SEED = 3, 0

# A texture and a light recovered from corrected pixels, with what was freed; judged already.
Refit = Callable[[Observations, tuple[str, ...]], TextureEstimate]


@dataclasses.dataclass(frozen=True)
class Relit(Corrected):
    """Corrections, and the paint and the light that fit some pixels best with them."""

    corrections: Corrections
    pixels: LitPixels
    suspect: Suspect
    cost: float

    @property
    def predicted(self) -> Float[np.ndarray, "sample channel"]:
        """What the pixels should be."""
        return self.suspect.predicted

    @property
    def weights(self) -> Float[np.ndarray, "sample channel"]:
        """What their residuals are multiplied by."""
        return self.suspect.derivatives(np.arange(len(self.predicted))).weights


@dataclasses.dataclass(frozen=True)
class FreePaintAndLight(Capture[Relit]):
    """Some pixels of a painted object as they were told, and what is free of the capture.

    ``weights`` are those of the values that were told.
    """

    pixels: LitPixels
    told: Told
    free: tuple[str, ...]
    weighing: Weighing
    weights: Float[np.ndarray, "sample channel"]

    def corrected(self, corrections: Corrections, before: Relit) -> Relit:
        """Let paint, lobe and light answer to pixels as they are corrected."""
        return self.answered(corrections, before.pixels)

    def answered(self, corrections: Corrections, pixels: LitPixels) -> Relit:
        """Take one step of paint, lobe and light.

        The light has the brightness that all photographs share, so their gains have the mean 1.
        """
        exposure = corrections.exposure - np.mean(corrections.exposure)
        corrections = corrections._replace(exposure=exposure)
        pixels = pixels._replace(observations=corrections.observations(self.told))
        known = self._suspect(corrections, pixels).derivatives(np.arange(len(pixels.number)))
        leftover = Leftover(known.left, known.jacobian)
        pixels = pixels.moved(known.moved(leftover.answer, -leftover.left))
        suspect = self._suspect(corrections, pixels)
        known = suspect.derivatives(np.arange(len(pixels.number)))
        left = Leftover(known.left, known.jacobian).left
        cost = self.weighing.strength * float(left @ left)
        return Relit(corrections, pixels, suspect, cost + Pull.of(corrections, *self.free).cost)

    def columns(self, state: Relit) -> Columns:
        """Differentiate by paint, lobe and light, and by all that is free."""
        every = np.arange(len(state.pixels.number))
        grounds, known = Grounds.of(state.suspect, every), state.suspect.derivatives(every)
        return Columns.of(grounds, known, state.corrections, self.free)

    def softened(self, state: Relit) -> "FreePaintAndLight":
        """Nothing is blurred."""
        return self

    def _suspect(self, corrections: Corrections, pixels: LitPixels) -> Suspect:
        # Values that are stretched have more noise.
        weights = self.weights / corrections.slopes(self.told)
        own, told = pixels.observations, self.told.observations
        return pixels.suspect(self.told.shape, told, own, self.weighing.noise, weights=weights)


def check_freed_with_light(free: tuple[str, ...] | str) -> tuple[str, ...]:
    """Refuse nuisances that are not freed with a texture and its light."""
    names = check_free(free)
    for name in names:
        if name not in FREED_WITH_LIGHT:
            raise ValueError(
                f"{name} cannot be freed with a texture under unknown light; choose of "
                f"{', '.join(FREED_WITH_LIGHT)}, or give the light"
            )
    return names


def freed_with_light(
    estimate: TextureEstimate,
    observations: Observations,
    free: tuple[str, ...] | str,
    refit: Refit,
    *,
    exact: bool,
) -> TextureEstimate:
    """Free nuisances by name, or as the diagnosis of an ``estimate`` names them.

    ``observations`` are all pixels as they were told.  Raises ``ValueError`` for a nuisance that
    there is none of, or that is not freed here.
    """
    names = check_freed_with_light(free)
    refused = tuple(name for name in NUISANCES if name not in FREED_WITH_LIGHT)
    begun = Examined(estimate, estimate.misfit, estimate.diagnosis, refused=refused)
    told = Told(observations, None, estimate.sites.shape)

    def freed(now: Examined[TextureEstimate], names: tuple[str, ...]) -> Examined[TextureEstimate]:
        return _freed(now, names, told, refit, exact)

    found = free_what_is_named(begun, freed) if free == "auto" else freed(begun, names)
    calibration, after = found.calibration, found.end
    if calibration is None:
        return after
    notes = calibration.sentences
    if free == "auto" and found.unsettled:
        notes = (*notes, found.unsettled_sentence)
    reasons = (*after.reasons, *notes)
    return dataclasses.replace(after, calibration=calibration, reasons=reasons)


def _freed(
    now: Examined[TextureEstimate],
    free: tuple[str, ...],
    told: Told,
    refit: Refit,
    exact: bool,
) -> Examined[TextureEstimate]:
    """Free some nuisances, and recover paint and light anew."""
    before, so_far, shape = now.end, now.calibration, told.shape
    corrections = Corrections.none(told) if so_far is None else so_far.corrections
    pixels = before.noise if now.misfit is None else now.misfit.noise
    observed = corrections.observations(told)
    index = _chosen(before, observed, free)
    few = told._replace(observations=told.observations.take(index))
    some = LitPixels.of(before, observed, index, exact)
    predicted = some.suspect(shape, few.observations, observed, before.noise).predicted
    weights = corrections.slopes(few) / standard_deviations(before.noise, predicted)
    weighing = Weighing.of(before.noise, pixels, predicted)
    capture = FreePaintAndLight(some, few, free, weighing, weights)
    found, settled = search(capture, capture.answered(corrections, some))
    corrections = found.corrections
    observed = corrections.observations(told)
    after = refit(observed, free)
    end = LitPixels.of(after, observed, index, exact)
    suspect = end.suspect(shape, few.observations, observed, after.noise)
    every = np.arange(len(index))
    calibration = calibration_of(
        told,
        corrections,
        Columns.of(Grounds.of(suspect, every), suspect.derivatives(every), corrections, free),
        Clusters.of(end.observations),
        settled,
        found="paint and light",
        relative=_RELATIVE,
    )
    left = [
        weighing.above_noise(one.observations, values)
        for one, values in ((some, predicted), (end, suspect.predicted))
    ]
    absorbed = 1 - left[1] / left[0] if left[0] > 0 else 1.0
    calibration = calibration._replace(absorbed=absorbed)
    after = end.reaching(after, calibration.shifts, both=True)
    return Examined(after, after.misfit, after.diagnosis, calibration)


def _chosen(
    estimate: TextureEstimate, observed: Observations, free: tuple[str, ...]
) -> Int[np.ndarray, "tested"]:
    site = estimate.sites.of_observation
    known, frame = np.flatnonzero(site >= 0), np.asarray(observed.frame)
    index = pixels_of_sites(known, site, frame, estimate.texture, _SEED, _MORE)
    if not len(index):
        raise ValueError(
            f"{free[0]} cannot be freed: no site is seen in enough photographs; give more "
            "photographs, or larger texels"
        )
    return index
