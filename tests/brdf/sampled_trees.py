"""Trees of BRDFs from which the tests of samplers draw."""

import functools

import equinox as eqx
import numpy as np

from jaxrender.brdf import BRDF, Phong, Ward
from jaxrender.brdf.tables.cell_means import tabulate
from jaxrender.brdf.tree_sampler import TreeSampler
from jaxrender.geometry import NUSSELT
from jaxrender.wavelets.filters import haar
from jaxrender.wavelets.threshold import keep_fraction
from jaxrender.wavelets.transform import analyse_nonstandard
from jaxrender.wavelets.tree import CoefficientTree

SIZE = 16

KD, KS = np.array([0.05, 0.02]), np.array([0.4, 0.5])
PHONG = Phong(KD, KS, 100.0)
BRDFS = {
    "phong": (PHONG, 1.0, None),
    "phong at 1 %": (PHONG, 0.01, None),
    "ward": (Ward(KD, KS, 0.15, 0.4), 1.0, None),
    "ward, coarse": (Ward(KD, KS, 0.15, 0.4), 1.0, 3),
}
evaluate = eqx.filter_jit(BRDF.evaluate)


def tree_of(brdf, size=SIZE, fraction=1.0):
    centres = NUSSELT.centres((size, size)).reshape(-1, 2)
    directions = NUSSELT.cell_directions((size, size)).reshape(-1, 3)
    covered = np.asarray(NUSSELT.covers(centres))
    table = np.zeros((size**2, size**2, 2))
    upper = directions[covered]
    pairs = np.broadcast_arrays(upper[:, None], upper[None])
    table[np.ix_(covered, covered)] = evaluate(brdf, *(p.reshape(-1, 3) for p in pairs)).reshape(
        len(upper), len(upper), 2
    )
    coefficients = analyse_nonstandard(haar(), table.reshape(*(size,) * 4, 2))
    if fraction < 1:
        coefficients = keep_fraction(coefficients, fraction).coefficients
    return CoefficientTree.of_coefficients(haar(), coefficients)


@functools.lru_cache
def named(name):
    brdf, fraction, levels = BRDFS[name]
    return tree_of(brdf, fraction=fraction), levels


@functools.lru_cache
def samples_of(name):
    return np.asarray(named(name)[0].samples()).mean(axis=-1)


@functools.lru_cache
def fine():
    tree = tree_of(PHONG, 32)
    return TreeSampler.of(tree), np.asarray(tree.samples())[..., 0]


@functools.lru_cache
def filled():
    """A glossy table whose rim cells hold the means over what directions there are in them."""
    return CoefficientTree.of_coefficients(
        haar(),
        analyse_nonstandard(haar(), tabulate(PHONG, SIZE, dtype=np.float64, cell_samples=8).values),
    )


def outgoing_at(degrees, azimuth=None):
    """At a slant, unless grazing: there the cells' centres are outside the disc."""
    if azimuth is None:
        azimuth = 0.7 if degrees < 75 else 0.1
    polar = np.radians(degrees)
    flat = np.sin(polar) * np.array([np.cos(azimuth), np.sin(azimuth)])
    return np.array([*flat, np.cos(polar)])


def repeated(outgoing, count):
    return np.repeat(outgoing[None], count, axis=0)
