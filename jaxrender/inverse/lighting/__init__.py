"""The light from photographs of a known material (T 6.4.3).

``operator`` ``normal_equations``
    photographs as linear measurements of the light, streamed
``coefficients``
    the light as harmonic coefficients (T 6.15, 6.16)
``reflected_bins`` ``unseen_directions`` ``dual``
    the light as a map of directions (T 6.17 to 6.21)
``positivity``
    light that is not negative, for both (T 6.24)
"""

from jaxrender.inverse.lighting.coefficients import (
    LightSettings,
    RecoveredLight,
    recover_coefficients,
)
from jaxrender.inverse.lighting.dual import DualSettings, RecoveredDual, recover_dual
from jaxrender.inverse.lighting.operator import LightOperator

__all__ = [
    "DualSettings",
    "LightOperator",
    "LightSettings",
    "RecoveredDual",
    "RecoveredLight",
    "recover_coefficients",
    "recover_dual",
]
