"""Which orders of an expansion suffice: F, P and the resolutions S, T that follow (T 5.5, 5.6.3).

The error of an expansion is the part of the energy that it leaves out (T 5.15 to 5.18).  The
reflected light is a product of light and BRDF, so the BRDF's error alone, or the lesser of both, is
what to choose orders by; ``residual_bound`` is the bound of T 5.19 on what is left out of the
reflected light, with Lambda^2, since energies are squares (as printed it is violated: ERRATA 36).
"""

from typing import NamedTuple

import numpy as np

from jaxrender.harmonics import band_limit_of, degrees
from jaxrender.shapes import AnyArray, Float, checked
from jaxrender.spectra.central import CentralSpectrum

# Texels per degree of a map that is interpolated between its texels (T 5.5.2).
TEXELS_PER_DEGREE = 10


class Orders(NamedTuple):
    """Degrees that suffice: F of the light's direction, P of the viewer's, and what they miss."""

    light: int
    viewer: int
    missing: float

    @property
    def resolutions(self) -> tuple[int, int]:
        """S ~ 10 F rows of a map and T ~ 10 P views of an explicit table (T 5.5.2), at least 1."""
        rows, views = (max(1, TEXELS_PER_DEGREE * order) for order in (self.light, self.viewer))
        return rows, views


def missing_energy(spectrum: CentralSpectrum) -> Float[np.ndarray, "degree outgoing_degree"]:
    """Compute what part of the BRDF's energy the orders up to each (F, P) leave out (T 5.18).

    Over all channels together; rounding may leave a little less than 0 at the end.
    """
    rho = np.asarray(spectrum.coefficients, float)
    pairs = np.where(np.arange(rho.shape[2]) > 0, 2.0, 1.0)
    held = np.einsum("lpqc,q->lp", rho**2, pairs).cumsum(axis=0).cumsum(axis=1)
    total = float(np.sum(np.asarray(spectrum.energy, float)))
    if not total > 0:
        raise ValueError("a BRDF without energy: every order is enough; give one that reflects")
    return 1 - held / total


def required_orders(spectrum: CentralSpectrum, tolerance: float) -> Orders:
    """Find the smallest P, and for it the smallest F, that miss less than ``tolerance`` (T 5.6.2).

    Raises ``ValueError`` for a tolerance outside (0, 1), and where the spectrum's own orders do not
    reach it, with what they do reach.
    """
    _check_tolerance(tolerance)
    missing = missing_energy(spectrum)
    enough = missing < tolerance
    if not enough.any():
        first, second = spectrum.band_limits
        raise ValueError(
            f"degrees to ({first}, {second}) miss {missing[-1, -1]:.3g} of the BRDF's energy, "
            f"above {tolerance:.3g}: compute its spectrum to more, or allow more"
        )
    viewer = int(np.argmax(enough.any(axis=0)))
    light = int(np.argmax(enough[:, viewer]))
    return Orders(light, viewer, float(missing[light, viewer]))


@checked
def missing_light(
    light: Float[AnyArray, "coefficient channel"], energy: float
) -> Float[np.ndarray, "degree"]:
    """Compute what part of the light's energy the degrees up to each F leave out (T 5.16).

    ``energy`` is the integral of L^2 over the sphere, all channels together.
    Raises ``ValueError`` for light without energy.
    """
    if not energy > 0:
        raise ValueError("light without energy: every degree is enough; give one that shines")
    values = np.asarray(light, float)
    band_limit = band_limit_of(values.shape[0])
    by_degree = np.bincount(
        degrees(band_limit), weights=np.sum(values**2, axis=1), minlength=band_limit + 1
    )
    return 1 - by_degree.cumsum() / energy


@checked
def residual_bound(
    light: Float[AnyArray, "coefficient channel"], energy: float, spectrum: CentralSpectrum
) -> Float[np.ndarray, "degree"]:
    """Bound the part of the reflected light's energy beyond each degree F, for every P kept.

    T 5.19 with B_res = Lambda_{F+1}^2 (e_L L_tot)(e_rho rho_tot) (ERRATA 36): all that is missing
    of both is supposed to meet in the next degree.  Light and spectrum to the same degree; a
    channel of the light meets that of the BRDF, or its only one.
    """
    values, rho = np.asarray(light, float), np.asarray(spectrum.coefficients, float)
    first = min(band_limit_of(values.shape[0]), rho.shape[0] - 1)
    left_light = missing_light(values, energy)[: first + 1]
    left_brdf = missing_energy(spectrum)[: first + 1, -1]
    wavelength = 4 * np.pi / (2 * np.arange(first + 2) + 1)
    power = np.zeros((first + 1, values.shape[1]))
    np.add.at(power, degrees(first), values[: (first + 1) ** 2] ** 2)
    pairs = np.where(np.arange(rho.shape[2]) > 0, 2.0, 1.0)
    filtered = np.einsum("lpqc,q->lc", rho[: first + 1] ** 2, pairs)
    held = np.cumsum(wavelength[:-1] * np.sum(power * filtered, axis=1))
    total = float(np.sum(np.asarray(spectrum.energy, float)))
    rest = wavelength[1:] * np.maximum(left_light, 0) * energy * np.maximum(left_brdf, 0) * total
    return rest / (held + rest)


def phong_order(exponent: float, tolerance: float) -> float:
    """F = sqrt(-s log e): the degree of a Phong lobe that leaves e of its energy out (T 5.28)."""
    _check_tolerance(tolerance)
    return float(np.sqrt(-exponent * np.log(tolerance)))


def phong_width(exponent: float, tolerance: float) -> float:
    """W = (1 - e^(1/(s+1))) / 2: the part of the sphere that holds 1 - e of a Phong lobe (T 5.30).

    Of the lobe itself, as printed: of its energy, its square, the power is 1 / (2s + 1) and W about
    half (ERRATA 38).
    """
    _check_tolerance(tolerance)
    return float((1 - tolerance ** (1 / (exponent + 1))) / 2)


def crossover_exponent(light_rows: int) -> float:
    """s* ~ S_L^(4/3): the Phong exponent above which sums over the light are cheaper (T 5.33).

    S_L^4 / 3 as printed is a lost exponent (ERRATA 39).
    """
    return float(light_rows) ** (4 / 3)


def _check_tolerance(tolerance: float):
    if not 0 < tolerance < 1:
        raise ValueError(f"tolerance {tolerance}: give a part of the energy between 0 and 1")
