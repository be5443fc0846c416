"""Pinned down: photographs as linear measurements of a light (T 6.15, 6.16).

- A light photographed by the operator is irradiance plus filtered light, as the forward model has
  it, for every named transfer; ``none`` is the Fresnel ratio alone.
- Chunks do not change the result.
- Transfer vectors replace A_l Y_lm(n), and V(R) switches the specular lobe off.
- The diffuse part stops at its own degree.
- Misuse is refused.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from lighting_problems import glossy, random_light, samples_all_round

from jaxrender.brdf import normalised_fresnel
from jaxrender.harmonics import degrees, evaluate, real_basis
from jaxrender.inverse.lighting import operator as module
from jaxrender.inverse.lighting.operator import LightOperator, light_operator, sizes_by_degree
from jaxrender.reflection import irradiance
from jaxrender.reflection.dual import slow_specular
from jaxrender.spectra import lambertian_transfer

BAND_LIMIT, COUNT = 10, 301
# Two sums of the same products in another order.
ROUNDING = 1e-12


@pytest.mark.parametrize("transfer", ["exit-cosine", "gaussian"])
def test_the_forward_model_agrees(transfer):
    samples, light = samples_all_round(COUNT), random_light(BAND_LIMIT)
    brdf = glossy()
    operator = light_operator(brdf, samples, BAND_LIMIT, transfer, diffuse_band_limit=10)
    diffuse = irradiance(light, samples.normals)
    mirror = eqx.filter_jit(slow_specular)(brdf, samples, light, transfer)
    expected = brdf.kd[None, :] * diffuse + brdf.ks[None, :] * mirror
    assert np.abs(operator.apply(light) - expected).max() < ROUNDING * np.abs(expected).max()


def test_none_is_the_fresnel_ratio_alone():
    samples, light = samples_all_round(COUNT), random_light(BAND_LIMIT)
    brdf = glossy()
    found = light_operator(brdf, samples, BAND_LIMIT, "none").apply(light)
    kept = light.copy()
    kept[81:] = 0
    mirror = normalised_fresnel(brdf.mu, samples.exit_cosines)[:, None] * evaluate(
        light, samples.reflected
    )
    diffuse = irradiance(kept, samples.normals)
    expected = brdf.kd[None, :] * diffuse + brdf.ks[None, :] * mirror
    assert np.abs(found - expected).max() < ROUNDING * np.abs(expected).max()


def test_chunks_do_not_change_the_result(monkeypatch):
    samples, light = samples_all_round(COUNT), random_light(BAND_LIMIT)
    operator = light_operator(glossy(), samples, BAND_LIMIT)
    whole = (
        np.asarray(operator.diffuse(operator.rows)),
        np.asarray(operator.specular(operator.rows)),
    )
    dense = operator.kd[None, :] * (whole[0] @ light) + operator.ks[None, :] * (whole[1] @ light)
    monkeypatch.setattr(module, "_NUMBERS_PER_CHUNK", 100 * 121)
    assert operator.samples_per_chunk == 100
    # Without its compiled form: that was made for other chunks.
    chunked = LightOperator.apply.__wrapped__(operator, light)
    assert np.abs(np.asarray(chunked) - dense).max() < ROUNDING * np.abs(dense).max()


def test_shadows():
    samples, light = samples_all_round(COUNT), random_light(BAND_LIMIT)
    transfer = jnp.asarray(lambertian_transfer(4)[degrees(4)])
    vectors = real_basis(jnp.asarray(samples.normals), 4) * transfer[None, :]
    unshadowed = np.arange(COUNT) % 2
    lit = light_operator(glossy(), samples, BAND_LIMIT, diffuse_band_limit=4).apply(light)
    traced = light_operator(
        glossy(),
        samples,
        BAND_LIMIT,
        transfer_vectors=0.5 * vectors,
        unshadowed=unshadowed.astype(float),
        diffuse_band_limit=4,
    ).apply(light)
    kept = light.copy()
    kept[25:] = 0
    diffuse = glossy().kd[None, :] * np.asarray(irradiance(kept, samples.normals))
    expected = 0.5 * diffuse + unshadowed[:, None] * (np.asarray(lit) - diffuse)
    assert np.abs(traced - expected).max() < ROUNDING * np.abs(expected).max()


def test_the_size_of_a_degree_is_a_root_mean_square():
    light = np.zeros((9, 2))
    light[4:] = [[3.0, 4.0]]
    assert sizes_by_degree(light) == pytest.approx([0, 0, np.sqrt(12.5)])


def test_misuse_is_refused():
    samples = samples_all_round(10)
    with pytest.raises(ValueError, match=r"choose one of none, exit-cosine"):
        light_operator(glossy(), samples, 4, "sharp")
    with pytest.raises(ValueError, match="transfer vectors of degree 2"):
        light_operator(glossy(), samples, 6, transfer_vectors=np.zeros((10, 9)))
    with pytest.raises(ValueError, match="band_limit"):
        light_operator(glossy(), samples, -1)
