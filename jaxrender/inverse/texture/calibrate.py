"""What is freed of a capture with a texture under known light, by name or as the diagnosis names.

Corrections are found on some pixels; then all of the texture is fitted anew to corrected pixels.
Where these move, they are given sites anew, and the search goes on from there.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.calibration import (
    Examined,
    Weighing,
    calibration_of,
    check_free,
    free_what_is_named,
    search,
)
from jaxrender.inverse.clusters import Clusters
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.nuisances import NUISANCES, Corrections, Told
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.texture.account import TextureFit
from jaxrender.inverse.texture.examination import (
    Painted,
    Tested,
    chosen_pixels,
    examined,
    reaching,
)
from jaxrender.inverse.texture.free_capture import MOVING, NEVER, FreePaint, columns_of
from jaxrender.inverse.texture.rounds import TextureSettings
from jaxrender.inverse.texture.search import TextureProblem
from jaxrender.inverse.texture.site_systems import SpecularPrior
from jaxrender.inverse.texture.sites import SurfaceSites
from jaxrender.inverse.weights import standard_deviations
from jaxrender.shapes import Int

# What all photographs share of these, the paint makes as well.
_RELATIVE = ("exposure",)
# Where pixels move, so many times more of them are looked at: each camera has its own.
_MORE = 3
# They are moved until fewer than this part of them change their sites, at most so often.
_STAY, _MOVES = 0.02, 4


class End(NamedTuple):
    """A texture, and the photographs that it was fitted to."""

    painted: Painted
    fit: TextureFit


# A texture fitted to photographs, whose pixels show given sites, under a light; not examined yet.
Refit = Callable[[Observations, Int[np.ndarray, "sample"], KnownLight], End]


def recovered(
    observations: Observations,
    site: Int[np.ndarray, "sample"],
    light: KnownLight,
    refit: Refit,
    settings: TextureSettings,
    sites: SurfaceSites | None = None,
) -> TextureFit:
    """Fit a texture, examine what it leaves, and free nuisances as the settings say.

    ``sites`` tell which site a pixel shows that is moved; without them none is.  Raises
    ``ValueError`` for a nuisance that there is none of, or that a texture does not free.
    """
    check_freed_with_texture(check_free(settings.free), sites)
    end = refit(observations, site, light)
    told = Told(end.painted.observations, light, end.painted.shape)
    if not settings.free:
        return _examined(end, settings)
    begun = Examined(end, refused=NEVER if sites is not None else (*NEVER, *MOVING))

    def shown(corrections: Corrections, observed: Observations) -> Int[np.ndarray, "sample"]:
        if sites is None or not corrections.moves_rays:
            return site
        assert observed.places is not None
        return sites.showing(observed.places)

    def again(corrections: Corrections) -> End:
        observed = corrections.observations(told)
        own = np.where(observed.pixels > 0, shown(corrections, observed), -1)
        return refit(observed, own, corrections.light(told).upright)

    def freed(now: Examined[End], names: tuple[str, ...]) -> Examined[End]:
        return _freed(now, names, told, again, settings)

    if settings.free == "auto":
        fit = _examined(end, settings)
        begun = dataclasses.replace(
            begun, end=end._replace(fit=fit), misfit=fit.misfit, diagnosis=fit.diagnosis
        )
        found = free_what_is_named(begun, freed)
    else:
        found = freed(begun, check_free(settings.free))
    fit, calibration = found.end.fit, found.calibration
    if calibration is None:
        return fit
    notes = calibration.sentences
    if settings.free == "auto" and found.unsettled:
        notes = (*notes, found.unsettled_sentence)
    return fit._replace(calibration=calibration, reasons=(*fit.reasons, *notes))


def check_freed_with_texture(free: tuple[str, ...], sites: SurfaceSites | None) -> None:
    """Refuse nuisances that a texture does not free."""
    for name in free:
        if name in NEVER:
            raise ValueError(
                f"{name} cannot be freed with a texture; choose of "
                f"{', '.join(other for other in NUISANCES if other not in NEVER)}"
            )
        if name in MOVING and sites is None:
            raise ValueError(
                f"{name} cannot be freed: nobody says which site a pixel shows that is moved; give "
                "the surface's sites"
            )


def _examined(end: End, settings: TextureSettings) -> TextureFit:
    return examined(end.painted, end.fit, settings.noise is not None, settings.diagnose)


def _freed(
    now: Examined[End],
    free: tuple[str, ...],
    told: Told,
    again: Callable[[Corrections], End],
    settings: TextureSettings,
) -> Examined[End]:
    """Free some nuisances, and fit the texture anew."""
    before, so_far = now.end, now.calibration
    corrections = Corrections.none(told) if so_far is None else so_far.corrections
    moving = bool(MOVING & {*free})
    times = _MORE if moving else 1
    pixels = before.fit.noise if now.misfit is None else now.misfit.noise
    after, settled = before, False
    for _ in range(_MOVES if moving else 1):
        index = chosen_pixels(after.painted, after.fit, times)
        if not len(index):
            raise ValueError(
                f"{free[0]} cannot be freed: no site is seen in enough photographs; give more "
                "photographs, or larger texels"
            )
        further, settled = _search(after, index, told, free, pixels, corrections)
        last, after = after, again(further)
        # Beside an edge of two paints, pixels that were moved may fit worse at their new sites.
        if last is not before and _left(after) > _left(last):
            after = last
            break
        corrections = further
        if np.mean(after.painted.site != last.painted.site) < _STAY:
            break
    painted = after.painted._replace(freed=free, told=told.observations)
    index = chosen_pixels(painted, after.fit, times)
    some = Tested.of(painted, after.fit, index)
    calibration = calibration_of(
        told,
        corrections,
        columns_of(painted, some, corrections, free, after.fit.noise),
        Clusters.of(painted.observations.take(index)),
        settled,
        found="the paint",
        relative=_RELATIVE,
    )
    calibration = calibration._replace(absorbed=_absorbed(before, after, pixels))
    wider = reaching(after.fit, calibration.shifts, some, both=True)
    fit = _examined(End(painted, wider), settings)
    return Examined(End(painted, fit), fit.misfit, fit.diagnosis, calibration)


def _search(
    before: End,
    index: Int[np.ndarray, "sample"],
    told: Told,
    free: tuple[str, ...],
    pixels: NoiseModel,
    corrections: Corrections,
) -> tuple[Corrections, bool]:
    """Find corrections on some pixels; say whether they have settled."""
    painted, fit = before
    assert isinstance(fit.prior, SpecularPrior)
    few = told._replace(observations=told.observations.take(index))
    predicted = painted.predicted(fit)[index]
    weights = corrections.slopes(few) / standard_deviations(fit.noise, predicted)
    capture = FreePaint(
        painted,
        Tested.of(painted, fit, index),
        TextureProblem(fit.lobe.unknowns, fit.prior, np.asarray(False)),
        few,
        free,
        Weighing.of(fit.noise, pixels, predicted),
        weights,
        fit.sigma,
    )
    found, settled = search(capture, capture.fitted(corrections, fit.lobe.point))
    return found.corrections, settled


def _left(end: End) -> float:
    return end.fit.texture.relative_rms


def _absorbed(before: End, after: End, pixels: NoiseModel) -> float:
    """Say which part of chi-squared above the noise of single pixels corrections do away with."""
    index = chosen_pixels(*before)
    predicted = [one.painted.predicted(one.fit)[index] for one in (before, after)]
    weighing = Weighing.of(before.fit.noise, pixels, predicted[0])
    left = [
        weighing.above_noise(one.painted.observations.take(index), values)
        for one, values in zip((before, after), predicted)
    ]
    return 1 - left[1] / left[0] if left[0] > 0 else 1.0
