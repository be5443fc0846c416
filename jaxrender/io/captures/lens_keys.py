"""The distortion of a lens as keys of a JSON object, and back.

The keys are those of Nerfstudio: ``camera_model`` is OPENCV (k1, k2, k3, p1, p2) or OPENCV_FISHEYE
(k1 .. k4).  Ours are FULL_OPENCV with the rational k4 .. k6 and the prism s1 .. s4, SIMPLE_RADIAL
and RADIAL, and for all other lenses ``lens``: its kind and its distortions one after the other, or
the numbers of its whole formula.
"""

from collections.abc import Callable
from typing import Any

from jaxrender.errors import InputError
from jaxrender.geometry.distortions import (
    Distortion,
    Division,
    FieldOfView,
    RadialTangential,
    Skew,
)
from jaxrender.geometry.lens_models import opencv_lens
from jaxrender.geometry.lenses import (
    EnhancedUnifiedLens,
    EquirectangularLens,
    FisheyeLens,
    Lens,
    PerspectiveLens,
)
from jaxrender.io.jsonfiles import number

_RADIAL, _TANGENTIAL = ("k1", "k2", "k3", "k4", "k5", "k6"), ("p1", "p2")
_PRISM = ("s1", "s2", "s3", "s4")
DISTORTION = (*_RADIAL, *_TANGENTIAL, *_PRISM)
# The keys that a camera model has; OpenCV's order is k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4.
MODELS: dict[str, tuple[str, ...]] = {
    "pinhole": (),
    "simple_pinhole": (),
    "simple_radial": ("k1",),
    "radial": ("k1", "k2"),
    "opencv": ("k1", "k2", "p1", "p2", "k3"),
    "full_opencv": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", *_PRISM),
    "opencv_fisheye": ("k1", "k2", "k3", "k4"),
}
# What a file without a model, or with the name of the plain projection, may distort as well.
PLAIN = ("perspective",)
_KINDS: dict[str, type[PerspectiveLens] | type[FisheyeLens]] = {
    "perspective": PerspectiveLens,
    "fisheye": FisheyeLens,
}
# Lenses of one formula, with the names of its numbers, and what makes them of these.
_WHOLE: dict[str, tuple[type[Lens], tuple[str, ...], Callable[..., Lens]]] = {
    "enhanced_unified": (EnhancedUnifiedLens, ("alpha", "beta"), EnhancedUnifiedLens),
    "equirectangular": (EquirectangularLens, (), EquirectangularLens),
}
_DISTORTIONS: dict[str, type[Distortion]] = {
    "radial_tangential": RadialTangential,
    "field_of_view": FieldOfView,
    "division": Division,
    "skew": Skew,
}


def lens_of(place: str, keys: dict[str, Any], model: str) -> Lens | None:
    """Make the lens that keys state; None where they state none.

    Raises InputError for a number that the model does not have.
    """
    if "lens" in keys:
        return _stated_lens(place, keys["lens"])
    own = MODELS["opencv" if model in PLAIN else model]
    given = {key: number(place, keys, key) for key in DISTORTION if keys.get(key) not in (None, 0)}
    for key, value in given.items():
        if key not in own:
            raise InputError(f"{place}: `{key}` is {value:g}: {_remedy(key, model, own)}")
    numbers = [given.get(key, 0.0) for key in own]
    if model == "opencv_fisheye":
        return FisheyeLens((RadialTangential(tuple(numbers)),) if any(numbers) else ())
    return opencv_lens(numbers + [0.0] * (_whole(len(own)) - len(own)))


def keys_of(lens: Lens | None) -> dict[str, Any]:
    """State a lens, by the keys of other programs where they have them."""
    if lens is None:
        return {}
    for name, (made, fields, _) in _WHOLE.items():
        if isinstance(lens, made):
            return {"lens": {"kind": name} | {field: getattr(lens, field) for field in fields}}
    one = lens.distortions[0] if lens.distortions else RadialTangential()
    if len(lens.distortions) < 2 and isinstance(one, RadialTangential):
        plain = not any(one.denominator) and not any(one.prism)
        if isinstance(lens, FisheyeLens):
            if plain and len(one.numerator) <= 4 and not any(one.tangential):
                return {"camera_model": "OPENCV_FISHEYE"} | dict(zip(_RADIAL, one.numerator))
        elif len(one.numerator) <= 3 and len(one.denominator) <= 3:
            found = dict(zip(_RADIAL, one.numerator)) | dict(zip(_TANGENTIAL, one.tangential))
            if plain:
                return {"camera_model": "OPENCV"} | found
            found |= dict(zip(_RADIAL[3:], one.denominator)) | dict(zip(_PRISM, one.prism))
            return {"camera_model": "FULL_OPENCV"} | found
    kind = next(name for name, made in _KINDS.items() if isinstance(lens, made))
    parts = [
        {name: _fields(part) for name, made in _DISTORTIONS.items() if isinstance(part, made)}
        for part in lens.distortions
    ]
    return {"lens": {"kind": kind, "distortions": parts}}


def _whole(count: int) -> int:
    """How many coefficients OpenCV has that hold as many."""
    return next(size for size in (0, 4, 5, 8, 12) if size >= count)


def _remedy(key: str, model: str, own: tuple[str, ...]) -> str:
    if model in ("opencv", *PLAIN) and key in ("k4", "k5", "k6", *_PRISM):
        return (
            "Nerfstudio takes k4 as that of r^8, OpenCV takes k4 to k6 as those of a denominator; "
            "say `camera_model` FULL_OPENCV for OpenCV's, or `lens`"
        )
    has = f"has {', '.join(own)}" if own else "has no distortion"
    return f"the camera_model {model.upper()} {has}; mend camera_model, or remove the number"


def _fields(part: Distortion) -> dict[str, Any]:
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in vars(part).items()
    }


def _stated_lens(place: str, stated: Any) -> Lens:
    place = f"{place}: `lens`"
    whole = _WHOLE.get(stated["kind"]) if _is_named(stated) else None
    if whole is not None:
        _, fields, made = whole
        if set(stated) != {"kind", *fields}:
            raise InputError(f"{place}: wanted the keys kind {' '.join(fields)}, found {stated!r}")
        try:
            return made(*(number(place, stated, field) for field in fields))
        except ValueError as error:
            raise InputError(f"{place}: {error}") from None
    if not isinstance(stated, dict) or set(stated) != {"kind", "distortions"}:
        raise InputError(f"{place}: wanted the keys kind and distortions, found {stated!r}")
    kind, parts = stated["kind"], stated["distortions"]
    if not isinstance(kind, str) or kind not in _KINDS:
        raise InputError(f"{place}: kind {kind!r} is none of {', '.join((*_KINDS, *_WHOLE))}")
    if not isinstance(parts, list):
        raise InputError(f"{place}: distortions must be a list, found {parts!r}")
    return _KINDS[kind](tuple(_distortion(place, part) for part in parts))


def _is_named(stated: Any) -> bool:
    return isinstance(stated, dict) and isinstance(stated.get("kind"), str)


def _distortion(place: str, part: Any) -> Distortion:
    known = isinstance(part, dict) and len(part) == 1 and next(iter(part)) in _DISTORTIONS
    if not known or not isinstance(next(iter(part.values())), dict):
        raise InputError(
            f"{place}: a distortion is one of {', '.join(_DISTORTIONS)} with its numbers, "
            f"found {part!r}"
        )
    ((name, numbers),) = part.items()
    values = {key: _numbers(place, numbers, key) for key in numbers}
    try:
        return _DISTORTIONS[name](**values)
    except (TypeError, ValueError) as error:
        raise InputError(f"{place}: {name}: {error}") from None


def _numbers(place: str, keys: dict[str, Any], key: str) -> float | tuple[float, ...]:
    """Take a number, or a list of them, out of an object."""
    if not isinstance(keys[key], list):
        return number(place, keys, key)
    return tuple(number(place, {key: value}, key) for value in keys[key])
