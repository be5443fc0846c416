"""The division: materials from photographs, with error bars.

``outcomes``
    how a fit ended, in words
``solvers``
    the only place that knows the optimisation libraries
``unknowns``
    which parameters are free, within what bounds, and how they enter (linearly or not)
``observations``
    usable pixels as measurements, and how a subset of them is drawn
``elimination``
    variable projection: the linear unknowns solved for inside each step
``models``
    the exact integral behind the same interface as the dual model's table
``passes``
    one pass of a fit: least squares, noise and robust weights in turn
``uncertainty`` ``conditioning`` ``account`` ``variants``
    intervals; what rests on grazing angles; what is identifiable and why not; what on the model
``known_light``
    the light split for the dual model, and as point masses for the integral
``brdf``
    the whole recovery of a BRDF under known light (T 6.4.2)
"""

from jaxrender.inverse.brdf import BRDFFit, fit_brdf
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.passes import FitSettings
from jaxrender.inverse.unknowns import MicrofacetUnknowns, Unknown

__all__ = [
    "BRDFFit",
    "FitSettings",
    "KnownLight",
    "MicrofacetUnknowns",
    "Observations",
    "Outcome",
    "Unknown",
    "fit_brdf",
]
