"""How cameras, mesh and light of a config are meant, and what its keys should say."""

from typing import Any, NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry import Shape
from jaxrender.inverse import KnownLight
from jaxrender.inverse.conventions import (
    FoundFraming,
    FoundOrientation,
    Framing,
    Known,
    Orientation,
    Silhouettes,
    find_framing,
    find_orientation,
)
from jaxrender.inverse.photographs import (
    Photograph,
    Reading,
    mirrored_image,
    observations_of,
    posed,
    read_photographs,
    trace_photographs,
)
from jaxrender.io import Capture, Image, read_image
from jaxrender.io.images import MEND
from jaxrender.pipelines.captures import capture_of, reading_of
from jaxrender.pipelines.check.mend import Place, with_changes
from jaxrender.pipelines.check.places import FoundPlace, find_place, placement_of, rounded
from jaxrender.pipelines.config import CaptureConfig, FurtherCaptureConfig, RunConfig
from jaxrender.pipelines.config.geometry import GeometryConfig
from jaxrender.pipelines.config.lighting import CaptureLightingConfig
from jaxrender.pipelines.scene import fault_of, known_light, lobe_of, shape_of

# Yaws are written to this many degrees.
_YAW_STEP = 0.5
# Where silhouettes overlap less than this, the object lies elsewhere.
SNUG = 0.85
# So many framings that the silhouettes cannot tell apart are lit.
_LIT = 4
# A framing is told from another by the light where the other leaves this much more.
_LEAST_RATIO = 1.2


class RawCapture(NamedTuple):
    """Photographs and cameras as the files have them, whatever the config says of axes."""

    capture: Capture
    images: list[Image]
    reading: Reading
    place: Place

    @classmethod
    def of(cls, config: RunConfig, number: int) -> "RawCapture":
        """Read the first capture, or a further one, with its pictures."""
        stated: CaptureConfig | FurtherCaptureConfig = config.capture
        place: Place = ("capture",)
        if number:
            stated, place = config.captures[number - 1], ("captures", number - 1)
        raw = capture_of(stated.model_copy(update={"camera_axes": "opengl"}))
        reading = reading_of(stated, float(config.samples.min_cosine))._replace(mirrored=False)
        return cls(raw, read_photographs(raw, reading), reading, place)

    def meant(self, framing: Framing, shape: Shape) -> list[Photograph]:
        """Trace the photographs as a framing means them, of a shape that is placed so."""
        images = self.images
        if framing.mirrored:
            images = [mirrored_image(image) for image in images]
        reading = self.reading._replace(mirrored=framing.mirrored)
        return trace_photographs(posed(self.capture, framing.axes), images, shape, reading)


class FoundConventions(NamedTuple):
    """What was found of one capture, and what the keys of its config should say instead."""

    framing: FoundFraming | None
    orientation: FoundOrientation | None
    changes: dict[Place, Any]
    sentences: list[str]
    by_light: bool = False


def told_framing(stated: CaptureConfig | FurtherCaptureConfig) -> Framing:
    """Say how a config says that a capture is meant."""
    return Framing(stated.camera_axes, stated.mirrored)


def find_conventions(config: RunConfig, raw: RawCapture) -> FoundConventions:
    """Find how one capture is meant: axes, unit and mirrors by silhouettes, its light by a fit.

    Of further captures the shape is taken as it is told.
    """
    assert config.capture.geometry is not None
    geometry, shape = config.capture.geometry, shape_of(config.capture.geometry)
    first = raw.place == ("capture",)
    stated = config.capture if first else config.captures[int(raw.place[1])]
    silhouettes = Silhouettes.of(raw.capture, raw.images, raw.reading)
    if not silhouettes.names:
        said = f"{place_of(raw)}: no photograph shows a silhouette; give masks or alpha channels"
        return FoundConventions(None, None, {}, [said])
    framing = find_framing(shape, silhouettes, told_framing(stated), placement_of(geometry))
    orientation, by_light = None, False
    if framing.overlap < SNUG:
        placed = find_place(config, silhouettes, framing)
        if placed is not None:
            return _placed(config, raw, framing, placed)
    if framing.fits:
        framing, orientation, by_light = _lit(config, raw, framing)
    changes = _framing_changes(geometry, framing, raw.place) if framing.fits else {}
    if not first:
        changes = {place: value for place, value in changes.items() if place[0] == "captures"}
    sentences = framing.sentences()
    if by_light:
        sentences.append(f"{framing.framing.aspect('axes')}: told by the light, not by silhouettes")
    if orientation is not None:
        sentences += orientation.sentences()
        changes |= _orientation_changes(orientation, _lighting_place(raw))
    return FoundConventions(framing, orientation, changes, sentences, by_light)


def place_of(raw: RawCapture) -> str:
    """Name the file that a capture was read from."""
    return str(raw.capture.source)


def _placed(
    config: RunConfig, raw: RawCapture, framing: FoundFraming, placed: FoundPlace
) -> FoundConventions:
    """Take the place that was found by the silhouettes themselves, and look for the light there."""
    first = raw.place == ("capture",)
    changes = placed.changes if first and placed.found else {}
    sentences = [*framing.sentences(), placed.sentence]
    if not placed.found or not first:
        return FoundConventions(framing, None, changes, sentences)
    told = framing.told
    lit = oriented(with_changes(config, changes), raw, told)
    if lit is not None:
        sentences += lit.sentences()
        changes = changes | _orientation_changes(lit, _lighting_place(raw))
    rest = framing._replace(framing=told, overlap=placed.overlap)
    return FoundConventions(rest, lit, changes, sentences)


class _Lit(NamedTuple):
    framing: FoundFraming
    orientation: FoundOrientation | None
    by_light: bool


def _lit(config: RunConfig, raw: RawCapture, found: FoundFraming) -> _Lit:
    """Find the light's orientation, and by it the framing where silhouettes cannot tell it."""
    own = oriented(config, raw, found.framing)
    unsure = {"axes", "mirrored"} - set(found.told_apart)
    if own is None or own.is_even or not unsure:
        return _Lit(found, own, False)
    ways = {one[:2]: one for one in reversed(found.tied) if one[2:] == found.framing[2:]}
    ways.pop(found.framing[:2], None)
    tried = [(found.framing, own)]
    for way in sorted(ways.values(), key=lambda one: one.changes(found.told))[: _LIT - 1]:
        other = oriented(config, raw, way)
        if other is not None:
            tried.append((way, other))
    if len(tried) == 1:
        return _Lit(found, own, False)
    tried.sort(key=lambda pair: pair[1].unexplained)
    (best, light), (_, second) = tried[:2]
    if second.unexplained < _LEAST_RATIO * light.unexplained:
        return _Lit(found, own, False)
    return _Lit(found._replace(framing=best), light, True)


def oriented(config: RunConfig, raw: RawCapture, framing: Framing) -> FoundOrientation | None:
    """Find how the environment of a capture is meant; None where it has none."""
    lighting = lighting_of(config, raw)
    if lighting.environment is None:
        return None
    assert config.capture.geometry is not None
    shape = shape_of(moved_geometry(config.capture.geometry, framing))
    try:
        photographs = raw.meant(framing, shape)
    except InputError:
        return None
    given = lighting.environment
    picture = float(given.scale) * np.asarray(read_image(given.path, remedy=MEND).pixels, float)
    told = Orientation(given.convention, given.mirrored, float(given.yaw))
    known = Known(_other_lights(lighting, raw, photographs, shape), lobe_of(config.brdf))
    with fault_of(f"{given.path}"):
        return find_orientation(observations_of(photographs), shape, picture, told, known)


def lighting_of(config: RunConfig, raw: RawCapture) -> CaptureLightingConfig:
    """Find the light that a config has for a capture."""
    if raw.place == ("capture",):
        return config.lighting
    return config.captures[int(raw.place[1])].lighting


def _lighting_place(raw: RawCapture) -> Place:
    return ("lighting",) if raw.place == ("capture",) else (*raw.place, "lighting")


def _other_lights(
    lighting: CaptureLightingConfig,
    raw: RawCapture,
    photographs: list[Photograph],
    shape: Shape,
) -> KnownLight | None:
    rest = lighting.model_copy(update={"environment": None})
    if not rest.given:
        return None
    names = [frame.name for frame in raw.capture.frames]
    kept = [names.index(photograph.frame.name) for photograph in photographs]
    return known_light(rest, names, shape).of_frames(kept)


def moved_geometry(geometry: GeometryConfig, framing: Framing) -> GeometryConfig:
    """Put the turn and the unit of a framing into a geometry."""
    return with_changes(geometry, _geometry_changes(geometry, framing))


def _geometry_changes(geometry: GeometryConfig, framing: Framing) -> dict[Place, Any]:
    own, found = framing.own, {}
    if geometry.sphere is not None:
        sphere = geometry.sphere
        center = own.points(np.array([sphere.center], float))[0]
        if framing.unit != 1:
            found["sphere", "radius"] = rounded(sphere.radius * framing.unit)
        if np.abs(center - np.array(sphere.center)).max() > 1e-12 * sphere.radius:
            found["sphere", "center"] = tuple(rounded(x) for x in center)
        return found
    if framing.unit != 1:
        found["scale",] = rounded(geometry.scale * framing.unit)
    if framing.turn:
        turned = placement_of(geometry).after(own)
        found["rotation",] = tuple(rounded(x) for x in turned.degrees)
    return found


def _framing_changes(
    geometry: GeometryConfig, found: FoundFraming, place: Place
) -> dict[Place, Any]:
    changes: dict[Place, Any] = {}
    if found.framing.axes != found.told.axes:
        changes[*place, "camera_axes"] = found.framing.axes
    if found.framing.mirrored != found.told.mirrored:
        changes[*place, "mirrored"] = found.framing.mirrored
    for inner, value in _geometry_changes(geometry, found.framing).items():
        changes["capture", "geometry", *inner] = value
    return changes


def _orientation_changes(found: FoundOrientation, place: Place) -> dict[Place, Any]:
    if found.why or not found.fits:
        return {}
    changes: dict[Place, Any] = {}
    told = found.told
    for name in ("convention", "mirrored"):
        if getattr(found.orientation, name) != getattr(told, name):
            changes[*place, "environment", name] = getattr(found.orientation, name)
    # A yaw is off where it is by more than it is found to, or the light is another anyway.
    off = found.orientation.off(told)
    if off > 2 * _YAW_STEP:
        yaw = _YAW_STEP * round(found.orientation.yaw / _YAW_STEP)
        changes[*place, "environment", "yaw"] = float(yaw)
    return changes
