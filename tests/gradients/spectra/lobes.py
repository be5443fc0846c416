"""Lobes and exit cosines, at random and at the edges, which rows share."""

import numpy as np

from jaxrender import spectra
from jaxrender.brdf import Microfacet

from ..page import Above, Along

LIMIT = 4
COSINES = {"exit_cosines": np.array([0.8, 0.35])}
HEAD_ON = {"exit_cosines": Along(np.ones(2), -1.0)}
NEARLY = {"exit_cosines": Along(np.full(2, 1 - 1e-5), 1e-3)}
SIGMA = {"sigma": Above(np.array(0.2))}
WIDTHS = {
    "sigma .01": {"sigma": Above(np.array(0.01))},
    "sigma 1.5": {"sigma": Above(np.array(1.5))},
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


def lobe(sigma):
    """F S / (4 cos t_o) as the quadratures about R take it."""
    return glossy(sigma).specular_transfer


def reach(sigma):
    """Where it ends."""
    return spectra.extent_of(glossy(sigma), sigma.dtype).reach
