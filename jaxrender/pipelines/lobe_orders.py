"""How many degrees of the light and of the viewer a lobe needs (T 5.5.1, 5.6.2).

A lobe's spectrum is computed about its central direction.  Degrees are added until the spectrum
holds all but a tolerated part of the lobe's energy.  Then the smallest P is kept, and for it the
smallest F.

Spectra are *weighted*: they are of the lobe times cos t_o, for every model but Phong's powers of
R . w_i.  Facets without masking rise as 1 / cos t_o towards grazing exit, and have no finite energy
about R.  One rule for all models keeps their orders comparable.  The error of a weighted map is
divided by cos t_o, so it shows towards grazing.  An example is a sphere of sigma .2 under Grace
Cathedral.  At a tolerance of 3 % it is off by 5 % where cos t_o is above .5, and by 22 % from there
to .15.  At 1 % it is off by 1.6 and 12 %.

The clamped cosine is radially symmetric about the normal.  An unclipped Phong lobe without a base
is so about R.  Both are exact with P = 0.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Lambertian, Phong
from jaxrender.errors import InputError
from jaxrender.pipelines.lobes import Lobe
from jaxrender.shapes import Float
from jaxrender.spectra import (
    CentralSpectrum,
    Orders,
    central_spectrum_of,
    lambertian_transfer,
    missing_energy,
    phong_transfer,
    required_orders,
)

TOLERANCE = 0.03
# (F, P) that spectra are computed to, one after the other, while more is needed.  Beyond the last a
# map is no longer smooth enough to be worth it, and a spectrum takes gigabytes.
_STEPS = ((24, 6), (64, 10))
# What may be asked for by number.
_MOST_LIGHT, _MOST_VIEWER = 128, 12


class OrdersGoal(NamedTuple):
    """A tolerated part of the lobe's energy, and degrees given instead of chosen."""

    tolerance: float = TOLERANCE
    viewer: int | None = None
    light: int | None = None

    def check(self, carried: int = _MOST_LIGHT) -> None:
        """Raise ``InputError`` for a tolerance or degrees that cannot be.

        ``carried`` is the highest degree of the light.
        """
        if not 0 < self.tolerance < 1:
            raise InputError(
                f"--tolerance {self.tolerance:g}: give a part of the energy between 0 and 1, "
                f"such as {TOLERANCE}"
            )
        most = min(carried, _MOST_LIGHT)
        whose = "the probe carries" if carried < _MOST_LIGHT else "a map is made to"
        for name, given, limit, reason in (
            ("--view-degree", self.viewer, _MOST_VIEWER, f"a map is made to {_MOST_VIEWER}"),
            ("--degree", self.light, most, f"{whose} {most}"),
        ):
            if given is not None and not 0 <= given <= limit:
                raise InputError(f"{name} {given}: give a degree from 0 to {limit}; {reason}")


class LobeOrders(NamedTuple):
    """The degrees chosen, the spectrum they were chosen from, and whether they suffice."""

    orders: Orders
    spectrum: CentralSpectrum
    reached: bool

    @property
    def kept(self) -> CentralSpectrum:
        """The spectrum to the degrees chosen."""
        return self.spectrum.cut((self.orders.light, self.orders.viewer))

    @property
    def least_missing(self) -> float:
        """The part of the energy that all degrees tried leave out."""
        return float(missing_energy(self.spectrum)[-1, -1])


def lobe_orders(lobe: Lobe, goal: OrdersGoal, carried: int = _STEPS[-1][0]) -> LobeOrders:
    """Choose (F, P) for a lobe under light of degrees up to ``carried`` (T 5.6.2).

    Where no degrees tried suffice, the chosen ones miss at most the tolerance more than the highest
    ones do.  Raises ``InputError`` for a mirror.
    """
    if lobe.brdf is None:
        raise InputError(
            f"--brdf {lobe.specification}: a mirror's spectrum never ends, so no degrees suffice; "
            "show the light itself, or give a lobe of some width"
        )
    found: LobeOrders | None = None
    for step in _STEPS:
        first = min(step[0], carried) if goal.light is None else goal.light
        viewer = step[1] if goal.viewer is None else goal.viewer
        if found is not None and found.spectrum.band_limits == (first, viewer):
            break
        found = _chosen(spectrum_of_lobe(lobe, (first, viewer)), goal)
        if found.reached:
            break
    assert found is not None, "there is a first step"
    return found


def spectrum_of_lobe(lobe: Lobe, band_limits: tuple[int, int]) -> CentralSpectrum:
    """Compute rho_lpq about the lobe's central direction; it is weighted, except Phong's."""
    brdf = lobe.brdf
    if isinstance(brdf, Lambertian):
        scale = float(np.ravel(brdf.kd)[0])
        transfer = scale * lambertian_transfer(band_limits[0])
        return _radial(transfer, scale**2 * 2 * np.pi / 3)
    if isinstance(brdf, Phong):
        if not brdf.clipped and not np.any(np.asarray(brdf.kd)):
            scale, exponent = float(np.ravel(brdf.ks)[0]), float(brdf.exponent)
            transfer = scale * np.asarray(phong_transfer(np.asarray(exponent), band_limits[0]))
            return _radial(transfer, scale**2 * (exponent + 1) ** 2 / (4 * exponent + 2) / np.pi)
        return central_spectrum_of(brdf, band_limits)
    assert brdf is not None, "a mirror is refused before"
    return central_spectrum_of(brdf, band_limits, weighted=True)


def _radial(transfer: Float[np.ndarray, "degree"], energy: float) -> CentralSpectrum:
    """A lobe of one angle, A_l = Lambda_l rho_l00 Y_00; ``energy`` is its square over w_i."""
    degree = np.arange(len(transfer))
    rho = transfer * np.sqrt(2 * degree + 1)
    return CentralSpectrum(rho[:, None, None, None], np.array([4 * np.pi * energy]))


def _chosen(spectrum: CentralSpectrum, goal: OrdersGoal) -> LobeOrders:
    """Choose the smallest P, then F, of those not given."""
    missing = missing_energy(spectrum)
    if goal.light is not None and goal.viewer is not None:
        # A lobe of one angle has P = 0 whatever is given.
        orders = Orders(*spectrum.band_limits, float(missing[-1, -1]))
        return LobeOrders(orders, spectrum, orders.missing < goal.tolerance)
    if goal.light is None and goal.viewer is None and missing[-1, -1] < goal.tolerance:
        return LobeOrders(required_orders(spectrum, goal.tolerance), spectrum, True)
    # With a degree given, or out of reach, the other is asked to lose no more than it must.
    reached = bool(missing[-1, -1] < goal.tolerance)
    bound = goal.tolerance + (0.0 if reached else max(float(missing[-1, -1]), 0.0))
    first, second = spectrum.band_limits
    viewer = int(np.argmax(missing[first] < bound)) if goal.viewer is None else second
    light = int(np.argmax(missing[:, viewer] < bound)) if goal.light is None else first
    return LobeOrders(Orders(light, viewer, float(missing[light, viewer])), spectrum, reached)
