"""How many nodes the polar quadrature takes.

Pinned down: with as many as it chooses, the albedo of narrow lobes is that of the quadrature about
the reflected ray, with and without a tail; a traced width that is too narrow fails at run time and
says what to do, one that is not passes, as does any where the nodes are given; a render chooses
while the width is known.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import AnisotropicWard, Lambertian, Microfacet, OrenNayar, Ward
from jaxrender.geometry import SurfaceSamples
from jaxrender.lighting import LightNodes, SmoothLobes
from jaxrender.reflection import (
    ExactForward,
    polar_coefficients,
    polar_columns,
    polar_nodes_for,
    render_samples,
)
from jaxrender.spectra import exit_cosine_transfer, extent_of, mean_transfer

ONE = np.ones(1)
# Both quadratures are good to 1e-6 of the largest value.
CONVERGED = 3e-6
COSINES = np.array([1.0, 0.4, 0.15])
SAMPLES = SurfaceSamples(
    np.tile([0.0, 0.0, 1.0], (3, 1)),
    np.stack([np.sqrt(1 - COSINES**2), 0 * COSINES, COSINES], axis=1),
)
NARROW = {
    "Gaussian": Microfacet(ONE, ONE, 0.05, None),
    "GGX": Microfacet(ONE, ONE, 0.1, 1.5, "half", "smith", "ggx"),
    "Ward": Ward(ONE, ONE, 0.06),
}


def white(directions):
    return jnp.ones_like(directions[:, :1])


@pytest.mark.parametrize("name", ["Gaussian", pytest.param("GGX", marks=pytest.mark.slow), "Ward"])
def test_narrow_lobes_are_met(name):
    brdf = NARROW[name]
    found = np.asarray(polar_columns(brdf, SAMPLES, white))[:, 1, 0]
    extent = extent_of(brdf, COSINES.dtype)
    albedo = np.asarray(mean_transfer(brdf.specular_transfer, COSINES, 0, *extent))[:, 0]
    assert np.abs(found - albedo).max() < CONVERGED * albedo.max()


def test_harmonics_are_met_by_as_many():
    brdf = NARROW["Gaussian"]
    found = polar_coefficients(brdf, SAMPLES, 1)[:, 1, 0] * np.sqrt(4 * np.pi)
    expected = exit_cosine_transfer(brdf, COSINES, 0)[:, 0]
    np.testing.assert_allclose(found, expected, rtol=CONVERGED)


@pytest.mark.parametrize(
    ("brdf", "nodes"),
    [
        (Lambertian(ONE), 48),
        (OrenNayar(ONE, 0.0), 48),
        (Microfacet(ONE, ONE, 0.2, None), 48),
        (Microfacet(ONE, ONE, 0.05, None), 112),
        (Microfacet(ONE, ONE, 0.05, None, distribution="ggx"), 160),
        (AnisotropicWard(ONE, ONE, 0.3, 0.1), 80),
    ],
)
def test_nodes_follow_the_width(brdf, nodes):
    assert polar_nodes_for(brdf) == nodes


@eqx.filter_jit
def traced(sigma, polar_nodes=None):
    brdf = Microfacet(ONE, ONE, sigma, None)
    return polar_columns(brdf, SAMPLES, white, polar_nodes)[:, 1, 0]


def test_a_traced_width_that_is_too_narrow_is_refused():
    assert np.all(np.isfinite(traced(jnp.asarray(0.2))))
    with pytest.raises(RuntimeError, match="give polar_nodes yourself, 5 / sigma"):
        traced(jnp.asarray(0.05)).block_until_ready()
    assert np.all(np.isfinite(traced(jnp.asarray(0.05), 24)))


@pytest.mark.slow
def test_a_render_chooses_while_the_width_is_known():
    lobes = SmoothLobes(np.array([[0.6, 0.0, 0.8]]), np.ones(1), np.full((1, 1), 3.0))
    dark = LightNodes(np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 1)))
    brdf = NARROW["Gaussian"]
    found, twin = (
        render_samples(brdf, SAMPLES, ExactForward(dark, lobes, nodes)) for nodes in (None, 112)
    )
    np.testing.assert_array_equal(found, twin)
