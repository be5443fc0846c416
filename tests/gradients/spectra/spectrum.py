"""Rows of the spectra of BRDFs, with their dependence on the viewer and without."""

import numpy as np

from jaxrender import spectra
from jaxrender.brdf import Microfacet, Phong
from jaxrender.spectra import CentralSpectrum, CentralTable, HemisphereRule

from ..page import Above, Row, Unit
from ..places import POLES, normal, unit
from .lobes import COSINES, HEAD_ON, LIMIT, NEARLY, NO_COSINE, SIGMA, WIDTHS, glossy, lobe, reach

LIMITS = (3, 2)
RULE = HemisphereRule(6, 12)
CENTRAL = {
    "coefficients": normal(4, 3, 3, 1),
    "energy": np.ones(1),
}

ROWS = [
    Row(
        "spectrum_of",
        lambda sigma, exponent: (
            spectra.spectrum_of(glossy(sigma), LIMIT),
            spectra.spectrum_of(Phong(sigma[None], sigma[None], exponent), LIMIT),
        ),
        {**SIGMA, "exponent": Above(np.array(9.5))},
        WIDTHS,
    ),
    Row(
        "spectrum_of",
        lambda sigma: spectra.spectrum_of(glossy(sigma), LIMIT, 0.6, numeric=True),
        SIGMA,
        at="numeric",
    ),
    Row(
        "central_spectrum",
        lambda sigma: spectra.central_spectrum(lobe(sigma), LIMITS, reach(sigma), weighted=True),
        SIGMA,
        WIDTHS,
    ),
    Row(
        "central_spectrum_of",
        lambda ks, sigma: spectra.central_spectrum_of(
            Microfacet(ks, ks, sigma, None), (2, 1), weighted=True
        ),
        {"ks": np.array([0.3, 0.5]), **SIGMA},
    ),
    Row(
        "CentralSpectrum.transfer_at",
        lambda coefficients, energy, exit_cosines: CentralSpectrum(
            coefficients, energy
        ).transfer_at(exit_cosines),
        {**CENTRAL, **COSINES},
        {"head-on": HEAD_ON, "near head-on": NEARLY},
        kinks=NO_COSINE,
    ),
    Row(
        "CentralSpectrum.cut",
        lambda coefficients, energy: CentralSpectrum(coefficients, energy).cut((2, 1)),
        CENTRAL,
    ),
    Row(
        "CentralSpectrum.windowed",
        lambda coefficients, by_light, by_viewer: CentralSpectrum(
            coefficients, coefficients[0, 0, 0]
        ).windowed(by_light, by_viewer),
        {"coefficients": CENTRAL["coefficients"], "by_light": normal(4), "by_viewer": normal(3)},
    ),
    Row(
        "windowed_spectrum",
        lambda coefficients: spectra.windowed_spectrum(
            CentralSpectrum(coefficients, coefficients[0, 0, 0]), "hann"
        ),
        {"coefficients": CENTRAL["coefficients"]},
    ),
    Row(
        "tabulated_spectrum",
        lambda values: spectra.tabulated_spectrum(CentralTable(values), LIMITS),
        {"values": normal(5, 4, 6, 1)},
    ),
    *(
        Row(
            name,
            lambda sigma, name=name: getattr(spectra, name)(glossy(sigma), LIMITS, RULE),
            {"sigma": Above(np.array(0.5))},
        )
        for name in ("isotropic_coefficients", "anisotropic_coefficients")
    ),
    Row(
        "outgoing_coefficients",
        lambda exit_cosines, sigma: spectra.outgoing_coefficients(
            glossy(sigma), exit_cosines, 3, RULE
        ),
        {**COSINES, "sigma": Above(np.array(0.5))},
    ),
    Row(
        "anisotropic_outgoing_coefficients",
        lambda outgoing, sigma: spectra.anisotropic_outgoing_coefficients(
            glossy(sigma), outgoing, 3, RULE
        ),
        {
            "outgoing": Unit(unit(2) * np.sign(unit(2)[:, 2:])),
            "sigma": Above(np.array(0.5)),
        },
        {"head-on": {"outgoing": Unit(np.stack([POLES["+Z"]] * 2))}},
    ),
    Row(
        "sum_lobes",
        spectra.sum_lobes,
        {"coefficients": normal(2, 4), "amplitudes": normal(2, 3, seed=1)},
    ),
]
