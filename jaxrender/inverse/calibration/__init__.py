"""Calibration: nuisances of a capture, found together with the material.

Each round fits the material to samples and light as they are corrected so far, differentiates the
prediction by what is free (``equations``; the columns are those by which ``diagnosis`` tests
causes), and corrects further (``search``): least squares of the fit's own unknowns and of nuisances
at once, the nuisances held by their priors.  A step that makes matters worse is damped (Levenberg
and Marquardt).  What a blur does is known only with the material (``softened``).  At the end the
errors of the material hold those of the nuisances (``account``).  What is freed, the settings say
(``automatic``).

The search, the equations and the account know nothing of the fit that goes with the corrections;
``capture`` and ``calibrate`` are those of a material under known light.
"""

from jaxrender.inverse.calibration.account import Calibration, calibration_of
from jaxrender.inverse.calibration.automatic import Examined, check_free, free_what_is_named
from jaxrender.inverse.calibration.calibrate import Calibrated, calibrate, finish
from jaxrender.inverse.calibration.capture import State
from jaxrender.inverse.calibration.equations import Columns, Pull
from jaxrender.inverse.calibration.search import Weighing, search
from jaxrender.inverse.calibration.softened import softened

__all__ = [
    "Calibrated",
    "Calibration",
    "Columns",
    "Examined",
    "Pull",
    "State",
    "Weighing",
    "calibrate",
    "calibration_of",
    "check_free",
    "finish",
    "free_what_is_named",
    "search",
    "softened",
]
