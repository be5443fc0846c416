"""What measured materials have in common, learnt from tables of models.

- A learnt column is its mean plus components, up to what is left out; its coefficients have
  variance 1.
- What is left out is that of materials that were not learnt.
- Nodes that were not measured of all materials hold what their neighbours do.
- Logarithms and values undo one another; at a node's own directions the row is the node's.
"""

import numpy as np
import pytest

from jaxrender.brdf import IsotropicTable, Microfacet
from jaxrender.brdf.tables.isotropic import node_angles, pair_at
from jaxrender.brdf.tables.learned import learn_materials, node_cosines

SHAPE = (14, 10, 8)


def tables(count, seed=0):
    """Glossy materials of one channel, as [channel, theta_h, theta_d, phi_d], at nodes above."""
    rng, found = np.random.default_rng(seed), []
    incoming, outgoing = pair_at(node_angles(SHAPE))
    above = (incoming[..., 2] > 0) & (outgoing[..., 2] > 0)
    for _ in range(count):
        kd, ks = np.exp(rng.uniform(-4, -1, 1)), np.exp(rng.uniform(-4, -1, 1))
        material = Microfacet(kd, ks, float(np.exp(rng.uniform(-2.5, -0.7))), 1.5)
        values = np.asarray(IsotropicTable.of(material, SHAPE).values)[..., 0]
        found.append(np.where(above, values, -1.0)[None])
    return found


TABLES = tables(40)
LEARNED = learn_materials(TABLES, np.ones(1), 8)
KNOWN = LEARNED.known.ravel()


def squares_left(learned, some):
    """What the components leave of the logarithms of some materials, and the coefficients."""
    known = learned.known.ravel()
    at = learned.at_nodes(slice(None))
    values = np.stack([np.maximum(one, 0).ravel() for one in some], axis=1)
    off = (at.logs(values) - at.mean[:, None])[known]
    components = at.components[known]
    found, *_ = np.linalg.lstsq(components, off, rcond=None)
    return np.mean((off - components @ found) ** 2), found, np.mean(off**2)


def test_learnt_columns_are_sums_of_components():
    left, coefficients, whole = squares_left(LEARNED, TABLES)
    np.testing.assert_allclose(np.mean(coefficients**2, axis=1), 1, rtol=1e-3)
    np.testing.assert_allclose(np.mean(coefficients, axis=1), 0, atol=1e-3)
    assert left < 2e-3 * whole


def test_what_is_left_out_is_that_of_other_materials():
    """Of those learnt themselves three components leave a quarter less."""
    pool = tables(160, seed=1)
    stated, own, others = [], [], []
    for first in range(0, 160, 40):
        mine = pool[first : first + 40]
        few = learn_materials(mine, np.ones(1), 3)
        stated.append(np.mean(few.at_nodes(slice(None)).left_out[few.known.ravel()]))
        own.append(squares_left(few, mine)[0])
        others.append(squares_left(few, pool[:first] + pool[first + 40 :])[0])
    assert np.mean(stated) == pytest.approx(np.mean(others), rel=0.3)
    assert np.mean(own) < 0.75 * np.mean(others)


def test_nodes_that_one_material_lacks_are_like_their_neighbours():
    lacking = [one.copy() for one in TABLES]
    lacking[3][0, 5, 4, 2] = -1
    found = learn_materials(lacking, np.ones(1), 8)
    assert LEARNED.known[5, 4, 2]
    assert not found.known[5, 4, 2]
    np.testing.assert_array_equal(found.table[5, 4, 2], found.table[5, 3, 2])


def test_values_and_logarithms_undo_one_another():
    at = LEARNED.at_nodes(slice(100, 400))
    values = np.random.default_rng(0).uniform(0.01, 3, (300, 1))
    np.testing.assert_allclose(at.values(at.logs(values)[:, 0]), values[:, 0], rtol=1e-9)
    step = 1e-6
    slope = (at.values(at.mean + step) - at.values(at.mean - step)) / (2 * step)
    np.testing.assert_allclose(at.slopes(at.mean), slope, rtol=1e-6)


def test_a_pair_at_a_node_is_the_node():
    incoming, outgoing = (pair.reshape(-1, 3) for pair in pair_at(node_angles(SHAPE)))
    some = KNOWN & (node_cosines(SHAPE) > 0.01)
    at, node = LEARNED.at_pairs(incoming[some], outgoing[some]), LEARNED.at_nodes(slice(None))
    np.testing.assert_allclose(at.cosine, node.cosine[some], rtol=1e-9)
    np.testing.assert_allclose(at.components, node.components[some], atol=1e-5)


@pytest.mark.parametrize(
    ("some", "count", "message"),
    [
        (TABLES[:4], 1, "4 materials: give at least 5"),
        (TABLES[:6], 4, "4 components: 6 columns tell 1 to 3"),
        ([*TABLES[:6], TABLES[0][:, :4]], 2, "give all one size"),
        ([*TABLES[:6], -np.ones_like(TABLES[0])], 2, "no node was measured of all materials"),
    ],
)
def test_what_cannot_be_learnt_from_is_refused(some, count, message):
    with pytest.raises(ValueError, match=message):
        learn_materials(some, np.ones(1), count)
