"""Rows of transfers: of lobes by the exit cosine, and of powers by the exponent."""

from functools import partial

import numpy as np

from jaxrender import spectra
from jaxrender.brdf import AnisotropicWard
from jaxrender.spectra import FacetLobe

from ..page import Above, Row
from .lobes import (
    COSINES,
    EXITS,
    HEAD_ON,
    LIMIT,
    NEARLY,
    NO_COSINE,
    SIGMA,
    WIDTHS,
    glossy,
    lobe,
    reach,
)

MU = {"mu": Above(np.array(1.5), 1)}
INDICES = {
    "mu 1.001": {"mu": Above(np.array(1.001), 1)},
    "mu 100": {"mu": Above(np.array(100.0), 1)},
}


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
        "transfer_table",
        lambda sigma, mu: spectra.transfer_table(glossy(sigma, mu), LIMIT, sigma.dtype),
        {**SIGMA, **MU},
        INDICES,
    ),
    Row(
        "transfer_at",
        lambda table, exit_cosines: spectra.transfer_at(table, exit_cosines),
        {"table": np.random.default_rng(3).normal(size=(64, 3)), **COSINES},
        kinks=NO_COSINE,
    ),
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
]
