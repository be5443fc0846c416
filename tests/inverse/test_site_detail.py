"""How the material varies within sites, as their neighbours tell.

- A detailed model is the model of what each sample shows, with slopes by the site's numbers.
- Detail that is right is kept, and what is wrong is not.
- On a ball whose material varies smoothly, neighbours take the misfit of large texels away; errors
  become smaller, and stay right.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import microfacet_unknowns, unit
from site_worlds import BOTH, LAMPS, NOISY
from texture_problems import BALL, IMAGE, LOBE, SITES, samples_of, views

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfacePlaces, SurfaceSamples
from jaxrender.inverse import Observations
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import ExactModel, LinearisedModel
from jaxrender.inverse.texture import SpecularPrior, by_site, recover_texture
from jaxrender.inverse.texture.site_detail import Detail
from jaxrender.inverse.texture.site_equations import Expected
from jaxrender.inverse.texture.site_numbers import tangents_of
from jaxrender.inverse.texture.site_solver import Asked, Solved
from jaxrender.inverse.texture.site_surface import better_detail

MU = 1.6


class SmoothBall:
    """A ball whose colour, K_s, sigma and normals vary smoothly, in texels of 15 degrees."""

    def __init__(self, pixels=26):
        self.samples, self.frame, self.site = samples_of(views(8, pixels))
        at = np.asarray(self.samples.normals, float)
        wave = [np.sin(at @ axis + phase) for axis, phase in zip(3.5 * np.eye(3), (0.3, 1, 2))]
        self.kd = 0.15 * np.exp(0.5 * np.stack(wave, axis=1))
        self.ks = 0.2 * np.exp(0.4 * wave[1])
        self.sigma = 0.17 * np.exp(0.4 * wave[2])
        offset = 0.06 * np.stack(wave[::-1], axis=1)
        self.offset = offset - np.sum(offset * at, axis=1, keepdims=True) * at
        self.normals = unit(at + self.offset)
        self.places = SurfacePlaces(at, at)

    def mean(self, values):
        """Average over the observations of each site."""
        sums = np.bincount(self.site, values, minlength=SITES)
        return sums / np.maximum(np.bincount(self.site, minlength=SITES), 1)

    def model_of(self, normals):
        samples = SurfaceSamples(normals, np.asarray(self.samples.outgoing, float))
        nodes = exact_nodes(LAMPS, self.frame, 0.1)
        return lambda index: ExactModel(LOBE, samples, nodes).take(index)

    @property
    def radiance(self):
        numbers = {"sigma": jnp.asarray(self.sigma), "mu": jnp.asarray(MU)}
        columns = self.model_of(self.normals)(np.arange(len(self.site))).columns(numbers)
        return np.asarray(self.kd * columns.diffuse + self.ks[:, None] * columns.specular)

    def observed(self, places=True):
        radiance = NOISY.add(self.radiance, np.random.default_rng(1))
        places = self.places if places else None
        return Observations(self.samples, radiance, self.frame, places)

    @property
    def detail(self):
        """How the truth varies within its texels."""
        kd = np.stack([part / self.mean(part)[self.site] for part in self.kd.T], axis=1)
        logs = np.log(self.sigma)
        offset = [part - self.mean(part)[self.site] for part in self.offset.T]
        return Detail(
            kd,
            self.ks / self.mean(self.ks)[self.site],
            logs - self.mean(logs)[self.site],
            np.stack(offset, axis=1),
        )


@pytest.fixture(scope="module")
def ball():
    return SmoothBall()


def test_a_detailed_model_is_that_of_what_each_sample_shows(ball):
    rows, detail = np.arange(0, len(ball.site), 37), ball.detail
    at = np.asarray(ball.samples.normals, float)
    model = detail.applied(ball.model_of(at))(rows)
    sigma = np.exp(np.log(ball.sigma) - detail.log_sigma)[rows]
    numbers = {"sigma": jnp.asarray(sigma), "mu": jnp.asarray(MU)}
    own = numbers | {"sigma": jnp.asarray(ball.sigma[rows])}
    plain = ball.model_of(unit(at + detail.offset))(rows).columns(own)
    found = LinearisedModel.about(model, numbers, ("sigma", "mu"))
    np.testing.assert_allclose(found.at.diffuse, plain.diffuse * detail.kd[rows], rtol=1e-9)
    scaled = plain.specular * detail.ks[rows, None]
    np.testing.assert_allclose(found.at.specular, scaled, rtol=1e-9)
    step = 1e-5
    ends = [
        model.columns(numbers | {"sigma": numbers["sigma"] + sign * step}).specular
        for sign in (1, -1)
    ]
    slope = (np.asarray(ends[0]) - np.asarray(ends[1])) / (2 * step)
    np.testing.assert_allclose(found.slopes["sigma"][0], slope, rtol=1e-5, atol=1e-6)


def test_detail_that_is_right_is_kept(ball):
    """At half of the sites it is the truth, and at the others its opposite."""
    measured = by_site(ball.observed(), ball.site, SITES)
    right, even = ball.detail, ball.site % 2 == 0
    wrong = Detail(1 / right.kd, 1 / right.ks, -right.log_sigma, -right.offset)
    mixed = Detail(
        *(
            np.where(even.reshape(-1, *[1] * (one.ndim - 1)), one, other)
            for one, other in zip(right, wrong)
        )
    )
    at = np.asarray(ball.samples.normals, float)
    logs = np.log(ball.sigma) - right.log_sigma
    offset = np.stack([ball.mean(part) for part in ball.offset.T], axis=1)
    axes = tangents_of(at, ball.site, SITES)
    value = np.stack([ball.mean(logs), *np.einsum("sai,si->as", axes, offset)], axis=1)
    unknowns, prior = microfacet_unknowns(), SpecularPrior(np.asarray(0.2), np.asarray(100.0))
    names = ("sigma", "tilt_x", "tilt_y")
    expected = Expected(np.array([np.log(0.17), 0, 0]), np.array([4.0, 300, 300]))
    point = unknowns.pack({"sigma": 0.17, "mu": MU})
    asked = Asked(names, unknowns, point, prior, expected, NOISY)
    begun = Solved.begin(measured, value, prior)._replace(predicted=measured.radiance)
    kept = better_detail(measured, ball.model_of(at), asked, begun, mixed)
    changed = np.any(kept.kd != 1, axis=1)
    often = np.bincount(ball.site, minlength=SITES)[ball.site] > 12
    assert np.mean(changed[often & even]) > 0.8
    assert np.mean(changed[often & ~even]) < 0.2
    np.testing.assert_allclose(kept.offset[~changed], 0)


def recovered(ball, places):
    return recover_texture(
        ball.observed(places),
        ball.site,
        SITES,
        LAMPS,
        Microfacet(np.ones(3), np.ones(3), 0.16, MU),
        unknowns=microfacet_unknowns(),
        settings=BOTH,
        shape=BALL,
    )


@pytest.mark.slow
def test_neighbours_take_the_misfit_of_large_texels_away():
    ball = SmoothBall(40)
    assert IMAGE == (12, 24)
    alone, together = recovered(ball, False), recovered(ball, True)
    assert alone.lobe.detail is None
    assert alone.noise.relative > 3 * NOISY.relative
    assert together.noise.relative < 2 * NOISY.relative
    true = np.exp(ball.mean(np.log(ball.sigma)))
    seen = np.bincount(ball.site, minlength=SITES) > 5
    off = [np.abs(np.log(fit.variation.sigma / true))[seen] for fit in (alone, together)]
    # Two lamps leave many texels without a highlight: it is neighbours that these are known by.
    assert np.median(off[1]) < 0.8 * np.median(off[0])
    error = (together.variation.error / together.variation.sigma)[seen]
    assert 0.5 < np.quantile(off[1] / error, 0.683) < 1.6
