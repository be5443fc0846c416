"""Incoming radiance as a function of direction, and of position.

``base``
    what a light is: point masses of irradiance on the sphere of directions
``directional``
    sources in single directions
``environment``
    radiance on a latitude-longitude grid
``function`` ``lobes``
    light as a function of direction; smooth lobes, for area sources
``positional`` ``photometric``
    point lights; the angular distribution of an intensity, as photometric files state it
``luminaires``
    radiance over the places and directions of a surface
``sky`` ``coefficients``
    the overcast and the clear sky; light given by its harmonic coefficients
``registry``
    lights by the names of the catalogue
``positive_part``
    light that is nowhere negative, from coefficients that were measured
``cells`` ``split``
    near-equal cells of the sphere; slow and fast light apart (T 6.3)
``layouts`` ``panoramas``
    where other panoramas show a direction; their conversion to our grid (host side)
"""

from jaxrender.lighting.base import Light, LightNodes, LightSum
from jaxrender.lighting.cells import Cells, condensed, partition
from jaxrender.lighting.coefficients import HarmonicLight
from jaxrender.lighting.directional import DirectionalSources
from jaxrender.lighting.environment import Environment
from jaxrender.lighting.function import FunctionLight
from jaxrender.lighting.layouts import PANORAMAS, panorama_named
from jaxrender.lighting.lobes import SmoothLobes
from jaxrender.lighting.mirror_ball import BallLight, light_of_ball
from jaxrender.lighting.panoramas import to_latlong, to_own_latlong
from jaxrender.lighting.photometric import AngularIntensity
from jaxrender.lighting.positional import (
    ConeIntensity,
    Flaps,
    IsotropicIntensity,
    PointLight,
    SpotIntensity,
)
from jaxrender.lighting.positive_part import (
    positive_environment,
    positive_light,
    positive_part_of,
)
from jaxrender.lighting.registry import light_of
from jaxrender.lighting.sky import CLEAR_SKIES, ClearSky, OvercastSky, Sky, preetham
from jaxrender.lighting.split import Candidates, LightSplit, candidates, split_to_energy, take

__all__ = [
    "CLEAR_SKIES",
    "PANORAMAS",
    "AngularIntensity",
    "BallLight",
    "Candidates",
    "Cells",
    "ClearSky",
    "ConeIntensity",
    "DirectionalSources",
    "Environment",
    "Flaps",
    "FunctionLight",
    "HarmonicLight",
    "IsotropicIntensity",
    "Light",
    "LightNodes",
    "LightSum",
    "LightSplit",
    "OvercastSky",
    "PointLight",
    "Sky",
    "SmoothLobes",
    "SpotIntensity",
    "candidates",
    "condensed",
    "light_of",
    "light_of_ball",
    "panorama_named",
    "partition",
    "positive_environment",
    "positive_light",
    "positive_part_of",
    "preetham",
    "split_to_energy",
    "take",
    "to_latlong",
    "to_own_latlong",
]
