"""What is wrong, where a fit leaves more than noise: causes ranked by what they would explain.

``diagnose`` tests each assumption of a fit by a score test.  ``causes`` holds one function for each
thing that may be wrong: the columns that it would add to the prediction.  ``grounds`` is what they
are made of, under the light in ``light_parts``; ``turning`` are the derivatives that most of them
share, ``derivatives`` those of the fit itself, ``scores`` the test.  ``axes`` finds environments in
another convention.
"""

from jaxrender.inverse.diagnosis.diagnose import CLIPPED, Diagnosis, diagnose, likeliest, reaching
from jaxrender.inverse.diagnosis.grounds import Suspect

__all__ = ["CLIPPED", "Diagnosis", "Suspect", "diagnose", "likeliest", "reaching"]
