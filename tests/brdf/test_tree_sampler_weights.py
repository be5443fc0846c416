"""Weights of directions drawn from trees of BRDFs.

Pinned down: the furnace (weights rho cos / p have the albedo as their mean: the factor 4 of ERRATA
74 and 75); one bounce of smooth light has 20 times less variance than with cosine-weighted and with
uniform directions.
"""

import numpy as np
import pytest
from sampled_trees import BRDFS, PHONG, evaluate, fine, named, outgoing_at, repeated

from jaxrender.brdf import directional_albedo
from jaxrender.brdf.tree_sampler import TreeSampler


@pytest.mark.parametrize(
    ("name", "degrees"),
    [(name, degrees) for degrees in (40, 75) for name in BRDFS] + [("phong", 0)],
)
def test_the_mean_weight_is_the_albedo(name, degrees):
    """In the printed form, without the 4, it would be a quarter of it."""
    brdf, (tree, levels) = BRDFS[name][0], named(name)
    sampler = TreeSampler.of(tree, levels=levels)
    outgoing = repeated(outgoing_at(degrees), 60_000)
    uniforms = np.random.default_rng(degrees).random((len(outgoing), 2))
    incoming = np.asarray(sampler.draw(outgoing, uniforms))
    density = np.asarray(sampler.density(outgoing, incoming))
    upward = density > 0
    reflected = np.asarray(evaluate(brdf, incoming, outgoing)) * incoming[:, 2:]
    assert not reflected[~upward].any()
    weights = reflected / np.where(upward, density, 1)[:, None]
    error = weights.std(axis=0) / np.sqrt(len(weights))
    albedo = directional_albedo(
        brdf, [np.cos(np.radians(degrees))], "outgoing", 0.7 if degrees < 75 else 0.1
    )[0]
    assert np.all(np.abs(weights.mean(axis=0) - albedo) < 3.5 * error)
    assert np.all(error < 0.03 * albedo)


def weights_of(way, sampler, outgoing, uniforms):
    """Directions of one of three samplers, and the inverse of their density."""
    if way == "tree":
        drawn = np.asarray(sampler.draw(outgoing, uniforms))
        density = np.asarray(sampler.density(outgoing, drawn))
        return drawn, 1 / np.where(density > 0, density, np.inf)
    cosine = uniforms[:, 0] if way == "uniform" else np.sqrt(uniforms[:, 0])
    sine, turn = np.sqrt(1 - cosine**2), 2 * np.pi * uniforms[:, 1]
    drawn = np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=-1)
    return drawn, np.full_like(cosine, 2 * np.pi) if way == "uniform" else np.pi / cosine


@pytest.mark.parametrize(("degrees", "least"), [(0, 30), (30, 30), (60, 25)])
def test_one_bounce_has_twenty_times_less_variance(degrees, least, capsys):
    """With the tree itself as the wall's BRDF, as in L fig. 8.3, and with the Phong lobe."""
    sampler, samples = fine()
    rng = np.random.default_rng(11)
    outgoing = repeated(outgoing_at(degrees), 100_000)
    mean, variance = {}, {}
    for way in ("tree", "uniform", "cosine"):
        w, inverse = weights_of(way, sampler, outgoing, rng.random((len(outgoing), 2)))
        light = 1.5 + 0.6 * w[:, 0] + 0.3 * np.sin(3 * w[:, 1])
        cells = [np.minimum((d[:, :2] + 1) * 16, 31).astype(int).T for d in (w, outgoing)]
        rho = samples[(*cells[0], *cells[1])], np.asarray(evaluate(PHONG, w, outgoing))[:, 0]
        values = np.stack(rho) * light * w[:, 2] * inverse
        mean[way], variance[way] = values.mean(axis=1), values.var(axis=1)
    ratios = {way: variance[way] / variance["tree"] for way in ("uniform", "cosine")}
    with capsys.disabled():
        shown = ", ".join(f"{way}: {a:.0f} (lobe {b:.0f})" for way, (a, b) in ratios.items())
        print(f"\nvariance over the tree's at {degrees} degrees, {shown}", end=" ")
    for ratio in ratios.values():
        assert ratio[0] > 20
        assert ratio[1] > least
    error = np.sqrt((variance["tree"] + variance["cosine"]) / len(outgoing))
    assert np.all(np.abs(mean["tree"] - mean["cosine"]) < 3.5 * error)
