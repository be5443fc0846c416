"""Functions on the sphere: real spherical harmonics, the grids they are sampled on, their filters.

Read in this order.  ``indexing`` says where a coefficient lives in the flat array; ``legendre``
holds the recurrences over degree; ``basis`` evaluates the harmonics, and a function given by its
coefficients, in any direction; ``grids`` is the latitude-longitude image as a quadrature;
``transform`` takes such an image to coefficients and back; ``zonal`` filters a function degree
by degree, which is what a rotationally symmetric BRDF does to light.

The harmonics are real and orthonormal over the sphere and carry no Condon-Shortley sign:
Y_11 = +0.488603 x, and Y_{l,-m} holds sin(m phi) (T 4.5).
"""

from jaxrender.harmonics.basis import degree_table, evaluate, explicit_basis, real_basis
from jaxrender.harmonics.grids import LatLongGrid
from jaxrender.harmonics.indexing import (
    band_limit_of,
    coefficient_count,
    degrees,
    flat_index,
    orders,
)
from jaxrender.harmonics.legendre import associated, legendre
from jaxrender.harmonics.transform import (
    analyse,
    analyse_dense,
    synthesise,
    synthesise_dense,
)
from jaxrender.harmonics.zonal import apply_transfer, transfer_of

__all__ = [
    "LatLongGrid",
    "analyse",
    "analyse_dense",
    "apply_transfer",
    "associated",
    "band_limit_of",
    "coefficient_count",
    "degree_table",
    "degrees",
    "evaluate",
    "explicit_basis",
    "flat_index",
    "legendre",
    "orders",
    "real_basis",
    "synthesise",
    "synthesise_dense",
    "transfer_of",
]
