"""A scene of Mitsuba 3 in XML: its sensors, its one shape, its environment and distant lights.

A photograph of a sensor is beside the scene: it has the sensor's ``id`` for a name, or, of a lone
sensor, the name of the scene.  Sensors are ``perspective`` and ``orthographic``, shapes ``obj``,
``ply`` and ``sphere``, emitters ``envmap`` and ``directional``; what else shines is named.
"""

import math
from pathlib import Path

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry.cameras import Camera, Orthographic, Pinhole
from jaxrender.io.captures.capture import Capture, Frame
from jaxrender.io.captures.contents import (
    Contents,
    StatedEnvironment,
    StatedLight,
    StatedPoint,
    StatedSource,
    StatedSphere,
)
from jaxrender.io.captures.mitsuba_values import Plugin, similarity
from jaxrender.io.captures.paths import Looking, frame_names
from jaxrender.io.xmlfiles import read_xml, root_name
from jaxrender.limits import PIXELS

LOOKED_FOR = "*.xml with a <scene>"
# Mitsuba's camera has x to the left and looks along +z.
_SENSOR_AXES = np.array([-1.0, 1.0, -1.0])
# The diagonal of a film of 35 mm, which ``focal_length`` refers to.
_FILM_DIAGONAL = math.hypot(36, 24)
_MESHES = ("obj", "ply")


def find_mitsuba(folder: Path) -> list[Path]:
    """List the scenes of a folder."""
    return sorted(path for path in folder.glob("*.xml") if root_name(path) == "scene")


def read_mitsuba(path: Path, looking: Looking) -> Contents:
    """Read a scene; raises InputError that names the element."""
    root = read_xml(path)
    included = root.find("include")
    if included is not None:
        raise InputError(f"{path}: <include>: put the other file's elements in its place")
    defaults = {one.get("name", ""): one.get("value", "") for one in root.findall("default")}
    scene = Plugin(path, root, defaults)
    sensors = scene.inner("sensor")
    if not sensors:
        raise InputError(f"{path}: no <sensor>; export the cameras, too")
    values = [sensor.element.get("id") or path.stem for sensor in sensors]
    names = frame_names(path, values, "id")
    frames = tuple(
        Frame(name, _camera(sensor), looking.resolve(sensor.place, "id", value), None, None)
        for name, value, sensor in zip(names, values, sensors)
    )
    contents = Contents(
        Capture(frames, path), (path,), found=(f"{len(frames)} sensor(s) of Mitsuba",)
    )
    return _with_light(_with_shape(contents, scene, looking), scene, looking)


def _camera(sensor: Plugin) -> Camera:
    film = next(iter(sensor.inner("film")), sensor)
    width, height = (int(film.number(*size)) for size in (("width", 768.0), ("height", 576.0)))
    if width < 1 or height < 1:
        raise InputError(f"{film.place}: the film is {width} x {height} pixels")
    PIXELS.check(f"{film.place}: width x height", width * height)
    matrix = sensor.transform()
    scale = similarity(sensor.place, matrix)
    pose = matrix.copy()
    pose[:3, :3] *= _SENSOR_AXES / scale
    shifts = [film.number(f"crop_offset_{axis}", 0.0) for axis in "xy"]
    shown = [
        int(film.number(f"crop_{side}", float(size)))
        for side, size in (("width", width), ("height", height))
    ]
    offsets = [sensor.number(f"principal_point_offset_{axis}", 0.0) for axis in "xy"]
    # A positive offset moves the picture, and the principal point the other way.
    centre = [
        size * (0.5 - offset) - shift
        for size, offset, shift in zip((width, height), offsets, shifts)
    ]
    try:
        if sensor.kind == "orthographic":
            one = 2 * scale / width
            return Orthographic(shown[0], shown[1], pose, scale=one, cx=centre[0], cy=centre[1])
        if sensor.kind == "perspective":
            length = _focal_length(sensor, width, height)
            return Pinhole(shown[0], shown[1], pose, fl_x=length, cx=centre[0], cy=centre[1])
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{sensor.place}: {error}") from None
    raise InputError(f"{sensor.place}: a sensor that is neither perspective nor orthographic")


def _focal_length(sensor: Plugin, width: int, height: int) -> float:
    """Read ``fov`` (degrees) along its axis, or ``focal_length`` (millimetres of 35 mm film)."""
    if not sensor.has("fov"):
        words = sensor.text("focal_length", "50mm")
        try:
            millimetres = float(words.removesuffix("mm"))
        except ValueError:
            raise InputError(f"{sensor.place}: `focal_length` is {words!r}") from None
        return millimetres / _FILM_DIAGONAL * math.hypot(width, height)
    angle, axis = sensor.number("fov"), sensor.text("fov_axis", "x")
    sides = {
        "x": width,
        "y": height,
        "smaller": min(width, height),
        "larger": max(width, height),
        "diagonal": math.hypot(width, height),
    }
    if axis not in sides or not 0 < angle < 180:
        raise InputError(f"{sensor.place}: `fov` is {angle:g} along {axis!r}")
    return sides[axis] / 2 / math.tan(math.radians(angle) / 2)


def _with_shape(contents: Contents, scene: Plugin, looking: Looking) -> Contents:
    """Add the object, if the scene has one shape."""
    shapes = scene.inner("shape")
    if len(shapes) != 1:
        said = f"{len(shapes)} shapes in the scene; which is the object is not told"
        return contents._replace(assumed=(*contents.assumed, said))
    (shape,) = shapes
    matrix = shape.transform()
    if shape.kind in _MESHES:
        mesh = looking.resolve(shape.place, "filename", shape.text("filename"), (f".{shape.kind}",))
        placed = None if np.array_equal(matrix, np.eye(4)) else matrix
        return contents._replace(mesh=mesh, mesh_placed=placed)
    if shape.kind != "sphere":
        said = f"the shape is a {shape.kind}, which is not read"
        return contents._replace(assumed=(*contents.assumed, said))
    center = np.array(shape.numbers("center", (3,)) if shape.has("center") else np.zeros(3))
    radius = shape.number("radius", 1.0) * similarity(shape.place, matrix)
    with np.errstate(over="ignore", invalid="ignore"):
        center = matrix[:3, :3] @ center + matrix[:3, 3]
    if not np.isfinite([*center, radius]).all():
        raise InputError(f"{shape.place}: the sphere is not in a finite place; mend its numbers")
    return contents._replace(sphere=StatedSphere(tuple(map(float, center)), radius))


def _with_light(contents: Contents, scene: Plugin, looking: Looking) -> Contents:
    """Add the light, if all of it can be read."""
    environment, sources, points, unread = None, [], [], []
    shining = [one for shape in scene.inner("shape") for one in shape.inner("emitter")]
    for emitter in (*scene.inner("emitter"), *shining):
        if emitter.kind == "envmap" and environment is None:
            environment = _panorama(emitter, looking)
        elif emitter.kind == "directional":
            sources.append(_source(emitter))
        elif emitter.kind == "point":
            points.append(_point(emitter))
        else:
            unread.append(emitter.kind)
    if unread:
        said = f"emitters that are not read ({', '.join(unread)}): the light is taken as unknown"
        return contents._replace(assumed=(*contents.assumed, said))
    light = StatedLight(environment, tuple(sources), tuple(points))
    if not light.given:
        return contents
    parts = ["an environment"] * (environment is not None)
    counts = ((len(sources), "distant source(s)"), (len(points), "point source(s)"))
    parts += [f"{count} {words}" for count, words in counts if count]
    said = f"the light of the scene: {', '.join(parts)}"
    return contents._replace(light=light, found=(*contents.found, said))


def _panorama(emitter: Plugin, looking: Looking) -> StatedEnvironment:
    path = looking.resolve(emitter.place, "filename", emitter.text("filename"))
    matrix, scale = emitter.transform(), emitter.number("scale", 1.0)
    if scale <= 0:
        raise InputError(f"{emitter.place}: `scale` is {scale:g}; it must be positive")
    turn = matrix[:3, :3] / similarity(emitter.place, matrix)
    turned = None if np.allclose(turn, np.eye(3), atol=1e-9) else turn
    return StatedEnvironment(path, "y-up", scale, turned, at_poles=True)


def _source(emitter: Plugin) -> StatedSource:
    """Read a distant source; its direction is where its light goes."""
    along = emitter.transform()[:3, 2]
    if emitter.has("direction"):
        along = np.array(emitter.numbers("direction", (3,)))
    with np.errstate(over="ignore", invalid="ignore"):
        length = float(np.linalg.norm(along))
    if not 1e-9 < length < 1e9:
        raise InputError(f"{emitter.place}: `direction` is {along.tolist()}: no direction")
    colour = emitter.colour("irradiance")
    return StatedSource(tuple(float(x) for x in -along / length), colour)


def _point(emitter: Plugin) -> StatedPoint:
    """Read a point source: its place, or where its transform puts the origin."""
    place = emitter.transform()[:3, 3]
    if emitter.has("position"):
        place = np.array(emitter.numbers("position", (3,)))
    return StatedPoint(tuple(map(float, place)), emitter.colour("intensity"))
