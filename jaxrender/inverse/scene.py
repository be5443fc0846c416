"""A scene and its estimate: light, material and shape, and what of them photographs are to tell.

    scene = Scene(unknown("ggx", sigma=(0.02, 0.5)), shape, light)
    estimate = fit(scene, capture)

A material may be unknown with bounds, values or nothing stated of its numbers; a light that is left
out is unknown.  What is known of either, the fit is told; what it cannot honour is refused.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxrender.catalogue import MODELS
from jaxrender.geometry import Shape
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.brdf import BRDFFit, fit_brdf
from jaxrender.inverse.brdf_table import check_correctable, correct_by_table
from jaxrender.inverse.estimate import Estimate
from jaxrender.inverse.factorization import (
    Factorization,
    FactorSettings,
    factorize,
    in_units_of,
    known_of,
    reflectances_of,
)
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.leverage import draw, leverage, sharpness
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.own_words import OwnWords
from jaxrender.inverse.passes import FitSettings
from jaxrender.inverse.photographs import Listener, LoadedCapture, observations_of
from jaxrender.inverse.shadowing import with_transfer
from jaxrender.inverse.stated import Stated
from jaxrender.inverse.unknown_material import UnknownMaterial
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.lighting import DirectionalSources, HarmonicLight, Light
from jaxrender.shapes import Float

# So many samples of the pixels are fitted.
_SAMPLES = 12_000
# Where one of these was freed, the light found is not that of the scene.
_OF_THE_LIGHT = {"environment", "lamps"}


class Scene(NamedTuple):
    """What photographs are of.

    ``light`` None: it is unknown, and found with the material.  Several captures have a light each.
    ``per_frame`` are sources of single photographs, those of all captures in turn.
    ``free_exposure`` says that exposures are unknown, ``free_scale`` that the light is known up to
    one factor.
    """

    material: UnknownMaterial
    shape: Shape
    light: Light | tuple[Light, ...] | None = None
    per_frame: tuple[Light, ...] | None = None
    free_exposure: bool = False
    free_scale: bool = False

    @property
    def dark(self) -> bool:
        """Whether the light is unknown."""
        return self.light is None and self.per_frame is None

    def known_light(self, photographs: Sequence[int], channels: int) -> KnownLight:
        """Put together what lights captures of so many photographs each.

        Raises ``ValueError`` for another number of lights, for fewer sources than photographs, and
        as ``KnownLight.of`` does.
        """
        none, per_frame = DirectionalSources.none(channels), self.per_frame
        lights = self.light if isinstance(self.light, tuple) else (self.light or none,)
        if len(lights) == 1:
            # One light may be that of several captures.
            photographs = [sum(photographs)]
        if len(lights) != len(photographs):
            raise ValueError(
                f"{len(lights)} lights for {len(photographs)} captures; give each capture its light"
            )
        if per_frame is not None and len(per_frame) < sum(photographs):
            raise ValueError(
                f"per_frame lights {len(per_frame)} photographs of {sum(photographs)}; give each "
                "its sources"
            )
        known, first = [], 0
        for light, count in zip(lights, photographs):
            own = None if per_frame is None else per_frame[first : first + count]
            known.append(KnownLight.of(light, own, shape=self.shape))
            first += count
        return KnownLight.joined(known, photographs)


def fit(
    scene: Scene,
    photographs: LoadedCapture | Sequence[LoadedCapture] | Observations,
    settings: FitSettings | FactorSettings | None = None,
    count: int = _SAMPLES,
    seed: int = 0,
) -> Estimate:
    """Find what is unknown of a scene from photographs of it (T 6.4).

    ``photographs`` may be several captures of the object, each with its own light in the scene.
    For each capture ``count`` of the usable pixels are drawn, where they tell most, and as many are
    refined as the settings say.  ``settings`` are ``FactorSettings`` where the light is unknown,
    else ``FitSettings``.

    Raises ``ValueError`` for settings of the other kind, for what an unknown light leaves no room
    for, as ``Scene.known_light`` does, and as ``fit_brdf`` and ``factorize`` do; ``InputError`` for
    photographs that no fit can use.
    """
    if scene.dark and isinstance(settings, FitSettings):
        raise ValueError("FitSettings are for a known light; give FactorSettings")
    if not scene.dark and isinstance(settings, FactorSettings):
        raise ValueError("FactorSettings are for an unknown light; give FitSettings")
    notes: list[str] = []
    light, times = None, 1
    if isinstance(photographs, Observations):
        pool = photographs
        if not scene.dark:
            light = scene.known_light([pool.frames], pool.radiance.shape[1])
    else:
        captures = [photographs] if isinstance(photographs, LoadedCapture) else [*photographs]
        if not captures:
            raise ValueError("no photographs; give at least one capture")
        times = len(captures)
        if scene.dark and times > 1:
            raise ValueError(
                f"{times} captures under unknown light; one light is found: give each "
                "capture its light, or fit one of them"
            )
        seen = [one.photographs(scene.shape, Listener(notes.append)) for one in captures]
        pool = observations_of([photograph for own in seen for photograph in own])
        if not scene.dark:
            counts = [len(one.capture.frames) for one in captures]
            light = scene.known_light(counts, pool.radiance.shape[1])
            # A photograph may have been skipped; the lights of the others are still their own.
            kept, first = [], 0
            for one, own in zip(captures, seen):
                names = (photograph.frame.name for photograph in own)
                kept += [first + number for number in one.capture.numbers_of(names)]
                first += len(one.capture.frames)
            light = light.of_frames(kept)
    if light is None:
        assert not isinstance(settings, FitSettings)
        found = _with_the_light(scene, pool, settings or FactorSettings(), (count, seed))
    else:
        assert not isinstance(settings, FactorSettings)
        settings = settings or FitSettings()
        settings = settings._replace(refine_samples=times * settings.refine_samples)
        found = _under_known_light(scene, pool, light, settings, (times * count, seed))
    return found._replace(reasons=(*found.reasons, *notes))


def _under_known_light(
    scene: Scene,
    pool: Observations,
    known: KnownLight,
    settings: FitSettings,
    draws: tuple[int, int],
) -> Estimate:
    """Find the material, and what else is unknown of the photographs."""
    frames = int(np.max(np.asarray(pool.frame), initial=-1)) + 1
    material = scene.material
    if material.table:
        # Before the fit, which takes longer.
        check_correctable(pool, material.lobe)
    unknowns = material.unknowns(frames if scene.free_exposure else 0, scene.free_scale)
    drawn = draw(pool, leverage(pool, known), *draws).observations
    convex = scene.shape.is_convex()
    if not convex:
        drawn = with_transfer(drawn, scene.shape, known.diffuse_degrees)
    found = fit_brdf(
        drawn,
        known,
        unknowns,
        material.lobe,
        settings,
        shape=scene.shape,
        pool=pool,
    )
    first = scene.light[0] if isinstance(scene.light, tuple) else scene.light
    # Sources that have a place are shown as the object's centre sees them.
    light = known.shared if known.near is not None else first or known.directional
    if found.calibration is not None and _OF_THE_LIGHT & set(found.calibration.free):
        freed = found.calibration.light
        light = (freed if freed.environments is None else freed.of_frame(0)).shared
    estimate = _estimate(material, found, light, found.noise, found.final.relative_rms)
    if not material.table:
        return estimate
    correction = correct_by_table(found, known, settings, shape=scene.shape, pool=pool)
    return estimate._replace(correction=correction)


def _with_the_light(
    scene: Scene, pool: Observations, settings: FactorSettings, draws: tuple[int, int]
) -> Estimate:
    """Find light and material together."""
    if scene.free_exposure or scene.free_scale:
        raise ValueError(
            "under unknown light exposures are to be known, and its scale is found; leave out "
            "free_exposure and free_scale"
        )
    material = scene.material
    if material.table:
        raise ValueError("a table corrects a material under known light; leave table out")
    unknowns = material.unknowns()
    channels = pool.radiance.shape[1]
    diffuse = material.model in MODELS and not MODELS[material.model].has_specular
    _check_ratio(material, unknowns, diffuse)
    known = known_of(unknowns, material.lobe, channels, diffuse=diffuse)
    drawn = draw(pool, sharpness(pool), *draws).observations
    found = factorize(drawn, material.lobe, settings, known, shape=scene.shape, pool=pool)
    given = reflectances_of(unknowns, channels)
    if given is not None:
        found = in_units_of(found, *given)
    light = HarmonicLight(found.scene.slow) + found.scene.points
    return _estimate(material, found, light, found.noise, found.relative_rms)


def _check_ratio(material: UnknownMaterial, unknowns: Unknowns, diffuse: bool) -> None:
    """Refuse what an unknown light leaves no room for: all but the ratio of kd and ks."""
    for name in material.lobe.amplitude_names:
        if material.stated.get(name, Stated()).bounds is not None:
            raise ValueError(
                f"{name} has bounds; under unknown light only the ratio of kd and ks is found: "
                "leave it free, or give kd and ks"
            )
    if not diffuse and 0 < len(unknowns.free_amplitudes) < len(unknowns.amplitudes):
        raise ValueError(
            "under unknown light only the ratio of kd and ks means anything; give both or none"
        )
    if material.ks_per_channel and unknowns.free_amplitudes:
        raise ValueError(
            "under unknown light each channel has its own ks anyway; leave ks_per_channel out"
        )


def _estimate(
    material: UnknownMaterial,
    found: BRDFFit | Factorization,
    light: Light,
    noise: NoiseModel,
    relative_rms: float,
) -> Estimate:
    """Say what was found by the model's own numbers."""
    words = OwnWords(material.model, found.brdf)
    own = found.parameters.summed(found.brdf.sums)

    def numbers(plain: dict[str, Any]) -> dict[str, Float[np.ndarray, "..."]]:
        return {name: np.asarray(value) for name, value in plain.items()}

    return Estimate(
        material.model,
        found.brdf,
        light,
        numbers(words.values(own.value)),
        numbers(words.values(own.standard_error)),
        numbers(words.intervals(own.lower, own.upper)),
        dict(found.identifiable),
        found.outcome,
        found.reasons,
        noise,
        relative_rms,
        found,
    )
