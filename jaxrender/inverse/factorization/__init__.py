"""Factorization: light and material from photographs alone (T 6.4.4).

``response`` ``integral_response``
    how samples respond to each part of an unknown light, as functions of the material: the
    frequency view for a glossy material, the integral for any other
``blocks`` ``slopes`` ``projection`` ``joint``
    samples in blocks; derivatives of a prediction; the light eliminated from each step;
    Gauss-Newton over material and sources
``pursuit``
    which sources would explain most of what is left
``state`` ``sources`` ``correction`` ``starts`` ``rounds``
    where a fit stands; sources added and dropped; what the dual model lacks of the exact integral;
    the best of several widths to begin with; the order of all that
``crowds`` ``widths`` ``source_nodes``
    sources that make up a window get a width, and errors that know of what lies between them
``band_limits``
    to which degree slow light is followed
``gauges`` ``account`` ``recovered_scene`` ``source_clusters`` ``chroma``
    what stands for all products of light and reflectance; error bars; the light with its own;
    sources that the lobe does not tell apart; colours tied together
``suspicion`` ``free_capture`` ``calibrate`` ``examination``
    what would explain the rest; a capture of which something is free; its corrections found on some
    samples and then on all; all of that in order
``recover`` ``prediction`` ``given``
    the whole recovery; its prediction of other samples; what is known beforehand
``gram`` ``stream``
    one pass over the pixels, into matrices that give the equations of every material
``nested`` ``roughness``
    the thesis's own method on these matrices; roughness from a directional source (T 6.25)
"""

from jaxrender.inverse.factorization.band_limits import FIRST_DEGREE
from jaxrender.inverse.factorization.calibrate import OF_LIGHT
from jaxrender.inverse.factorization.chroma import tied
from jaxrender.inverse.factorization.gauges import GAUGES
from jaxrender.inverse.factorization.given import in_units_of, known_of, reflectances_of
from jaxrender.inverse.factorization.prediction import predict
from jaxrender.inverse.factorization.recover import Factorization, factorize
from jaxrender.inverse.factorization.recovered_scene import RecoveredScene
from jaxrender.inverse.factorization.source_nodes import as_points
from jaxrender.inverse.factorization.state import FactorSettings, Known, Round

__all__ = [
    "FIRST_DEGREE",
    "GAUGES",
    "OF_LIGHT",
    "FactorSettings",
    "Factorization",
    "Known",
    "RecoveredScene",
    "Round",
    "as_points",
    "factorize",
    "in_units_of",
    "known_of",
    "predict",
    "reflectances_of",
    "tied",
]
