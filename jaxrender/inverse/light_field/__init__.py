"""The analytic factorization of a whole light field into light and BRDF (T 2.4.3, eq 2.68).

``factorization``
    the recovery: rank one over m, chains by reciprocity, then all coefficients together
``bilinear`` ``degrees`` ``account``
    the least-squares problem; which degrees are tied together; what is determined, in words
"""

from jaxrender.inverse.light_field.factorization import (
    FactoredField,
    LightField,
    factor_light_field,
)

__all__ = ["FactoredField", "LightField", "factor_light_field"]
