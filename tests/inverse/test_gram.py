"""One pass over the pixels, normal equations of every material.

- Where all exit cosines lie at nodes the binned equations are the streamed ones of the operator, to
  rounding, for every transfer, with and without shadows and weights of each channel.
- Between nodes the error is below 1e-3, and falls with the square of the nodes' distance.
- The equations are those of a least-squares problem: no negative curvature, no negative residual.
- Parts joined, and chunks, are the whole; samples of weight 0 count for nothing.
- Unlike parts, poor nodes, cosines below them, bad weights and short transfer vectors are refused.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from lighting_problems import glossy, samples_all_round

from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import coefficient_count
from jaxrender.inverse.factorization import stream
from jaxrender.inverse.factorization.gram import exit_cosine_nodes
from jaxrender.inverse.factorization.stream import Block, binned_gram
from jaxrender.inverse.lighting.normal_equations import normal_equations
from jaxrender.inverse.lighting.operator import light_operator

BAND_LIMIT, DIFFUSE = 5, 3
# Sums of some hundred products, in another order.
ROUNDING = 1e-10
# What interpolation between nodes may cost.
BINNING = 1e-3


def _block(count=400, seed=0, shadowed=False, weighted=False, at_nodes=None):
    rng = np.random.default_rng(seed)
    samples = samples_all_round(count, 0.2, seed)
    if at_nodes is not None:
        outgoing, cosines = np.asarray(samples.outgoing), rng.choice(at_nodes, count)[:, None]
        across = np.cross(outgoing, rng.normal(size=(count, 3)))
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        samples = SurfaceSamples(cosines * outgoing + np.sqrt(1 - cosines**2) * across, outgoing)
    vectors = rng.normal(size=(count, coefficient_count(DIFFUSE))) if shadowed else None
    unshadowed = (rng.uniform(size=count) > 0.3).astype(float) if shadowed else None
    weights = rng.uniform(0.5, 2, (count, 3)) if weighted else None
    return Block(samples, rng.uniform(0.1, 1, (count, 3)), weights, vectors, unshadowed)


def _dense(block, brdf, transfer):
    operator = light_operator(
        brdf,
        block.samples,
        BAND_LIMIT,
        transfer,
        transfer_vectors=block.transfer_vectors,
        unshadowed=block.unshadowed,
        diffuse_band_limit=DIFFUSE,
    )
    return normal_equations(operator, block.radiance, block.weights)


def _gram(block, nodes=None):
    return binned_gram([block], BAND_LIMIT, nodes, DIFFUSE)


def _assert_equal(found, expected, tolerance):
    for name, one, other in zip(found._fields, found, expected):
        scale = np.max(np.abs(other))
        np.testing.assert_allclose(one, other, atol=tolerance * scale, err_msg=name)


@pytest.mark.parametrize("transfer", ["none", "exit-cosine", "gaussian"])
@pytest.mark.parametrize(("shadowed", "weighted"), [(False, False), (True, True)])
def test_at_the_nodes_nothing_is_lost(transfer, shadowed, weighted):
    nodes = exit_cosine_nodes(0.2, 7)
    block = _block(shadowed=shadowed, weighted=weighted, at_nodes=nodes)
    brdf = glossy(0.2, 1.6)
    found = _gram(block, nodes).equations_of(brdf, transfer)
    _assert_equal(found, _dense(block, brdf, transfer), ROUNDING)


@pytest.mark.parametrize("transfer", ["none", "exit-cosine"])
def test_between_the_nodes_the_error_is_small_and_of_second_order(transfer):
    block, brdf = _block(2000), glossy(0.12, 1.5)
    expected = _dense(block, brdf, transfer)

    def error(nodes):
        found = _gram(block, nodes).equations_of(brdf, transfer)
        return np.max(np.abs(found.gram - expected.gram)) / np.max(np.abs(expected.gram))

    assert error(None) < BINNING
    coarse, fine = error(exit_cosine_nodes(0.2, 17)), error(exit_cosine_nodes(0.2, 33))
    assert coarse / fine == pytest.approx(4, rel=0.15)


def test_the_equations_are_of_least_squares():
    """Few samples, so that the normal matrix is singular and a defect would show as negative."""
    block = _block(30)
    gram = _gram(block, exit_cosine_nodes(0.2, 6))
    found = gram.equations_of(glossy(), "none")
    values = np.linalg.eigvalsh(np.asarray(found.gram))
    assert np.all(values > -1e-12 * values.max())
    for matrix, moment, energy in zip(found.gram, found.moment, found.energy):
        light = np.linalg.pinv(np.asarray(matrix), rcond=1e-10) @ np.asarray(moment)
        assert float(energy - light @ np.asarray(moment)) > -1e-10


def test_parts_and_chunks_make_the_whole(monkeypatch):
    block, nodes = _block(300, weighted=True), exit_cosine_nodes(0.2, 9)
    whole = _gram(block, nodes)
    cut = [
        Block(SurfaceSamples(*(a[rows] for a in block.samples)), block.radiance[rows], w)
        for rows in (slice(0, 130), slice(130, None))
        for w in [np.asarray(block.weights)[rows]]
    ]
    joined = _gram(cut[0], nodes).joined(_gram(cut[1], nodes))
    monkeypatch.setattr(stream, "_CHUNK", 64)
    for other in (joined, _gram(block, nodes), binned_gram(cut, BAND_LIMIT, nodes, DIFFUSE)):
        for name in ("products", "moments", "energies", "measured", "counts"):
            expected = getattr(whole, name)
            np.testing.assert_allclose(
                getattr(other, name), expected, atol=1e-12 * np.max(np.abs(expected))
            )
        np.testing.assert_array_equal(other.nodes, nodes)


def test_counts_and_channels():
    block, nodes = _block(200, weighted=True), exit_cosine_nodes(0.2, 9)
    gram = _gram(block, nodes)
    assert gram.counts.sum() == pytest.approx(np.sum(np.asarray(block.weights) ** 2))
    every, brdf = gram.equations_of(glossy()), glossy()
    for shared in (False, True):
        whole = _gram(block._replace(weights=None), nodes) if shared else gram
        every = whole.equations_of(brdf, "none")
        passed = np.asarray(_fresnel(brdf, nodes))
        alone = whole.of_channel(1).equations(jnp.asarray(passed), brdf.kd[1:2], brdf.ks[1:2])
        np.testing.assert_allclose(alone.gram[0], every.gram[1], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(alone.moment[0], every.moment[1], rtol=1e-12, atol=1e-12)


def _fresnel(brdf, nodes):
    from jaxrender.brdf import normalised_fresnel

    return np.repeat(normalised_fresnel(brdf.mu, jnp.asarray(nodes))[:, None], BAND_LIMIT + 1, 1)


def test_samples_of_weight_zero_count_for_nothing():
    block, nodes = _block(100, weighted=True), exit_cosine_nodes(0.2, 5)
    weights, radiance = np.array(block.weights), np.array(block.radiance)
    weights[60:], radiance[60:] = 0, np.nan
    weights[0, 1], radiance[0, 1] = 0, np.nan
    less = block._replace(weights=weights, radiance=radiance)
    rows = slice(0, 60)
    few = Block(
        SurfaceSamples(*(a[rows] for a in block.samples)),
        np.nan_to_num(radiance[rows]),
        weights[rows],
    )
    found, expected = _gram(less, nodes), _gram(few, nodes)
    np.testing.assert_allclose(found.products, expected.products)
    np.testing.assert_array_equal(found.measured, [60, 59, 60])


def test_what_is_refused():
    block, nodes = _block(50), exit_cosine_nodes(0.2, 5)
    gram = _gram(block, nodes)
    with pytest.raises(ValueError, match="unlike kinds"):
        gram.joined(_gram(_block(50, weighted=True), nodes))
    with pytest.raises(ValueError, match="unlike kinds"):
        gram.joined(_gram(block, exit_cosine_nodes(0.15, 5)))
    with pytest.raises(ValueError, match="below the first node"):
        _gram(block, exit_cosine_nodes(0.9, 5))
    with pytest.raises(ValueError, match="must rise"):
        _gram(block, np.array([0.2, 0.9]))
    with pytest.raises(ValueError, match="two nodes or more"):
        exit_cosine_nodes(0.0)
    with pytest.raises(ValueError, match="not negative"):
        _gram(block._replace(weights=-np.ones((50, 1))))
    with pytest.raises(ValueError, match="2 weights a sample"):
        _gram(block._replace(weights=np.ones((50, 2))))
    with pytest.raises(ValueError, match="not finite"):
        _gram(block._replace(radiance=np.full((50, 3), np.nan)))
    with pytest.raises(ValueError, match="4 transfer coefficients where 16"):
        _gram(block._replace(transfer_vectors=np.ones((50, 4))))
    with pytest.raises(ValueError, match="differ in channels"):
        binned_gram([block, _block(50, weighted=True)], BAND_LIMIT, nodes, DIFFUSE)
    with pytest.raises(ValueError, match="no samples"):
        binned_gram([], BAND_LIMIT)
    with pytest.raises(ValueError, match="choose one of none"):
        gram.equations_of(glossy(), "sharp")
