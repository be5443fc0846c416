"""Cameras of Agisoft Metashape, as ``Export Cameras`` writes them in XML.

A camera's ``transform`` takes it to the chunk's frame, x right, y down, z ahead.  The ``transform``
of its component, or else of the chunk, takes that to the world, where an exported mesh lies.  The
``calibration`` has f, cx, cy as an offset from the picture's middle, b1, b2, k1 to k4, p1, p2.
``label`` is the photograph's name, with or without suffix, in the folder or in ``images``.
"""

from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry.cameras import Pinhole
from jaxrender.geometry.lens_models import metashape_lens
from jaxrender.io.captures.capture import Capture, Frame
from jaxrender.io.captures.contents import Contents
from jaxrender.io.captures.paths import IMAGE_SUFFIXES, Looking, frame_names
from jaxrender.io.xmlfiles import Element, read_xml, root_name
from jaxrender.limits import PIXELS
from jaxrender.shapes import Float

LOOKED_FOR = "*.xml with a <document> of Metashape's cameras"
_LENS_AXES = np.array([1.0, -1.0, -1.0])
_FOLDERS = (".", "images", "photos")
_KNOWN = ("f", "cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2")
# Far beyond any scene; products of such numbers are finite.
_LARGEST = 1e30
_KINDS = ("frame", "fisheye")


def find_metashape(folder: Path) -> list[Path]:
    """List the camera files of a folder."""
    return sorted(path for path in folder.glob("*.xml") if root_name(path) == "document")


def read_metashape(path: Path, looking: Looking) -> Contents:
    """Read the aligned cameras of the first chunk; raises InputError that names the element."""
    chunk = read_xml(path).find("chunk")
    if chunk is None:
        raise InputError(f"{path}: no <chunk>; export the cameras again")
    sensors = {one.get("id"): one for one in chunk.iterfind("sensors/sensor")}
    components = {
        one.get("id"): _similarity(path, one) for one in chunk.iterfind("components/component")
    }
    whole = _similarity(path, chunk)
    cameras = list(chunk.iterfind("cameras//camera"))
    aligned = [one for one in cameras if _is_on(one)]
    if not aligned:
        raise InputError(f"{path}: no aligned camera; align the photographs in Metashape first")
    labels = [one.get("label", "") for one in aligned]
    names = frame_names(path, labels, "label")
    frames = []
    for name, label, camera in zip(names, labels, aligned):
        place = f"{path}: camera {label!r}"
        sensor = sensors.get(camera.get("sensor_id"))
        if sensor is None:
            raise InputError(f"{place}: no sensor {camera.get('sensor_id')!r}; export again")
        # Without a component's own the chunk's is that of all.
        world = components.get(camera.get("component_id"))
        camera_from = _Metashape(place, looking, sensor, whole if world is None else world)
        frames.append(camera_from.frame(name, label, camera))
    left_out = len(cameras) - len(aligned)
    found = (f"{len(frames)} aligned camera(s) of Metashape",)
    if left_out:
        found += (f"{left_out} camera(s) are not aligned or switched off, and are left out",)
    assumed = ("the mesh was exported in local coordinates, where the chunk's transform leads",)
    return Contents(Capture(tuple(frames), path), (path,), found=found, assumed=assumed)


class _Metashape(NamedTuple):
    """What a camera refers to: its sensor, and where its chunk lies (None: where the world is)."""

    place: str
    looking: Looking
    sensor: Element
    world: Float[np.ndarray, "4 4"] | None

    def frame(self, name: str, label: str, camera: Element) -> Frame:
        """Read a camera."""
        pose = np.array(_numbers(self.place, camera, "transform", 16)).reshape(4, 4)
        if self.world is not None:
            scale = np.cbrt(np.linalg.det(self.world[:3, :3]))
            pose = self.world @ pose
            pose[:3, :3] /= scale
        pose[:3, :3] *= _LENS_AXES
        try:
            own = self._pinhole(pose)
        except InputError:
            raise
        except ValueError as error:
            raise InputError(f"{self.place}: {error}") from None
        return Frame(name, own, self._photograph(label), None, None)

    def _photograph(self, label: str) -> Path:
        """Find a photograph in the folder or in one of the usual ones."""
        with suppress(OSError, ValueError):
            for folder in _FOLDERS:
                for suffix in ("", *IMAGE_SUFFIXES, *(one.upper() for one in IMAGE_SUFFIXES)):
                    if (self.looking.folder / folder / f"{label}{suffix}").is_file():
                        found = f"{folder}/{label}{suffix}"
                        return self.looking.resolve(self.place, "label", found)
        return self.looking.resolve(self.place, "label", label)

    def _pinhole(self, pose: Float[np.ndarray, "4 4"]) -> Pinhole:
        calibrations = self.sensor.findall("calibration")
        adjusted = [one for one in calibrations if one.get("class") == "adjusted"]
        calibration = next(iter([*adjusted, *calibrations]), None)
        if calibration is None:
            raise InputError(
                f"{self.place}: its sensor has no <calibration>; align and export again"
            )
        kind = calibration.get("type") or self.sensor.get("type") or "frame"
        if kind not in _KINDS:
            raise InputError(f"{self.place}: a sensor of the type {kind!r}, which is not read")
        n: dict[str, float] = dict.fromkeys(_KNOWN, 0.0)
        for child in calibration:
            if child.tag == "resolution" or not (child.text or "").strip():
                continue
            (value,) = _numbers(self.place, calibration, child.tag, 1)
            if value and child.tag not in n:
                raise InputError(
                    f"{self.place}: its calibration has {child.tag} = {value:g}, which is not "
                    "known here; undistort the photographs in Metashape"
                )
            n[child.tag] = value
        width, height = self._size(calibration)
        length, skew = n["f"] + n["b1"], n["b2"] / (n["f"] + n["b1"] or 1.0)
        radial, tangential = [n[f"k{i}"] for i in (1, 2, 3, 4)], (n["p1"], n["p2"])
        lens = metashape_lens(radial, tangential, skew, is_fisheye=kind == "fisheye")
        centre = {"cx": width / 2 + n["cx"], "cy": height / 2 + n["cy"]}
        return Pinhole(width, height, pose, fl_x=length, fl_y=n["f"], **centre, lens=lens)

    def _size(self, calibration: Element) -> tuple[int, int]:
        found = calibration.find("resolution")
        found = self.sensor.find("resolution") if found is None else found
        try:
            assert found is not None
            width, height = int(found.get("width", "")), int(found.get("height", ""))
        except (ValueError, AssertionError):
            raise InputError(f"{self.place}: its sensor has no <resolution>") from None
        PIXELS.check(f"{self.place}: its resolution", width * height)
        return width, height


def _is_on(camera: Element) -> bool:
    """Whether a camera is aligned and not switched off."""
    off = camera.get("enabled", "true").lower() in ("false", "0")
    return bool((camera.findtext("transform") or "").strip()) and not off


def _similarity(path: Path, parent: Element) -> Float[np.ndarray, "4 4"] | None:
    """Read the rotation, shift and scale of a chunk or a component; None where it has none."""
    transform = parent.find("transform")
    if transform is None or transform.find("rotation") is None:
        return None
    place, matrix = f"{path}: <{parent.tag}>: <transform>", np.eye(4)
    scale = 1.0
    if transform.find("scale") is not None:
        (scale,) = _numbers(place, transform, "scale", 1)
    rotation = np.array(_numbers(place, transform, "rotation", 9)).reshape(3, 3)
    deviation = np.abs(rotation.T @ rotation - np.eye(3)).max()
    if not (scale > 0 and deviation < 1e-6 and np.linalg.det(rotation) > 0):
        raise InputError(f"{place}: no rotation, or a scale of {scale:g}; export again")
    matrix[:3, :3] = scale * rotation
    if transform.find("translation") is not None:
        matrix[:3, 3] = _numbers(place, transform, "translation", 3)
    return matrix


def _numbers(place: str, parent: Element, tag: str, count: int) -> list[float]:
    text = parent.findtext(tag) or ""
    try:
        found = [float(word) for word in text.split()]
    except ValueError:
        found = []
    if len(found) != count or not all(abs(number) < _LARGEST for number in found):
        raise InputError(f"{place}: <{tag}> is {text!r}; wanted {count} number(s)")
    return found
