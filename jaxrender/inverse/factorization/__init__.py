"""Factorization: light and material from photographs alone (T 6.4.4).

``response`` ``integral_response``
    how samples respond to each part of an unknown light, as functions of the material: by the
    frequency view of a glossy one, by the integral of any other
``blocks`` ``projection`` ``joint``
    samples in blocks; the light eliminated from each step; Gauss-Newton over material and lamps
``pursuit``
    which lamps would explain most of what is left
``state`` ``lamps`` ``correction`` ``rounds``
    where a fit stands; lamps found and dropped; what the exact integral corrects; these in turn
``account``
    gauges and error bars
``recover`` ``prediction`` ``given``
    the whole of it; what other samples show by what was found; what is known beforehand
``gram`` ``stream``
    one pass over any number of pixels into matrices from which every outer evaluation follows
``nested`` ``roughness``
    the thesis's own method on them, the twin; roughness from a directional source (T 6.25)
"""

from jaxrender.inverse.factorization.account import GAUGES, RecoveredScene
from jaxrender.inverse.factorization.given import in_units_of, known_of, reflectances_of
from jaxrender.inverse.factorization.prediction import predict
from jaxrender.inverse.factorization.recover import Factorization, factorize
from jaxrender.inverse.factorization.state import FactorSettings, Known, Round

__all__ = [
    "GAUGES",
    "FactorSettings",
    "Factorization",
    "Known",
    "RecoveredScene",
    "Round",
    "factorize",
    "in_units_of",
    "known_of",
    "predict",
    "reflectances_of",
]
