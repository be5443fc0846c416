"""The values of a Mitsuba scene: named numbers, texts, colours and transforms."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from jaxrender.errors import InputError
from jaxrender.io.xmlfiles import Element
from jaxrender.shapes import Float

# Far beyond any scene; products of such numbers are finite.
_LARGEST = 1e30


class Plugin(NamedTuple):
    """An element of a scene with named values; ``defaults`` are those of the scene's $names.

    Names are compared without underscores and capitals, so that those of older versions are known.
    """

    path: Path
    element: Element
    defaults: dict[str, str]

    @property
    def kind(self) -> str:
        """The name of the plugin."""
        return self.element.get("type", "")

    @property
    def place(self) -> str:
        """The opening of a message."""
        return f"{self.path}: <{self.element.tag} type={self.kind!r}>"

    def inner(self, tag: str) -> "list[Plugin]":
        """List the plugins inside, of a tag."""
        return [self._replace(element=one) for one in self.element if one.tag == tag]

    def has(self, name: str) -> bool:
        """Whether there is a value of a name."""
        return self._named(name) is not None

    def text(self, name: str, default: str | None = None) -> str:
        """Read a text; raises InputError where it is missing and has no default."""
        found = self._named(name)
        value = default if found is None else self._filled(found.get("value", ""))
        if value is None:
            raise InputError(f"{self.place}: no `{name}`; give it")
        return value

    def number(self, name: str, default: float | None = None) -> float:
        """Read a finite number."""
        if default is not None and not self.has(name):
            return default
        return self.numbers(name, (1,))[0]

    def numbers(self, name: str, counts: tuple[int, ...]) -> list[float]:
        """Read a list of numbers, of one of the lengths; also from x, y and z."""
        found = self._named(name)
        if found is not None and found.get("value") is None and found.get("x") is not None:
            return _numbers(self.place, name, self._coordinates(found, 0.0), counts)
        return _numbers(self.place, name, self.text(name), counts)

    def colour(self, name: str) -> tuple[float, ...]:
        """Read a colour or a grey value; spectra by wavelength are refused."""
        value = self.numbers(name, (1, 3))
        if min(value) < 0:
            raise InputError(f"{self.place}: `{name}` is {value}, which is negative")
        return tuple(value * 3 if len(value) == 1 else value)

    def transform(self) -> Float[np.ndarray, "4 4"]:
        """Compose ``to_world``: what stands first is applied first."""
        found = self._named("to_world")
        whole = np.eye(4)
        for step in [] if found is None else found:
            next_one = self._step(step)
            if max(np.abs(next_one).max(), np.abs(whole).max()) > _LARGEST:
                raise InputError(f"{self.place}: `to_world` has numbers over {_LARGEST:g}; mend it")
            whole = next_one @ whole
        return whole

    def _named(self, name: str) -> Element | None:
        wanted = _plain(name)
        return next((one for one in self.element if _plain(one.get("name", "")) == wanted), None)

    def _filled(self, text: str) -> str:
        """Put the scene's defaults in the place of $names."""
        for name in sorted(self.defaults, key=len, reverse=True):
            text = text.replace(f"${name}", self.defaults[name])
        return text

    def _coordinates(self, step: Element, missing: float) -> str:
        return " ".join(self._filled(step.get(axis, repr(missing))) for axis in "xyz")

    def _step(self, step: Element) -> Float[np.ndarray, "4 4"]:
        place, result = f"{self.place}: to_world: <{step.tag}>", np.eye(4)

        def read(name: str, count: tuple[int, ...]) -> np.ndarray:
            return np.array(_numbers(place, name, self._filled(step.get(name, "")), count))

        def vector(missing: float) -> np.ndarray:
            if step.get("value") is not None:
                return np.broadcast_to(read("value", (1, 3)), 3)
            return np.array(_numbers(place, "x", self._coordinates(step, missing), (3,)))

        if step.tag == "translate":
            result[:3, 3] = vector(0.0)
        elif step.tag == "scale":
            result[:3, :3] = np.diag(vector(1.0))
        elif step.tag == "rotate":
            axis, angle = vector(0.0), read("angle", (1,))[0]
            if not axis.any():
                raise InputError(f"{place}: the axis is zero")
            turn = math.radians(angle) * axis / np.linalg.norm(axis)
            result[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
        elif step.tag == "matrix":
            values = read("value", (9, 16))
            size = math.isqrt(len(values))
            result[:size, :size] = values.reshape(size, size)
        elif step.tag.lower() in ("lookat", "look_at"):
            result = _looking(place, *(read(name, (3,)) for name in ("origin", "target", "up")))
        else:
            raise InputError(f"{place}: no step that is known here; give a matrix")
        return result


def similarity(place: str, matrix: Float[np.ndarray, "4 4"]) -> float:
    """Find the scale of a rotation, shift and scale; raises InputError for all else."""
    scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    turn = matrix[:3, :3] / (scale or 1.0)
    deviation = np.abs(turn.T @ turn - np.eye(3)).max()
    if not (scale > 0 and deviation < 1e-5 and np.array_equal(matrix[3], [0, 0, 0, 1])):
        raise InputError(f"{place}: `to_world` is no rotation with a shift and one scale")
    return scale


def _plain(name: str) -> str:
    return name.lower().replace("_", "")


def _numbers(place: str, name: str, text: str, counts: tuple[int, ...]) -> list[float]:
    try:
        found = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        found = []
    if len(found) not in counts or not all(map(math.isfinite, found)):
        wanted = " or ".join(map(str, counts))
        raise InputError(f"{place}: `{name}` is {text!r}; wanted {wanted} finite number(s)")
    return found


def _looking(
    place: str, origin: np.ndarray, target: np.ndarray, up: np.ndarray
) -> Float[np.ndarray, "4 4"]:
    """Make Mitsuba's frame of a camera: x left, y up, z ahead."""
    ahead = target - origin
    left = np.cross(up, ahead)
    if not np.linalg.norm(left) > 1e-9 * np.linalg.norm(up) * np.linalg.norm(ahead):
        raise InputError(f"{place}: origin, target and up leave the upright undefined")
    ahead, left = ahead / np.linalg.norm(ahead), left / np.linalg.norm(left)
    result = np.eye(4)
    result[:3] = np.stack([left, np.cross(ahead, left), ahead, origin], axis=-1)
    return result
