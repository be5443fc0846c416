"""Materials to learn from, and others that are completed: tables of the thesis's lobe."""

import numpy as np

from jaxrender.brdf import IsotropicTable, Microfacet
from jaxrender.brdf.tables.isotropic import node_angles, pair_at
from jaxrender.brdf.tables.learned import learn_materials

SHAPE = (14, 10, 8)


def material_table(seed):
    """One channel of a glossy material at the nodes; it has a value everywhere."""
    rng = np.random.default_rng(seed)
    kd, ks = np.exp(rng.uniform(-4, -1, (2, 1)))
    width = float(np.exp(rng.uniform(-1.6, -0.7)))
    return np.asarray(IsotropicTable.of(Microfacet(kd, ks, width, 1.5), SHAPE).values)[..., 0]


def pairs_about(count, seed):
    """Pairs of directions within 75 degrees, half of them near the mirror direction."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(2):
        height, azimuth = rng.uniform(0.26, 1, count), rng.uniform(0, 2 * np.pi, count)
        across = np.sqrt(1 - height**2)
        found.append(np.stack([across * np.cos(azimuth), across * np.sin(azimuth), height], 1))
    incoming, outgoing = found
    outgoing[::2] = incoming[::2] * [-1, -1, 1]
    return incoming, outgoing


def _learned():
    incoming, outgoing = pair_at(node_angles(SHAPE))
    above = (incoming[..., 2] > 0) & (outgoing[..., 2] > 0)
    tables = [np.where(above, material_table(seed), -1.0)[None] for seed in range(60)]
    return learn_materials(tables, np.ones(1), 10)


LEARNED = _learned()
