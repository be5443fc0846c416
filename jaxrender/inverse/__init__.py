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
``uncertainty`` ``conditioning``
    intervals; what is identifiable, what rests on grazing angles, what on the model
``brdf``
    the whole recovery of a BRDF under known light (T 6.4.2)
"""

from jaxrender.inverse.brdf import BRDFFit, FitSettings, KnownLight, fit_brdf
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.outcomes import Outcome
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
