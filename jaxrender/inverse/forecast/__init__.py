"""What photographs will identify, by Fisher information, before any is taken (T 2.4.2).

``situation``
    cameras, light and a supposed material; the photographs that they would give
``spectrum``
    the light by degree, and which degrees show above the noise
``material``
    error bars of a fit of the material under known light, and the evidence for sigma
``causes``
    why a parameter is not identifiable, and the remedies
``illumination``
    singular values and recoverable degree of the light, the material known
``joint``
    both unknown: error bars, and the gauge
``information``
    Fisher information of photographs in a few numbers each, to compare many candidates at once
"""

from jaxrender.inverse.forecast.illumination import LightForecast, forecast_light
from jaxrender.inverse.forecast.joint import JointForecast, forecast_joint
from jaxrender.inverse.forecast.material import (
    MaterialForecast,
    forecast_material,
    forecast_of_fit,
)
from jaxrender.inverse.forecast.situation import (
    TYPICAL_MATERIAL,
    TYPICAL_NOISE,
    Foreseen,
    Situation,
    Supposed,
    foresee,
    foresee_draw,
    problem_of,
    weights_of,
)
from jaxrender.inverse.forecast.spectrum import highest_identifiable_degree

__all__ = [
    "TYPICAL_MATERIAL",
    "TYPICAL_NOISE",
    "Foreseen",
    "JointForecast",
    "LightForecast",
    "MaterialForecast",
    "Situation",
    "Supposed",
    "forecast_joint",
    "forecast_light",
    "forecast_material",
    "forecast_of_fit",
    "foresee",
    "foresee_draw",
    "highest_identifiable_degree",
    "problem_of",
    "weights_of",
]
