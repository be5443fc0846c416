"""A whole BRDF from few values, by what other materials have in common.

- Ten values at chosen pairs tell a material that was not learnt, its errors as large as stated.
- Chosen pairs leave what the formula of a Gaussian says, and less than others do.
- A material unlike those learnt is found out by its own values, and its errors grow.
- Noise is found where there are values enough.
"""

import numpy as np
import pytest
from learned_worlds import LEARNED, SHAPE, material_table, pairs_about

from jaxrender.brdf import IsotropicTable
from jaxrender.brdf.tables.measurements import Measurements
from jaxrender.inverse.completion import complete, next_pairs

NOISE = 0.03


def measured(table, pairs, seed=0):
    values = np.asarray(IsotropicTable(table[..., None]).evaluate(*pairs), float)
    noise = np.random.default_rng(seed).normal(size=values.shape)
    return Measurements(*pairs, values * (1 + NOISE * noise))


def off(found, table):
    """Errors at nodes that are known, relative, and over what is stated."""
    error = np.asarray(found.brdf.values)[..., 0] / np.maximum(table, 1e-9) - 1
    relative = error[LEARNED.known]
    return np.abs(relative), np.abs(relative) / found.relative_error[LEARNED.known][:, 0]


def test_ten_chosen_values_tell_a_material():
    chosen = next_pairs(LEARNED, 10)
    pairs = chosen.incoming, chosen.outgoing
    median, beyond = [], []
    for seed in range(12):
        table = material_table(100 + seed)
        relative, stated = off(complete(LEARNED, measured(table, pairs, seed), NOISE), table)
        median.append(np.median(relative))
        beyond.append(np.mean(stated > 1.645))
    assert np.median(median) < 0.06
    assert np.mean(beyond) < 0.2


def remaining(pairs):
    """The variance that is left of the whole table's after measuring at pairs, by the formula."""
    at = LEARNED.at_pairs(*pairs)
    whole = LEARNED.at_nodes(slice(None)).components[LEARNED.known.ravel()]
    told = at.components.T @ (at.components / (NOISE**2 + at.left_out)[:, None])
    after = np.sum((whole @ np.linalg.inv(told + np.eye(LEARNED.count))) * whole)
    return after / np.sum(whole**2)


def test_what_remains_is_the_variance_of_a_gaussian():
    chosen = next_pairs(LEARNED, 4, noise=NOISE)
    # The variance counts where both directions are high enough.
    assert chosen.remaining[-1] == pytest.approx(remaining(chosen[:2]), rel=0.3)
    assert np.all(np.diff(chosen.remaining) < 0)
    more = next_pairs(LEARNED, 1, Measurements(*chosen[:2], np.full((4, 1), 0.1)), NOISE)
    assert more.remaining[0] == pytest.approx(
        next_pairs(LEARNED, 5, noise=NOISE).remaining[-1], rel=1e-6
    )


def test_chosen_pairs_tell_more_than_others():
    chosen = remaining(next_pairs(LEARNED, 5, noise=NOISE)[:2])
    others = [remaining(pairs_about(5, seed)) for seed in range(20)]
    assert chosen < 0.8 * np.min(others)
    assert chosen < 0.3 * np.median(others)


def test_a_material_unlike_those_learnt_has_larger_errors():
    """A wave over the difference angle, which no learnt material has."""
    pairs = pairs_about(300, seed=1)
    table = material_table(100)
    wave = 1 + 0.5 * np.cos(2 * np.pi * np.arange(SHAPE[1]) / SHAPE[1])[None, :, None]
    plain = complete(LEARNED, measured(table, pairs), NOISE)
    strange = complete(LEARNED, measured(table * wave, pairs), NOISE)
    assert plain.excess[0] < 5
    assert strange.excess[0] > 10 * plain.excess[0]
    assert np.mean(off(strange, table * wave)[1] > 1.645) < 0.25


def test_noise_is_found():
    pairs = pairs_about(400, seed=2)
    values = measured(material_table(101), pairs)
    found = complete(LEARNED, values)
    assert found.noise[0] == pytest.approx(NOISE, rel=0.3)
    noisy = values._replace(values=values.values * (1 + 0.2 * np.sin(np.arange(400.0))[:, None]))
    assert complete(LEARNED, noisy).noise[0] > 3 * NOISE


def test_what_cannot_be_completed_is_refused():
    incoming, outgoing = pairs_about(5, seed=0)
    below = Measurements(-incoming, outgoing, np.ones((5, 1)))
    with pytest.raises(ValueError, match="channel 0 has no value above the horizon"):
        complete(LEARNED, below)
    with pytest.raises(ValueError, match="noise 0: give a relative deviation above 0"):
        complete(LEARNED, below, 0.0)
    with pytest.raises(ValueError, match="0 pairs: give at least 1"):
        next_pairs(LEARNED, 0)
