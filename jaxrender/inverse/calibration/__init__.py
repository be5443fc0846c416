"""Calibration: nuisances of a capture, found together with the material.

Each round fits the material to samples and light as they are corrected so far (``capture``),
differentiates the prediction by what is free (``equations``; the columns are those by which
``diagnosis`` tests causes), and corrects further: least squares of material and nuisances at once,
the nuisances held by their priors.  A step that makes matters worse is damped (Levenberg and
Marquardt).  What a blur does is known only with the material (``softened``).  At the end the errors
of the material hold those of the nuisances (``account``).
"""

from jaxrender.inverse.calibration.account import Calibrated
from jaxrender.inverse.calibration.calibrate import calibrate, finish
from jaxrender.inverse.calibration.softened import softened

__all__ = ["Calibrated", "calibrate", "finish", "softened"]
