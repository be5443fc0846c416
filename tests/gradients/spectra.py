"""Rows of ``jaxrender.spectra``."""

from functools import partial

import numpy as np

from jaxrender import spectra
from jaxrender.brdf import AnisotropicWard, Microfacet, Phong
from jaxrender.lighting import ClearSky, DirectionalSources, Environment, HarmonicLight, OvercastSky
from jaxrender.spectra import CentralSpectrum, CentralTable, FacetLobe, HemisphereRule

from .page import Above, Along, Row, Unit
from .places import POLES, normal, unit

LIMIT = 4
COSINES = {"exit_cosines": np.array([0.8, 0.35])}
HEAD_ON = {"exit_cosines": Along(np.ones(2), -1.0)}
NEARLY = {"exit_cosines": Along(np.full(2, 1 - 1e-5), 1e-3)}
SIGMA = {"sigma": Above(np.array(0.2))}
MU = {"mu": Above(np.array(1.5), 1)}
WIDTHS = {
    "sigma .01": {"sigma": Above(np.array(0.01))},
    "sigma 1.5": {"sigma": Above(np.array(1.5))},
}
INDICES = {
    "mu 1.001": {"mu": Above(np.array(1.001), 1)},
    "mu 100": {"mu": Above(np.array(100.0), 1)},
}
EXITS = {
    "head-on": HEAD_ON,
    "near head-on": NEARLY,
    "grazing": {"exit_cosines": np.array([0.05, 0.03])},
}
NO_COSINE = {"head-on": "of the angle it is smooth: by the cosine it has digits only beside 1"}


def glossy(sigma, mu=None, **static):
    """A microfacet of one channel in the precision of its roughness."""
    return Microfacet(np.ones(1, sigma.dtype), np.ones(1, sigma.dtype), sigma, mu, **static)


def transfer(name: str, at: str = "", edges: dict | None = None, index: bool = True, **static):
    """A transfer by sigma, mu and the exit cosine."""
    function = getattr(spectra, name)

    def call(exit_cosines, sigma, mu=None):
        return function(glossy(sigma, mu, **static), exit_cosines, LIMIT)

    arguments = {**COSINES, **SIGMA, **(MU if index else {})}
    everything = {**WIDTHS, **EXITS, **(INDICES if index else {})} if edges is None else edges
    kinks = NO_COSINE if "head-on" in everything else {}
    return Row(name, call, arguments, everything, kinks=kinks, at=at)


def facets(name: str, distribution: str) -> Row:
    """A transfer of facets, all their factors."""
    function = getattr(spectra, name)
    rest = (LIMIT,) if name == "facet_transfer" else (LIMIT, 2)

    def call(exit_cosines, sigma, mu):
        return function(FacetLobe(sigma, mu, distribution, "smith", "half"), exit_cosines, *rest)

    widths = WIDTHS if distribution == "gaussian" else {"sigma .01": WIDTHS["sigma .01"]}
    edges = {**widths, **EXITS, **INDICES}
    return Row(name, call, {**COSINES, **SIGMA, **MU}, edges, kinks=NO_COSINE, at=distribution)


def phong(name: str) -> Row:
    """A transfer by the exponent."""
    edges = {
        "an even degree": {"exponent": Above(np.array(2.0))},
        "0.01": {"exponent": Above(np.array(0.01))},
        "1e6": {"exponent": Above(np.array(1e6))},
    }
    call = partial(getattr(spectra, name), band_limit=6)
    return Row(name, call, {"exponent": Above(np.array(7.3))}, edges)


def lobe(sigma):
    """F S / (4 cos t_o) as the quadratures about R take it."""
    return glossy(sigma).specular_transfer


def reach(sigma):
    """Where it ends."""
    return spectra.extent_of(glossy(sigma), sigma.dtype).reach


AXES = {place: {"axis": Unit(pole)} for place, pole in POLES.items()}
AXIS = {"axis": Unit(unit(1)[0])}
SUN = np.array([0.48, 0.36, 0.8])
COLOUR = np.array([0.7, 1.2])
LIMITS = (3, 2)
RULE = HemisphereRule(6, 12)
CENTRAL = {
    "coefficients": normal(4, 3, 3, 1),
    "energy": np.ones(1),
}

ROWS = [
    transfer("exit_cosine_transfer"),
    transfer("exit_cosine_transfer", "no index", index=False),
    transfer("normal_exitance_transfer", edges={**WIDTHS, **INDICES}),
    transfer("gaussian_transfer"),
    Row(
        "exit_cosine_transfer",
        lambda exit_cosines, sigma: spectra.exit_cosine_transfer(glossy(sigma), exit_cosines, 0),
        {**COSINES, **SIGMA},
        WIDTHS,
        at="degree 0",
    ),
    transfer("transfer_of_samples", edges={**WIDTHS, **INDICES}),
    Row(
        "azimuthal_transfer_of_samples",
        lambda exit_cosines, sigma: spectra.azimuthal_transfer_of_samples(
            glossy(sigma, sigma * 0 + 1.5), exit_cosines, 2
        ),
        {**COSINES, **SIGMA},
        {"sigma .01": WIDTHS["sigma .01"], "head-on": HEAD_ON, "near head-on": NEARLY},
        kinks=NO_COSINE,
    ),
    *(facets("facet_transfer", name) for name in spectra.FACET_DISTRIBUTIONS),
    facets("facet_azimuthal_transfer", "gaussian"),
    Row(
        "mean_transfer",
        lambda exit_cosines, sigma: spectra.mean_transfer(
            lobe(sigma), exit_cosines, LIMIT, reach(sigma)
        ),
        {**COSINES, **SIGMA},
        {"head-on": HEAD_ON, "near head-on": NEARLY},
        kinks=NO_COSINE,
    ),
    Row(
        "azimuthal_transfer",
        lambda exit_cosines, sigma: spectra.azimuthal_transfer(
            lobe(sigma), exit_cosines, (LIMIT, 2), reach(sigma)
        ),
        {**COSINES, **SIGMA},
        {"head-on": HEAD_ON, "near head-on": NEARLY},
        kinks=NO_COSINE,
    ),
    Row(
        "extent_of",
        lambda sigma: tuple(spectra.extent_of(glossy(sigma), sigma.dtype)),
        SIGMA,
        WIDTHS,
    ),
    Row("FacetLobe.extent", lambda sigma: tuple(FacetLobe(sigma).extent), SIGMA, WIDTHS),
    Row(
        "head_on_transfer",
        lambda sigma, ward: (
            spectra.head_on_transfer(glossy(sigma), LIMIT),
            spectra.head_on_transfer(
                AnisotropicWard(np.ones(1, ward.dtype), np.ones(1, ward.dtype), ward, 2 * ward), 2
            ),
        ),
        {**SIGMA, "ward": Above(np.array(0.3))},
        {"sigma 1.5": WIDTHS["sigma 1.5"]},
    ),
    Row(
        "matched_gaussian_transfer",
        partial(spectra.matched_gaussian_transfer, band_limit=LIMIT),
        SIGMA,
        WIDTHS,
    ),
    *(
        phong(name)
        for name in (
            "phong_transfer",
            "phong_transfer_by_gamma",
            "gaussian_phong_transfer",
            "matched_phong_transfer",
            "power_transfer",
        )
    ),
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
    Row(
        "series_transfer",
        partial(spectra.series_transfer, band_limit=3),
        {**SIGMA, **COSINES},
        {**WIDTHS, "1": {"exit_cosines": np.ones(2)}},
    ),
    Row(
        "squared_half_angle",
        spectra.squared_half_angle,
        {"angles": np.array([0.1, 0.3]), "azimuths": np.array([0.4, 2.0]), **COSINES},
        {"at R": {"angles": np.zeros(2)}},
    ),
    Row(
        "directional_coefficients",
        partial(spectra.directional_coefficients, band_limit=3),
        {"direction": Unit(unit(1)[0]), "irradiance": COLOUR},
        {place: {"direction": Unit(pole)} for place, pole in POLES.items()},
    ),
    Row(
        "zonal_coefficients",
        spectra.zonal_coefficients,
        {"transfer": normal(4, 2), **AXIS},
        AXES,
    ),
    Row(
        "axial_coefficients",
        lambda axis: spectra.axial_coefficients(lambda c: np.exp(2 * c), axis, 3),
        AXIS,
        AXES,
    ),
    Row(
        "uniform_coefficients",
        partial(spectra.uniform_coefficients, band_limit=2),
        {"radiance": COLOUR},
    ),
    Row(
        "overcast_coefficients",
        lambda zenith: spectra.overcast_coefficients(OvercastSky(zenith), 3),
        {"zenith": COLOUR},
    ),
    Row(
        "clear_coefficients",
        lambda sun, zenith: spectra.clear_coefficients(ClearSky(sun, zenith), 3),
        {"sun": Unit(SUN), "zenith": COLOUR},
        {
            "overhead": {"sun": Unit(POLES["+Z"])},
            "low": {"sun": Unit(np.array([0.8, -0.6, 0.0]) * np.cos(0.05) + [0, 0, np.sin(0.05)])},
        },
        kinks={"overhead": "in parts of the radiance at the zenith, which has a cusp at the sun"},
    ),
    Row(
        "light_coefficients",
        lambda radiance, coefficients, directions, irradiance, zenith: tuple(
            spectra.light_coefficients(light, 2)
            for light in (
                Environment(radiance),
                HarmonicLight(coefficients),
                DirectionalSources(directions, irradiance),
                OvercastSky(zenith),
            )
        ),
        {
            "radiance": Above(np.random.default_rng(0).uniform(0.1, 2, (5, 10, 2))),
            "coefficients": normal(4, 2),
            "directions": Unit(unit(2)),
            "irradiance": normal(2, 2),
            "zenith": COLOUR,
        },
        {
            "sources at the poles": {"directions": Unit(np.stack(list(POLES.values())))},
        },
    ),
]

_HOST = "a table, made on the host from whole numbers"
_ORDERS = "counts orders, on the host"
_RULE = "one number on the host: a rule of thumb"
_NODES = "says where nodes are, on which an integral does not depend"
EXCEPTIONS = {
    **dict.fromkeys(
        (
            "clipped_mirror_coefficients",
            "lambertian_transfer",
            "mirror_coefficients",
            "mirror_transfer",
        ),
        _HOST,
    ),
    **dict.fromkeys(("missing_energy", "missing_light", "required_orders"), _ORDERS),
    "residual_bound": _ORDERS,
    "mean_transfer.reach": _NODES,
    "mean_transfer.tail": _NODES,
    "azimuthal_transfer.reach": _NODES,
    "azimuthal_transfer.tail": _NODES,
    "central_spectrum.reach": _NODES,
    "central_spectrum.tail": _NODES,
    **dict.fromkeys(("crossover_exponent", "phong_order", "phong_width"), _RULE),
    "CentralTable": "numbers; tabulated_spectrum has their row",
    "lobe_ringing": "one number, found on the host by looking everywhere",
    "HemisphereRule": "a static rule, whose nodes are made on the host",
    "Orders": "what required_orders gives: whole numbers",
}
