"""The mirror's coefficients: all of them, or none (T 3.2.4).

About the normal rho_lpq = (-1)^q delta_lp, which needs the integral over the *whole* sphere; with
the printed limits, the hemispheres, degrees mix (ERRATA 16: rho_220 = 1/2, rho_120 = .242).  The
sign (-1)^q is what tells it from a retro-reflector, and T 3.26 has lost it (ERRATA 17).  About the
reflected direction A_l = Lambda_l rho_l = 1 (T 3.27).
"""

import numpy as np

from jaxrender.harmonics import associated, coefficient_count
from jaxrender.shapes import Float, checked


def mirror_transfer(band_limit: int) -> Float[np.ndarray, "degree"]:
    """Compute A_l = 1 about the reflected direction: the reflection is the light (T 3.27)."""
    coefficient_count(band_limit)
    return np.ones(band_limit + 1)


@checked
def mirror_coefficients(
    band_limit: int, filter_by_degree: Float[np.ndarray, "degree"] | None = None
) -> Float[np.ndarray, "degree outgoing_degree order"]:
    """Compute rho_lpq = f(l) (-1)^q delta_lp for q = 0 ... F, zero for q > l (T 3.23, 3.26).

    ``filter_by_degree`` is f, 1 for a mirror.  The same for -q.

    Raises ``ValueError`` unless the filter has a value for each degree.
    """
    degrees = np.arange(band_limit + 1)
    strength = mirror_transfer(band_limit) if filter_by_degree is None else filter_by_degree
    if strength.shape != degrees.shape:
        raise ValueError(
            f"a filter of {strength.shape[0]} degrees for a band limit of {band_limit}: "
            f"give {band_limit + 1}"
        )
    exists = degrees[None, :] <= degrees[:, None]
    by_order = np.where(exists, (-1.0) ** degrees[None, :], 0.0) * strength[:, None]
    return np.eye(band_limit + 1)[:, :, None] * by_order[:, None, :]


def clipped_mirror_coefficients(
    band_limit: int,
) -> Float[np.ndarray, "degree outgoing_degree order"]:
    """Compute rho_lpq of the mirror that reflects above its horizon only, for q = 0 ... F.

    rho_lpq = (-1)^q 2 pi int_0^(pi/2) Y_lq Y*_pq sin t dt, the limits that T 3.23 prints: the half
    sphere is no orthogonal domain, so that odd and even degrees mix.
    """
    cosines, weights = np.polynomial.legendre.leggauss(band_limit + 1)
    cosines, weights = (cosines + 1) / 2, weights / 2
    table = associated(cosines, np.sqrt(1 - cosines**2), band_limit)
    overlap = 2 * np.pi * np.einsum("lqt,pqt,t->lpq", table, table, weights)
    order = np.arange(band_limit + 1)
    # The real harmonics of q > 0 carry a factor sqrt(2) that the complex ones do not.
    return overlap * np.where(order > 0, 0.5, 1.0) * (-1.0) ** order
