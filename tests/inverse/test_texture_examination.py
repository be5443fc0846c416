"""What a texture leaves above the noise, from photographs of a painted ball by the exact integral.

- Clean photographs: the noise is that of single pixels, nothing is named, nothing is misfit.
- Exposures that differ, and a response that is not linear, are named; the errors of texels then
  hold the truth, and those of a model that is exact do not.
- Texels of more than one paint are the first cause, and no other fault looks like them.
- Without pixels that are neighbours nobody knows the noise, so nothing is said.
"""

import numpy as np
import pytest
from inverse_problems import known_light, microfacet_unknowns
from texture_problems import BALL, MU, SIGMA, exact_columns, samples_of, texture, views

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfacePlaces
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations, Outcome, Unknown
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.texture import TextureSettings, by_site, exact_forward, fit_texture
from jaxrender.inverse.texture.examination import Painted, examined
from jaxrender.inverse.texture.forward import Forward

NOISE, NORMAL_90, VIEWS = 0.01, 1.645, 8
VARIANT = Microfacet(np.ones(3), np.ones(3), SIGMA, MU)
FIXED = microfacet_unknowns(sigma=Unknown((SIGMA,)), mu=Unknown((MU,)))
SETTINGS = TextureSettings(starts=1, search_samples=1200, exact_samples=0)


def exposed(exact, frame):
    """Let exposures differ by 5 %."""
    return exact * np.exp(0.05 * np.random.default_rng(2).normal(size=VIEWS))[frame][:, None]


def bent(exact, frame):
    """Raise radiance to a power."""
    return exact**1.06


@pytest.fixture(scope="module")
def ball():
    """Samples of a ball with their pixels, and what they are without noise."""
    seen = views(VIEWS, pixels=32)
    samples, frame, site = samples_of(seen)
    pixel = np.concatenate([np.argwhere(view.exit_cosines > 0.2) for view in seen])
    points = np.concatenate([view.points[view.exit_cosines > 0.2] for view in seen])
    kd, ks = texture()
    diffuse, specular = np.moveaxis(exact_columns(samples), 1, 0)
    exact = kd[site] * diffuse + ks[site][:, None] * specular
    places = SurfacePlaces(points, samples.normals)
    return Observations(samples, exact, frame, places, pixel=pixel), site


def found(ball, wrong=None, pixels=True, noise=None):
    """Fit photographs, and examine what is left."""
    clean, site = ball
    radiance = clean.radiance if wrong is None else wrong(clean.radiance, clean.frame)
    seen = clean._replace(
        radiance=NoiseModel(NOISE, 0.0).add(radiance, np.random.default_rng(0)),
        pixel=clean.pixel if pixels else None,
    )
    light = known_light(48)
    model = exact_forward(VARIANT, seen, exact_nodes(light, seen.frame, SIGMA))
    settings = SETTINGS._replace(noise=noise)
    fit = fit_texture(by_site(seen, site, 288), Forward(model, model), FIXED, settings)
    return examined(Painted(seen, site, light, VARIANT, BALL, model), fit, noise is not None, True)


def held(fit, exact):
    """The part of the 90 % intervals of kd and ks that holds the truth."""
    (kd, ks), own = texture(), fit.texture.if_exact() if exact else fit.texture
    seen = fit.texture.seen >= 12
    inside = np.abs(own.kd - kd)[seen] < NORMAL_90 * own.kd_error[seen]
    inside_ks = np.abs(own.ks - ks)[seen] < NORMAL_90 * own.ks_error[seen]
    return np.mean(inside), np.mean(inside_ks)


@pytest.mark.slow
def test_clean_photographs_hold_nothing_more(ball):
    fit = found(ball)
    assert fit.misfit.noise.relative == pytest.approx(NOISE, rel=0.1)
    assert not fit.misfit.found
    assert (fit.diagnosis, fit.outcome, fit.reasons) == ((), Outcome.CONVERGED, ())
    assert min(held(fit, exact=False)) > 0.84


@pytest.mark.parametrize(
    ("wrong", "cause"),
    [(exposed, "exposure"), pytest.param(bent, "response", marks=pytest.mark.slow)],
)
def test_what_is_wrong_is_named_and_in_the_errors(ball, wrong, cause):
    fit = found(ball, wrong)
    assert fit.outcome is Outcome.MISFIT
    assert fit.misfit.noise.relative == pytest.approx(NOISE, rel=0.15)
    assert fit.diagnosis[0].cause == cause
    assert "sites" not in [one.cause for one in fit.diagnosis]
    assert f"({cause})" in fit.reasons[1]
    assert min(held(fit, exact=True)) < 0.6
    assert min(held(fit, exact=False)) > 0.75


def test_texels_of_more_than_one_paint_are_named(ball):
    """What is left goes by place within each texel, the same in every photograph."""

    def spotted(exact, frame):
        points = np.asarray(ball[0].places.points)
        return exact * (1 + 0.3 * np.sign(np.sin(30 * points[:, :1])))

    fit = found(ball, spotted)
    assert fit.diagnosis[0].cause == "sites"
    assert "more than one paint" in fit.reasons[1]


def test_without_neighbours_nobody_knows_the_noise(ball):
    fit = found(ball, exposed, pixels=False)
    assert fit.misfit is None
    assert fit.outcome is Outcome.CONVERGED
    assert found(ball, exposed, pixels=False, noise=NoiseModel(NOISE, 0.0)).misfit.found
