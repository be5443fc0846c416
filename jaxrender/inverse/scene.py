"""A scene and its estimate: light, material and shape, and what of them photographs are to tell.

    scene = Scene(unknown("ggx", sigma=(0.02, 0.5)), shape, light)
    estimate = fit(scene, capture)

A material may be unknown with bounds, values or nothing stated of its numbers; a light that is left
out is unknown.  What is known of either, the fit is told; what it cannot honour is refused.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from jaxrender.brdf import Parametric, lobe_named
from jaxrender.catalogue import MODELS, Number
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
from jaxrender.inverse.unknowns import Unknowns, unknowns_of
from jaxrender.lighting import DirectionalSources, HarmonicLight, Light
from jaxrender.shapes import Float

# So many samples of the pixels are fitted.
_SAMPLES = 12_000
_CHANNELS = 3
# Where one of these was freed, the light found is not that of the scene.
_OF_THE_LIGHT = {"environment", "lamps"}


class UnknownMaterial(NamedTuple):
    """A material to be found: its model, and what is stated of its numbers.

    ``model`` is a name of the catalogue, or "" of a model of one's own.  ``table`` asks for a
    table that corrects the model.
    """

    model: str
    lobe: Parametric
    stated: Mapping[str, Stated]
    ks_per_channel: bool = False
    table: bool = False

    def unknowns(self, free_gains: int = 0, free_scale: bool = False) -> Unknowns:
        """Put this in the words of a search.  Raises ``ValueError`` as ``unknowns_of`` does."""
        return unknowns_of(
            self.lobe,
            self.stated,
            diffuse=self.model == "lambertian",
            ks_per_channel=self.ks_per_channel,
            free_gains=free_gains,
            free_scale=free_scale,
        )


def unknown(
    model: str | Parametric, *, ks_per_channel: bool = False, table: bool = False, **numbers: Any
) -> UnknownMaterial:
    """Say what you know of a material, by the numbers of its model; what is left out is free.

    Each of ``numbers`` is a value (one, or one for each of three channels), a pair of bounds,
    ``Stated`` with a start or a prior besides, or None for an index that a metal has none of.
    What a model states or chooses (``c_z``, ``masking``) is a value.  ``model`` is a name, or a
    material of a model of one's own, whose numbers do not matter.  ``table=True`` corrects what is
    found by a table over half and difference angles.

    Raises ``ValueError`` for a model, a number or a choice that there is none of.
    """
    if isinstance(model, Parametric):
        material = UnknownMaterial("", model, _stated(numbers), ks_per_channel, table)
    else:
        entry = MODELS.get(model)
        chosen = () if entry is None else (*entry.options, *entry.names("stated"))
        choices = {name: numbers.pop(name) for name in chosen if name in numbers}
        without = [name for name, value in numbers.items() if value is None]
        lobe = lobe_named(model, metal=bool(without), **choices)
        for name in without:
            if not (lobe.has_index() and lobe.index.name == name):
                raise ValueError(f"{name}=None: only an index may be left out, by a metal")
            del numbers[name]
        stated = _stated(numbers)
        for number in MODELS[model].numbers:
            if number.name in stated:
                _check_domain(number, stated[number.name])
        material = UnknownMaterial(model, lobe, stated, ks_per_channel, table)
    for name, one in material.stated.items():
        linear = name in material.lobe.amplitude_names
        if linear and one.start is not None:
            raise ValueError(f"{name} is solved for outright, from no start; leave it out")
        several = linear and (name in material.lobe.coloured or ks_per_channel)
        if isinstance(one.fixed, tuple) and len(one.fixed) > 1 and not several:
            hint = ", or ks_per_channel=True" if linear else ""
            raise ValueError(f"{name} is one number for all channels; give one{hint}")
    material.unknowns()
    return material


def _check_domain(number: Number, stated: Stated) -> None:
    """Refuse what lies outside the interval of a model's number."""
    mean = None if stated.prior is None else stated.prior.mean
    given = (stated.fixed, stated.start, mean, *(stated.bounds or ()))
    for value in (float(v) for part in given if part is not None for v in np.atleast_1d(part)):
        if not number.domain.holds(value):
            raise ValueError(f"{number.name}={value:g}: it must be {number.domain.words}")


def _stated(numbers: Mapping[str, Any]) -> dict[str, Stated]:
    """Read what is stated of each number."""
    found = {}
    for name, value in numbers.items():
        if isinstance(value, Stated):
            found[name] = value
            continue
        values = tuple(float(part) for part in np.atleast_1d(np.asarray(value, float)))
        if len(values) not in (1, 2, _CHANNELS):
            raise ValueError(f"{name} has {len(values)} values; give one, two bounds, or three")
        if len(values) == 2:
            low, high = values
            if not low < high:
                raise ValueError(f"{name} has the bounds {values}; the first must be the smaller")
            found[name] = Stated(bounds=(low, high))
        else:
            found[name] = Stated(fixed=values)
    return found


class Scene(NamedTuple):
    """What photographs are of.

    ``light`` None: it is unknown, and found with the material.  ``per_frame`` are sources of single
    photographs.  ``free_exposure`` says that exposures are unknown, ``free_scale`` that the light
    is known up to one factor.
    """

    material: UnknownMaterial
    shape: Shape
    light: Light | None = None
    per_frame: tuple[DirectionalSources, ...] | None = None
    free_exposure: bool = False
    free_scale: bool = False


def fit(
    scene: Scene,
    photographs: LoadedCapture | Observations,
    settings: FitSettings | FactorSettings | None = None,
    count: int = _SAMPLES,
    seed: int = 0,
) -> Estimate:
    """Find what is unknown of a scene from photographs of it (T 6.4).

    Of all usable pixels ``count`` are drawn, where they tell most.  ``settings`` are
    ``FactorSettings`` where the light is unknown, else ``FitSettings``.

    Raises ``ValueError`` for settings of the other kind, for what an unknown light leaves no room
    for, and as ``fit_brdf`` and ``factorize`` do; ``InputError`` for photographs that no fit can
    use.
    """
    dark = scene.light is None and scene.per_frame is None
    if dark and isinstance(settings, FitSettings):
        raise ValueError("FitSettings are for a known light; give FactorSettings")
    if not dark and isinstance(settings, FactorSettings):
        raise ValueError("FactorSettings are for an unknown light; give FitSettings")
    notes: list[str] = []
    if isinstance(photographs, Observations):
        pool = photographs
    else:
        seen = photographs.photographs(scene.shape, Listener(notes.append))
        pool = observations_of(seen)
        if scene.per_frame is not None:
            # A photograph may have been skipped; the lights of the others are still their own.
            capture, lights = photographs.capture, scene.per_frame
            _check_lights(lights, len(capture.frames))
            kept = capture.numbers_of(photograph.frame.name for photograph in seen)
            scene = scene._replace(per_frame=tuple(lights[number] for number in kept))
    estimate = _found(scene, pool, settings, (count, seed))
    return estimate._replace(reasons=(*estimate.reasons, *notes))


def _found(
    scene: Scene,
    pool: Observations,
    settings: FitSettings | FactorSettings | None,
    draws: tuple[int, int],
) -> Estimate:
    """Choose the fit by whether the light is known."""
    dark = scene.light is None and scene.per_frame is None
    if isinstance(settings, FactorSettings) or (dark and settings is None):
        return _with_the_light(scene, pool, settings or FactorSettings(), draws)
    return _under_known_light(scene, pool, settings or FitSettings(), draws)


def _under_known_light(
    scene: Scene, pool: Observations, settings: FitSettings, draws: tuple[int, int]
) -> Estimate:
    """Find the material, and what else is unknown of the photographs."""
    if scene.light is None:
        known = KnownLight(None, DirectionalSources.none(pool.radiance.shape[1]), scene.per_frame)
    else:
        known = KnownLight.of(scene.light, scene.per_frame)
    frames = int(np.max(np.asarray(pool.frame), initial=-1)) + 1
    if known.per_frame is not None:
        _check_lights(known.per_frame, frames)
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
    light = scene.light or known.directional
    if found.calibration is not None and _OF_THE_LIGHT & set(found.calibration.free):
        light = found.calibration.light.shared
    estimate = _estimate(material, found, light, found.noise, found.final.relative_rms)
    if not material.table:
        return estimate
    correction = correct_by_table(found, known, settings, shape=scene.shape, pool=pool)
    return estimate._replace(correction=correction)


def _check_lights(per_frame: tuple[DirectionalSources, ...], photographs: int) -> None:
    if len(per_frame) < photographs:
        raise ValueError(
            f"per_frame lights {len(per_frame)} photographs of {photographs}; give each its sources"
        )


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
    light = HarmonicLight(found.scene.slow) + found.scene.sources
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
