"""Every kind of light that a config states by numbers, and what these are: plain data.

Fits and recipes have a section for each, and ``lighting.light_of`` makes the light.  A new kind is
a class in ``lighting`` and an entry here.  Environments, and sources that move, are read from
files.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

Kind = Literal["direction", "position", "colour", "colours", "angle", "word"]


class LightKey(NamedTuple):
    """A key of a light's section: its kind, the argument of the class that it becomes, its meaning.

    Angles are stated in degrees, and become radians.  ``words`` are those of a word; the first is
    taken where none is stated.
    """

    name: str
    argument: str
    kind: Kind
    meaning: str
    words: tuple[str, ...] = ()


class LightKind(NamedTuple):
    """A kind of light by the name of its section.

    ``home`` is the module and class below ``jaxrender.lighting``.  Of some kinds there may be
    ``many``: the section is then a list, and every argument of the class an array with a row for
    each entry.  ``is_image`` says that a fit samples the light as an image.
    """

    name: str
    home: str
    meaning: str
    keys: tuple[LightKey, ...]
    many: bool = False
    is_image: bool = True


_ALL: tuple[LightKind, ...] = (
    LightKind(
        "directional",
        "directional.DirectionalSources",
        "a directional source",
        (
            LightKey(
                "direction",
                "directions",
                "direction",
                "Vector towards the source, of any length.",
            ),
            LightKey(
                "irradiance",
                "irradiance",
                "colour",
                "Irradiance on a plane facing the source: one number or three.",
            ),
        ),
        many=True,
        is_image=False,
    ),
    LightKind(
        "point",
        "point_sources.PointSources",
        "a source at a place, near enough to count",
        (
            LightKey("position", "positions", "position", "Its place, in the units of the shape."),
            LightKey(
                "intensity",
                "intensity",
                "colour",
                "Irradiance on a plane facing it at the distance 1: one number or three.",
            ),
        ),
        many=True,
        is_image=False,
    ),
    LightKind(
        "area",
        "lobes.SmoothLobes",
        "a smooth lobe of light",
        (
            LightKey(
                "direction",
                "directions",
                "direction",
                "Vector towards the middle of the lobe, of any length.",
            ),
            LightKey(
                "width_degrees",
                "widths",
                "angle",
                "Angle from the middle at which the radiance has fallen to 1/e.",
            ),
            LightKey(
                "radiance",
                "middle",
                "colour",
                "Radiance in the middle of the lobe: one number or three.",
            ),
        ),
        many=True,
    ),
    LightKind(
        "overcast_sky",
        "sky.OvercastSky",
        "the overcast sky of the CIE above the horizon, +Z up",
        (LightKey("zenith", "zenith", "colour", "Radiance at the zenith: one number or three."),),
    ),
    LightKind(
        "clear_sky",
        "sky.ClearSky",
        "the clear sky of the CIE above the horizon, +Z up, without the sun's disc",
        (
            LightKey("sun", "sun", "direction", "Vector towards the sun, at or above the horizon."),
            LightKey("zenith", "zenith", "colour", "Radiance at the zenith: one number or three."),
            LightKey(
                "air",
                "distribution",
                "word",
                "The air: clear, or polluted.",
                ("clear", "polluted"),
            ),
        ),
    ),
    LightKind(
        "harmonic",
        "coefficients.HarmonicLight",
        "light by its spherical-harmonic coefficients",
        (
            LightKey(
                "coefficients",
                "coefficients",
                "colours",
                "Coefficients L_lm of the real harmonics in the order l(l+1)+m, from degree 0: one "
                "number each or three.",
            ),
        ),
    ),
)

LIGHTS: Mapping[str, LightKind] = MappingProxyType({kind.name: kind for kind in _ALL})
