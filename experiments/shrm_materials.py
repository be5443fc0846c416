"""The materials of T figure 5.1 as spectra about a central direction, cut as needed."""

from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF, IsotropicTable, Lafortune, Microfacet, fit_isotropic_table
from jaxrender.imaging.colour import rgb_of_reflectance
from jaxrender.io import read_cornell
from jaxrender.spectra import (
    CentralSpectrum,
    CentralTable,
    FacetLobe,
    central_spectrum,
    central_spectrum_of,
    lobe_ringing,
    missing_energy,
    required_orders,
    tabulated_spectrum,
    windowed_spectrum,
)

BAND_LIMIT, ORDER = 30, 5
FIBRES_ORDER, FIBRES_EXPONENT, FIBRES_ROWS = 8, 32.0, 128
TOLERANCE = {"microfacet": 0.01, "velvet": 0.01, "fibres": 0.03, "paint": 0.06}
SIGMA = 0.12
COPPER = np.array([0.95, 0.6, 0.42])
FIBRES = np.array([0.006, 0.003, 0.001]), np.array([0.4, 0.26, 0.13])


class Material(NamedTuple):
    """A spectrum about the central direction, and the same reflectance as it is.

    ``about_tangent``: the central direction is the tangent, not R.  ``divided``: the map, weighted
    by the exit cosine, is divided by it for the picture; T 5.34 is not.
    """

    spectrum: CentralSpectrum
    brdf: BRDF | None
    about_tangent: bool = False
    divided: bool = True


def microfacet(limits: tuple[int, int]) -> Material:
    """T 5.34, coloured as copper: rho^ cos t_o of T 6.2 without Fresnel."""
    lobe = FacetLobe(SIGMA)
    one = central_spectrum(lobe, limits, *lobe.extent, weighted=True)
    spectrum = CentralSpectrum(one.coefficients * COPPER, one.energy * COPPER**2, True)
    return Material(spectrum, Microfacet(np.zeros(3), COPPER, SIGMA, None), divided=False)


def paint_from(path: Path) -> IsotropicTable:
    """Read Cornell's measurements as a table in RGB."""
    data = read_cornell(path)
    rgb = rgb_of_reflectance(data.wavelengths, data.values)
    return fit_isotropic_table(data.incoming, data.outgoing, rgb).brdf


def paint(path: Path, limits: tuple[int, int]) -> Material:
    brdf = paint_from(path)
    return Material(central_spectrum_of(brdf, limits, weighted=True), brdf)


def velvet(limits: tuple[int, int]) -> Material:
    """(sin t_i sin t_o cos phi)^n forwards and backwards: dark from above, bright at grazing."""
    ks = np.array([[0.75, 0.12, 0.2], [0.5, 0.05, 0.1]])
    coefficients = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]])
    brdf = Lafortune(np.array([0.03, 0.004, 0.008]), ks, coefficients, np.array([6.0, 3.0]))
    return Material(central_spectrum_of(brdf, limits, weighted=True), brdf)


def fibres(limits: tuple[int, int]) -> Material:
    return Material(fibre_spectrum(limits), None, about_tangent=True, divided=False)


def fibre_spectrum(limits: tuple[int, int]) -> CentralSpectrum:
    """Kajiya and Kay's two lobes about the tangent, for all directions around the fibre."""
    cosines = np.cos(CentralTable.polar_angles(FIBRES_ROWS))
    values = fibre_lobes(cosines[:, None], cosines[None, :])
    table = CentralTable(jnp.asarray(values[:, :, None, :], float))
    return tabulated_spectrum(table, limits)


def fibre_lobes(incoming: jax.Array, outgoing: jax.Array) -> jax.Array:
    """kd sin t_i + ks max(-cos(t_i + t_o), 0)^s of the cosines to the tangent."""
    sine_in, sine_out = (jnp.sqrt(jnp.maximum(1 - c**2, 0)) for c in (incoming, outgoing))
    lobe = jnp.maximum(sine_in * sine_out - incoming * outgoing, 0) ** FIBRES_EXPONENT
    sine_in = jnp.broadcast_to(sine_in, lobe.shape)
    return sine_in[..., None] * FIBRES[0] + lobe[..., None] * FIBRES[1]


def chosen(name: str, spectrum: CentralSpectrum) -> CentralSpectrum:
    """Keep the orders that reach the tolerance, or all there are, and say what they miss."""
    tolerance = TOLERANCE[name]
    try:
        orders = required_orders(spectrum, tolerance)
        kept = spectrum.cut((orders.light, orders.viewer))
        verdict = "smallest that reach"
    except ValueError:
        kept, verdict = spectrum, "do NOT reach"
    missed = missing_energy(kept)[-1, -1]
    print(f"{name:11s}(F, P) = {kept.band_limits} miss {100 * missed:.1f} %: ", end="")
    print(f"{verdict} {100 * tolerance:.0f} %")
    return kept


def windowed(name: str, material: Material, window: str) -> Material:
    """Take the ringing off a lobe, or say how far it falls below zero."""
    before = material.spectrum
    after = before if window == "none" else windowed_spectrum(before, window)
    rings = [100 * lobe_ringing(spectrum) for spectrum in (before, after)]
    print(f"{name:11s}lowest value of the lobe {rings[0]:.1f} % of its peak, ", end="")
    print(f"window {window}: {rings[1]:.1f} %")
    return material._replace(spectrum=after)


def all_materials(measured: Path | None, window: str = "none") -> dict[str, Material]:
    """Each to the orders that its tolerance asks for, and through a window."""
    limits = BAND_LIMIT, ORDER
    found = {"microfacet": microfacet(limits)}
    if measured:
        found["paint"] = paint(measured, limits)
    found |= {"velvet": velvet(limits), "fibres": fibres((BAND_LIMIT, FIBRES_ORDER))}
    return {
        name: windowed(name, material._replace(spectrum=chosen(name, material.spectrum)), window)
        for name, material in found.items()
    }
