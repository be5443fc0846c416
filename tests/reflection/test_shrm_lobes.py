"""Spherical harmonic reflection maps of lobes under slow light, and the integral behind them.

Pinned down: the column of a lobe nears the integral as the viewer's degree grows, and by the
azimuth about R far sooner; a map is that column at R; pixels have derivatives in light, sigma and
mu.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shrm_problems import random_light, random_samples

from jaxrender.brdf import Microfacet
from jaxrender.harmonics import LatLongGrid
from jaxrender.reflection import (
    ViewFilter,
    global_shrm,
    local_shrm,
    mirror_light,
    reflect_mirror_light,
    reflect_slow_light,
)
from jaxrender.reflection.shrm import specular_spectrum


@pytest.mark.slow
def test_the_column_of_a_lobe_nears_the_integral_as_the_viewers_degree_grows():
    rng = np.random.default_rng(0)
    samples, light = random_samples(rng), random_light(rng, 8)
    brdf = Microfacet(np.zeros(3), np.ones(3), 0.2, 1.5)
    exact = np.asarray(reflect_slow_light(brdf, samples, light))
    errors = {"shrm": [], "azimuthal": []}
    for degree in (0, 2, 4, 8):
        seen = mirror_light(samples, light, degree)
        for name, found in errors.items():
            view = ViewFilter.named(f"{name}-{degree}")
            column = np.asarray(reflect_mirror_light(brdf, samples.exit_cosines, seen, view))
            found.append(np.sqrt(np.sum((column - exact) ** 2) / np.sum(exact**2)))
    expanded, own = errors["shrm"], errors["azimuthal"]
    assert np.all(np.diff(expanded) < 0), errors
    assert expanded[1] < np.sqrt(0.03), errors
    assert expanded[3] < 0.02, errors
    # With every order it is the integral itself, and with few far nearer to it.
    assert own[3] < 1e-9, errors
    assert own[2] < 0.2 * expanded[2], errors


def test_a_map_is_the_column_at_the_reflected_direction():
    rng = np.random.default_rng(2)
    samples, light = random_samples(rng, 60), random_light(rng, 6)
    brdf = Microfacet(np.zeros(3), np.ones(3), 0.3, 1.5)
    spectrum = specular_spectrum(brdf, (6, 2))
    local = local_shrm(light, spectrum, LatLongGrid(300, 600))
    seen = mirror_light(samples, light, 2)
    expected = np.asarray(
        reflect_mirror_light(brdf, samples.exit_cosines, seen, ViewFilter(2, True))
    )
    found = np.asarray(local.at(samples.reflected, samples.outgoing))
    assert np.abs(found - expected).max() < 3e-4 * np.abs(expected).max()


def test_a_rendered_pixel_is_differentiable_in_light_sigma_and_mu():
    rng = np.random.default_rng(4)
    light, grid = jnp.asarray(random_light(rng, 4)), LatLongGrid(20, 40)
    samples = random_samples(rng, 1)
    ramp = jnp.asarray(rng.standard_normal(light.shape))

    def pixel(at):
        brdf = Microfacet(jnp.zeros(3), jnp.ones(3), at[0], at[1])
        local = local_shrm(light + at[2] * ramp, specular_spectrum(brdf, (4, 2)), grid)
        return global_shrm(local).at(samples.reflected, samples.outgoing)[0, 1]

    at = jnp.array([0.25, 1.5, 0.1])
    found = np.asarray(jax.jit(jax.grad(pixel))(at))
    value = jax.jit(pixel)
    for axis, step in enumerate(np.eye(3) * 1e-4):
        near, far = ((value(at + k * step) - value(at - k * step)) / (2e-4 * k) for k in (1.0, 2.0))
        assert abs(found[axis] - (4 * near - far) / 3) < 1e-6 * max(1, abs(found[axis]))
