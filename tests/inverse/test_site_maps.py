"""A sigma and a normal of every site.

- A tilted model is the model of tilted normals; its slopes are differences.
- The equations of a site are derivatives of its chi-squared, K_d and K_s following.
- From photographs of a ball whose texels differ in colour, sigma and normal, all are found within
  their errors, with the mu that they share: under lamps, and under continuous light that no fit
  uses.
- Where no photograph tells, errors are wide, and marks say so.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import known_light, microfacet_unknowns
from site_worlds import BOTH, LAMPS, NOISY, World, fitted, under_lamps
from texture_problems import (
    LOBE,
    MU,
    NOISE,
    SITES,
    exact_columns,
)

from jaxrender.geometry import Mesh, SurfaceSamples
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Outcome
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import ExactModel, LinearisedModel
from jaxrender.inverse.stated import Unknown
from jaxrender.inverse.texture import (
    COLOR,
    MAPS,
    Forward,
    NormalMap,
    SigmaField,
    SpecularPrior,
    by_site,
    fit_texture,
    recover_texture,
)
from jaxrender.inverse.texture.coloured_sites import ColouredPrior
from jaxrender.inverse.texture.site_equations import Expected, chi_squared, equations_of
from jaxrender.inverse.texture.site_numbers import TiltedModel
from jaxrender.inverse.texture.site_search import numbers_of
from jaxrender.inverse.texture.site_solver import Asked, parts_of


@pytest.fixture(scope="module")
def world():
    return World(LAMPS, under_lamps)


def few(world, sites):
    """Take the observations of some sites, numbered from 0."""
    rows = np.flatnonzero(np.isin(world.site, sites))
    site = np.searchsorted(sites, world.site[rows])
    return by_site(world.observations.take(rows), site, len(sites)), rows


def test_a_tilted_model_is_that_of_tilted_normals(world):
    rows = np.arange(0, len(world.site), 41)
    samples = SurfaceSamples(*(np.asarray(part)[rows] for part in world.samples))
    moved = samples._replace(normals=world.normals[rows])
    nodes = exact_nodes(LAMPS, world.frame[rows], 0.2)
    tilt = world.tilt[world.site[rows]]
    numbers = {"sigma": jnp.full(len(rows), 0.2), "mu": jnp.asarray(1.6)}
    tilts = {"tilt_x": jnp.asarray(tilt[:, 0]), "tilt_y": jnp.asarray(tilt[:, 1])}
    model = TiltedModel(ExactModel(LOBE, samples, nodes), world.axes[world.site[rows]])
    found = model.columns(numbers | tilts)
    expected = ExactModel(LOBE, moved, nodes).columns(numbers)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
    # The pixels of a map are tilted in the same way.
    offset = np.einsum("sk,ski->si", world.tilt, world.axes)
    normals = NormalMap(offset, offset, np.zeros(SITES))
    pixels = normals.tilted(samples.normals, world.site[rows])
    np.testing.assert_allclose(pixels, moved.normals, atol=1e-12)
    away = normals.tilted(samples.normals, np.full(len(rows), -1))
    np.testing.assert_allclose(away, samples.normals, atol=1e-12)
    # Both columns answer to a tilt.
    near = LinearisedModel.about(model, numbers | tilts, ("tilt_y",))
    step = 1e-5
    ends = [
        model.columns(numbers | tilts | {"tilt_y": tilts["tilt_y"] + sign * step})
        for sign in (1, -1)
    ]
    for slope, one, other in zip(near.slopes["tilt_y"], *ends, strict=True):
        difference = (np.asarray(one) - np.asarray(other)) / (2 * step)
        np.testing.assert_allclose(slope, difference, rtol=1e-5, atol=1e-6)


PRIORS = {
    "one ks": SpecularPrior(np.asarray(0.2), np.asarray(200.0)),
    "coloured ks": ColouredPrior(np.asarray(0.2), np.asarray(200.0), np.asarray(900.0)),
}


@pytest.mark.parametrize("prior", PRIORS.values(), ids=PRIORS)
def test_the_equations_are_derivatives_of_chi_squared(world, prior):
    measured, rows = few(world, np.flatnonzero(np.bincount(world.site) > 20)[:6])
    nodes = exact_nodes(LAMPS, world.frame[rows], 0.2)
    samples = world.observations.take(rows).samples
    names = numbers_of(tuple(MAPS))
    expected = Expected(np.array([np.log(0.2), 0.0, 0.0]), np.array([4.0, 300.0, 300.0]))
    asked = Asked(
        names,
        microfacet_unknowns(),
        microfacet_unknowns().pack({"sigma": 0.2, "mu": 1.6}),
        prior,
        expected,
        NoiseModel(0.01, 0.001),
    )
    value = np.tile([np.log(0.17), 0.02, -0.01], (measured.count, 1))

    def at(value, by=()):
        model = ExactModel(LOBE, samples, nodes).take
        (part,) = parts_of(measured, model, asked, value, measured.radiance, by, np.float64)
        return part, np.asarray(chi_squared(part.near, part.data, prior, expected, part.value)[0])[
            : measured.count
        ]

    part, _ = at(value, names)
    found, _ = equations_of(part.near, part.data, prior, expected, part.value, names)
    gradient = np.asarray(found.gradient)[: measured.count]
    # K_d and K_s are at their best, so that nothing is left of their slopes.
    own = 3 + prior.amplitudes(3)
    np.testing.assert_allclose(gradient[:, :own], 0, atol=1e-6 * np.abs(gradient).max())
    for number in range(3):
        step = 1e-5 * np.eye(3)[number]
        difference = (at(value + step)[1] - at(value - step)[1]) / 2e-5
        np.testing.assert_allclose(-2 * gradient[:, own + number], difference, rtol=1e-4)


@pytest.fixture(scope="module", params=["lamps", pytest.param("a sky", marks=pytest.mark.slow)])
def found(request, world):
    if request.param == "lamps":
        return world, fitted(world)
    under_a_sky = World(known_light(96), exact_columns)
    return under_a_sky, fitted(under_a_sky)


@pytest.mark.slow
def test_sigma_and_normals_are_found_within_their_errors(found):
    world, fit = found
    seen = fit.texture.seen > 0
    sigma, error = fit.variation
    # Where a lamp's highlight passes by, what is left is far from a parabola: not the mean square.
    z = np.abs(np.log(sigma / world.sigma) / (error / sigma))[seen]
    assert 0.7 < np.quantile(z, 0.683) < 1.3
    assert np.mean(z < 1.645) > 0.8
    told = seen & ~fit.variation.marked
    assert told.sum() > 100
    assert np.median(np.abs(sigma / world.sigma - 1)[told]) < 0.03
    normals = fit.lobe.normals
    offset = np.einsum("sk,ski->si", world.tilt, world.axes)
    away = np.linalg.norm(normals.offset - offset, axis=1)
    good = seen & ~normals.marked
    assert good.sum() > 150
    assert np.degrees(np.median(away[good])) < 0.8
    assert 0.7 < np.sqrt(np.mean((away / normals.error)[seen] ** 2) / 2) < 1.4
    np.testing.assert_allclose(np.linalg.norm(normals.normal[seen], axis=1), 1)
    assert not np.any(normals.error[~seen] < np.inf)


@pytest.mark.slow
def test_colours_and_what_is_shared_are_found_with_them(found):
    world, fit = found
    assert abs(fit.mu - MU) < 3 * fit.mu_error
    assert fit.mu_error < 0.1
    assert fit.noise.relative == pytest.approx(NOISE.relative, rel=0.15)
    good = (fit.texture.seen > 0) & ~fit.texture.kd_marked
    off = (fit.texture.kd - world.kd)[good] / fit.texture.kd_error[good]
    assert good.sum() > 100
    assert 0.7 < np.sqrt(np.mean(off**2)) < 1.4
    assert np.median(np.abs(fit.texture.kd / world.kd - 1)[good]) < 0.02


@pytest.mark.slow
def test_one_lobe_for_all_would_be_a_misfit(found):
    """The tests above could fail: without maps most of what is seen is unexplained."""
    world, fit = found
    assert fit.texture.relative_rms < 1.3 * NOISE.relative
    assert fitted(world, maps=()).texture.relative_rms > 3 * NOISE.relative


@pytest.mark.slow
def test_what_is_wrong_is_named(world):
    """Causes are tested on the model with the sigmas and normals that were found."""
    clean = fitted(world, noise=NOISY, diagnose=True)
    assert clean.outcome is Outcome.CONVERGED
    assert not clean.diagnosis
    seen = world.observations
    gains = 1 + 0.02 * np.cos(1.7 * world.frame)
    wrong = seen._replace(radiance=seen.radiance * gains[:, None])
    fit = fitted(world, wrong, noise=NOISY, diagnose=True)
    assert fit.outcome is Outcome.MISFIT
    assert fit.diagnosis[0].cause == "exposure"
    assert fit.diagnosis[0].explains > 0.7


def test_what_maps_cannot_be_combined_with(world):
    seen, unknowns = world.observations, microfacet_unknowns()

    def refused(words, **changed):
        own = {"settings": BOTH, "unknowns": unknowns} | changed
        with pytest.raises(ValueError, match=words):
            recover_texture(seen, world.site, SITES, LAMPS, LOBE, **own)

    refused("sigma is fixed", unknowns=microfacet_unknowns(sigma=Unknown(fixed=(0.2,))))
    refused("on the integral alone", settings=BOTH._replace(exact_samples=0))
    refused("nothing is freed", settings=BOTH._replace(free=("camera",)))
    refused("choose joint", settings=BOTH._replace(method="thesis"))
    refused("choose of sigma, normal, color", settings=BOTH._replace(maps=("gloss",)))
    grey = seen._replace(radiance=np.asarray(seen.radiance)[:, :1])
    measured, asked = by_site(grey, world.site, SITES), BOTH._replace(maps=(COLOR,))
    with pytest.raises(ValueError, match="K_s has no colour"):
        fit_texture(measured, Forward(*2 * (lambda index: None,)), unknowns, asked)
    refused("change its shadows", shape=hollow())
    places = np.asarray(seen.samples.normals)[:SITES]
    refused("goes with no maps", field=SigmaField.over(places, 4))


def hollow():
    """Make a ball with one vertex pushed in."""
    ball = Mesh.icosphere(1)
    vertices = np.array(ball.vertices)
    vertices[0] *= 0.3
    return Mesh(vertices, np.array(ball.faces))
