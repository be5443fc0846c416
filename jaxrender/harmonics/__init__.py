"""Functions on the circle, the sphere and the rotation group: bases, grids, transforms, filters.

Read in this order.  ``indexing`` says where a coefficient lives in the flat array; ``legendre``
holds the recurrences over degree; ``basis`` evaluates the harmonics, and a function given by its
coefficients, in any direction; ``complex_basis`` is the form the thesis writes its analysis in.
``grids`` are images as quadratures: latitude-longitude and Gauss-Legendre, whose sums separate;
``panoramic_grids`` are the cube and the ball map.  ``transform`` takes an image on any of them to
coefficients and back (``azimuth`` is its half along the rows), ``resampling`` to another grid,
``lookup`` to any direction;
``zonal`` filters a function degree by degree, which is what a rotationally symmetric BRDF does to
light; ``windows`` take the ringing off such a filter that is cut at a band limit.

``circle`` is the same theory in flatland (T 2.2.2).  ``wigner`` holds the matrices by which
harmonics turn, ``rotation`` turns coefficients with them, and ``so3`` takes functions of a rotation
to coefficients and convolves them (T 2.3.3).

The harmonics are real and orthonormal over the sphere and carry no Condon-Shortley sign:
Y_11 = +0.488603 x, and Y_{l,-m} holds sin(m phi) (T 4.5).  The complex ones carry it (T 2.26).
"""

from jaxrender.harmonics.basis import degree_table, evaluate, explicit_basis, real_basis
from jaxrender.harmonics.circle import (
    analyse_circle,
    circle_angles,
    circle_basis,
    reflect_circle,
    rotate_circle,
    synthesise_circle,
)
from jaxrender.harmonics.complex_basis import complex_basis, complex_from_real, real_from_complex
from jaxrender.harmonics.grids import GaussLegendreGrid, Grid, LatLongGrid, SeparableGrid
from jaxrender.harmonics.indexing import (
    band_limit_of,
    coefficient_count,
    degrees,
    flat_index,
    orders,
)
from jaxrender.harmonics.legendre import associated, legendre
from jaxrender.harmonics.lookup import (
    interpolated,
    looked_up,
    looked_up_on_cube,
    off_pole,
    over_poles,
)
from jaxrender.harmonics.panoramic_grids import AngularMapGrid, CubeGrid
from jaxrender.harmonics.resampling import change_grid, resample
from jaxrender.harmonics.rotation import reflect, rotate, rotate_by_angles, rotation_matrices
from jaxrender.harmonics.so3 import (
    RotationGrid,
    analyse_rotations,
    convolve_rotations,
    correlate_rotations,
    synthesise_rotations,
)
from jaxrender.harmonics.transform import analyse, analyse_dense, synthesise, synthesise_dense
from jaxrender.harmonics.wigner import quarter_turn, representation, small_d
from jaxrender.harmonics.windows import (
    TOLERABLE_RINGING,
    WINDOWS,
    halving_strength,
    hann,
    lanczos,
    minimal,
    minimal_strength,
    ringing,
    window_named,
)
from jaxrender.harmonics.zonal import apply_transfer, transfer_of

__all__ = [
    "AngularMapGrid",
    "CubeGrid",
    "GaussLegendreGrid",
    "Grid",
    "LatLongGrid",
    "RotationGrid",
    "SeparableGrid",
    "TOLERABLE_RINGING",
    "WINDOWS",
    "analyse",
    "analyse_circle",
    "analyse_dense",
    "analyse_rotations",
    "apply_transfer",
    "associated",
    "band_limit_of",
    "change_grid",
    "circle_angles",
    "circle_basis",
    "coefficient_count",
    "complex_basis",
    "complex_from_real",
    "convolve_rotations",
    "correlate_rotations",
    "degree_table",
    "degrees",
    "evaluate",
    "explicit_basis",
    "flat_index",
    "halving_strength",
    "hann",
    "interpolated",
    "lanczos",
    "legendre",
    "looked_up",
    "looked_up_on_cube",
    "minimal",
    "minimal_strength",
    "off_pole",
    "orders",
    "over_poles",
    "quarter_turn",
    "real_basis",
    "real_from_complex",
    "reflect",
    "reflect_circle",
    "representation",
    "resample",
    "ringing",
    "rotate",
    "rotate_by_angles",
    "rotate_circle",
    "rotation_matrices",
    "small_d",
    "synthesise",
    "synthesise_circle",
    "synthesise_dense",
    "synthesise_rotations",
    "transfer_of",
    "window_named",
]
