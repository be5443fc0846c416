"""Incoming radiance as a function of direction, and of position.

``base``
    what a light is: point masses of irradiance on the sphere of directions
``directional`` ``point_sources``
    sources in single directions, and at places
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
``mirror_ball`` ``ball_views`` ``ball_outline`` ``lens_views`` ``filling``
    the light around a chrome ball, from one photograph or several; where the ball lies; the light
    that a fisheye or a panorama sees; directions that none shows
``layouts`` ``panoramas``
    where other panoramas show a direction; their conversion to our grid (host side)
"""

from jaxrender.lighting.ball_outline import ball_of_circle, ball_of_mask
from jaxrender.lighting.ball_views import (
    Ball,
    BallView,
    Evidence,
    MergedViews,
    merge_views,
    view_of_ball,
)
from jaxrender.lighting.base import Light, LightNodes, LightSum
from jaxrender.lighting.cells import Cells, condensed, partition
from jaxrender.lighting.coefficients import HarmonicLight
from jaxrender.lighting.directional import DirectionalSources
from jaxrender.lighting.environment import Environment
from jaxrender.lighting.filling import fill_smoothly
from jaxrender.lighting.function import FunctionLight
from jaxrender.lighting.layouts import PANORAMAS, panorama_named
from jaxrender.lighting.lens_views import view_of_lens
from jaxrender.lighting.lobes import SmoothLobes
from jaxrender.lighting.mirror_ball import BallLight, light_of_ball
from jaxrender.lighting.panoramas import to_latlong, to_own_latlong
from jaxrender.lighting.photometric import AngularIntensity
from jaxrender.lighting.point_sources import PointSources
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
    "Ball",
    "BallLight",
    "BallView",
    "Candidates",
    "Cells",
    "ClearSky",
    "ConeIntensity",
    "DirectionalSources",
    "Environment",
    "Evidence",
    "Flaps",
    "FunctionLight",
    "HarmonicLight",
    "IsotropicIntensity",
    "Light",
    "LightNodes",
    "LightSplit",
    "LightSum",
    "MergedViews",
    "OvercastSky",
    "PointLight",
    "PointSources",
    "Sky",
    "SmoothLobes",
    "SpotIntensity",
    "ball_of_circle",
    "ball_of_mask",
    "candidates",
    "condensed",
    "fill_smoothly",
    "light_of",
    "light_of_ball",
    "merge_views",
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
    "view_of_ball",
    "view_of_lens",
]
