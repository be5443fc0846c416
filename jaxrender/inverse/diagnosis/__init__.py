"""What is wrong, where a fit leaves more than noise: causes ranked by what they would explain.

``diagnose`` tests each assumption of a fit by a score test.  ``causes`` holds one function for each
thing that may be wrong: the columns that it would add to the prediction.  ``grounds`` is what they
are made of, ``turning`` the derivatives that most of them share, ``scores`` the test itself;
``axes`` finds environments in another convention.
"""

from jaxrender.inverse.diagnosis.diagnose import CLIPPED, Diagnosis, diagnose
from jaxrender.inverse.diagnosis.grounds import Suspect

__all__ = ["CLIPPED", "Diagnosis", "Suspect", "diagnose"]
