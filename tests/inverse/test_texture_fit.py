"""Fits of textures on a toy model: solver tests.

- Exact data are recovered (to 1e-4: a search ends where slight noise would hide the rest).
- The thesis's method comes close, the joint one closer.
- Regions have a sigma of their own; noise is estimated free of what the texture fitted away;
  cutting into chunks changes nothing.
- What is not identifiable is refused with the remedy.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import ToyModel, microfacet_unknowns

from jaxrender.geometry import SurfaceSamples
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations, Outcome, Unknown
from jaxrender.inverse.texture import (
    TextureSettings,
    by_site,
    fit_texture,
    fit_texture_by_region,
    whole_surface,
)
from jaxrender.inverse.texture.forward import Forward

WITHIN = 3.5


class Toy:
    """A toy model of sites seen eight times each."""

    def __init__(self, sites=60, sigmas=(0.2, 0.2), noise=0.0, seed=0):
        rng = np.random.default_rng(seed)
        self.site = np.repeat(np.arange(sites), 8)
        count = len(self.site)
        self.diffuse = rng.uniform(0.5, 3, (count, 3))
        self.angles = np.repeat(rng.uniform(0, 0.4, (count, 1)), 3, axis=1)
        cosines = rng.uniform(0.15, 1, count)
        self.kd, self.ks = rng.uniform(0.05, 0.3, (sites, 3)), rng.uniform(0.05, 0.15, sites)
        normals = np.tile([0.0, 0.0, 1.0], (count, 1))
        outgoing = np.stack([np.sqrt(1 - cosines**2), 0 * cosines, cosines], axis=-1)
        self.samples = SurfaceSamples(normals, outgoing)
        self.region = (np.arange(sites) >= sites // 2).astype(int)
        model, exact = self.model_of(np.arange(count)), np.zeros((count, 3))
        for region, sigma in enumerate(sigmas):
            columns = model.columns({"sigma": jnp.asarray(sigma), "mu": jnp.asarray(1.7)})
            rows = self.region[self.site] == region
            whole = self.kd[self.site] * columns.diffuse
            whole += self.ks[self.site][:, None] * columns.specular
            exact[rows] = np.asarray(whole)[rows]
        radiance = NoiseModel(noise, 0.0).add(exact, rng)
        self.observations = Observations(self.samples, radiance, np.zeros(count, int))
        self.measured = by_site(self.observations, self.site, sites)
        self.forward = Forward(self.model_of, self.model_of)

    def model_of(self, index):
        cosines = np.asarray(self.samples.exit_cosines)[index]
        parts = (self.diffuse[index], self.angles[index], cosines)
        return ToyModel(*(jnp.asarray(part) for part in parts))


def test_exact_data_are_recovered():
    toy = Toy()
    fit = fit_texture(toy.measured, toy.forward, microfacet_unknowns(), TextureSettings(starts=2))
    assert fit.sigma == pytest.approx(0.2, rel=1e-4)
    assert fit.mu == pytest.approx(1.7, rel=1e-4)
    np.testing.assert_allclose(fit.texture.kd, toy.kd, rtol=1e-3)
    np.testing.assert_allclose(fit.texture.ks, toy.ks, rtol=1e-3)


def test_the_thesis_method_comes_close_and_the_joint_one_closer():
    toy = Toy(noise=0.01)
    errors = {}
    for method in ("thesis", "joint"):
        settings = TextureSettings(method=method, starts=1)
        fit = fit_texture(toy.measured, toy.forward, microfacet_unknowns(), settings)
        errors[method] = np.sqrt(np.nanmean((fit.texture.kd / toy.kd - 1) ** 2))
        assert fit.sigma == pytest.approx(0.2, rel=0.1)
    assert errors["joint"] < 0.03
    assert errors["joint"] < errors["thesis"] < 0.3


def test_each_region_has_a_roughness_of_its_own():
    # Twice as many sites, so that each region is as large as the other tests' whole.
    toy = Toy(sites=120, sigmas=(0.12, 0.3), noise=0.01)
    settings = TextureSettings(starts=1)
    texture, fits = fit_texture_by_region(
        toy.measured, toy.region, toy.forward, microfacet_unknowns(), settings
    )
    for region, sigma in enumerate((0.12, 0.3)):
        assert abs(fits[region].sigma - sigma) < WITHIN * fits[region].sigma_error
    error = (texture.kd - toy.kd) / texture.kd_error
    assert 0.8 < np.sqrt(np.mean(error**2)) < 1.2
    assert texture.relative_rms < 0.011


def test_noise_is_told_from_the_texture_that_fits_it():
    toy = Toy(noise=0.02, seed=3)
    fit = fit_texture(toy.measured, toy.forward, microfacet_unknowns(), TextureSettings(starts=1))
    # 1440 residuals, 240 unknowns: the estimate scatters by 2 %; without the sites' share of
    # unknowns it would be 9 % low.
    assert fit.noise.relative == pytest.approx(0.02, rel=0.07)
    assert 0.85 < np.sqrt(np.mean(fit.texture.misfit**2)) < 1.15


def test_cutting_into_chunks_changes_nothing(monkeypatch):
    toy = Toy(noise=0.01)
    fixed = microfacet_unknowns(sigma=Unknown((0.2,)), mu=Unknown((1.7,)))
    settings = TextureSettings(noise=NoiseModel(0.01, 0.0))
    whole = fit_texture(toy.measured, toy.forward, fixed, settings).texture
    monkeypatch.setattr(whole_surface, "_CHUNK", 100)
    cut = fit_texture(toy.measured, toy.forward, fixed, settings).texture
    for one, other in zip(whole, cut):
        if one is None:  # of a coloured K_s alone
            continue
        np.testing.assert_allclose(one, other, rtol=1e-9)


def test_one_photograph_does_not_tell_specular_from_diffuse():
    """Lobe and light known, each site seen once: K_d's error must hold what is not known of K_s."""
    toy = Toy(noise=0.01)
    once = toy.measured.take(np.arange(0, len(toy.site), 8))
    fixed = microfacet_unknowns(sigma=Unknown((0.2,)), mu=Unknown((1.7,)))
    fit = fit_texture(once, toy.forward, fixed, TextureSettings(noise=NoiseModel(0.01, 0.0)))
    assert fit.outcome is Outcome.NOT_IDENTIFIABLE
    assert "kd is not identifiable at most sites" in " ".join(fit.reasons)
    assert np.isinf(fit.texture.ks_error).all()
    # Many times off what noise alone would allow, and within what is stated.
    off = np.abs(fit.texture.kd - toy.kd)
    assert np.median(off / toy.kd) > 0.05
    assert np.mean(off < 2 * fit.texture.kd_error) > 0.9


def test_what_is_not_identifiable_is_refused():
    toy = Toy()
    once = toy.measured.take(np.arange(0, len(toy.site), 8))
    with pytest.raises(ValueError, match="more photographs, larger texels"):
        fit_texture(once, toy.forward, microfacet_unknowns())
    with pytest.raises(ValueError, match="leave both free"):
        fit_texture(toy.measured, toy.forward, microfacet_unknowns(kd=Unknown((0.1,))))
    with pytest.raises(ValueError, match="one K_s for all channels"):
        fit_texture(toy.measured, toy.forward, microfacet_unknowns(ks_per_channel=True))
    with pytest.raises(ValueError, match="joint, thesis"):
        fit_texture(
            toy.measured, toy.forward, microfacet_unknowns(), TextureSettings(method="guess")
        )
    with pytest.raises(ValueError, match="no region has observations"):
        fit_texture_by_region(toy.measured, -np.ones(60, int), toy.forward, microfacet_unknowns())
