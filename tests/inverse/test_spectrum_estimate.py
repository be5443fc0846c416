"""A BRDF's coefficients from photographs of a ball, as an estimate.

- A diffuse ball under sources: the lobe is the clamped cosine cut at the order, within its error.
- The estimate prints its degrees, saves numbers that say which coefficient is which, and renders.
- Photographs whose exposures differ widen the errors; the model's own stay beside them, and are
  what leaving out photographs and cells says where all is noise.
- Light without degrees does not tell the lobe, and that is said.
- Concave shapes, moving light, coarse light and too few samples are refused with a remedy.
"""

import json

import numpy as np
import pytest

from jaxrender.brdf import Lambertian
from jaxrender.geometry import Orthographic, Sphere, SurfaceSamples, look_at, observe, sculpture
from jaxrender.inverse import AnyEstimate, KnownLight, Observations
from jaxrender.inverse.brdf_spectrum import SpectrumSettings, estimate_spectrum
from jaxrender.inverse.brdf_spectrum.left_out import without_each
from jaxrender.inverse.clusters import Clusters
from jaxrender.lighting import DirectionalSources, Environment, HarmonicLight
from jaxrender.reflection import forward_of, render_lit, render_samples

BALL, KD = Sphere(), np.array([0.2, 0.1, 0.05])
SOURCES = DirectionalSources(
    np.array([[0.5, 0.6, 0.62], [0.3, -0.7, 0.2], [0.9, 0.0, 0.9]]),
    np.array([[2.0, 1.8, 1.5], [1.2, 1.4, 1.8], [0.8, 0.8, 0.8]]),
)
WHITE = Environment(np.ones((16, 32, 3)))
ORDER_2 = SpectrumSettings(order=2)
# sum over l of (2 l + 1) / (4 pi) A_l P_l(1): the clamped cosine at its peak, cut at degree 2.
PEAK = 1 / 4 + 1 / 2 + 5 / 16


def photographs(light, gains=(1.0, 1.0, 1.0, 1.0)):
    """Pixels of a diffuse ball from as many sides, with 1 % noise."""
    rng, rows = np.random.default_rng(0), []
    for number, gain in enumerate(gains):
        place = 4 * np.array([np.cos(number), np.sin(number), 0.4])
        pose = look_at(place, np.zeros(3), np.array([0.0, 0.0, 1.0]))
        view = observe(Orthographic(24, 24, pose, scale=0.088), BALL)
        seen = view.exit_cosines > 0.15
        samples = SurfaceSamples(view.normals[seen], view.outgoing[seen])
        radiance = np.asarray(
            render_samples(
                Lambertian(KD),
                samples,
                forward_of(light, BALL),
            )
        )
        radiance = gain * radiance * (1 + 0.01 * rng.normal(size=radiance.shape))
        rows.append((*samples, radiance, np.full(len(radiance), number)))
    normals, outgoing, radiance, frame = (np.concatenate(part) for part in zip(*rows))
    return Observations(SurfaceSamples(normals, outgoing), radiance, frame)


@pytest.fixture(scope="module")
def seen():
    return photographs(SOURCES)


@pytest.fixture(scope="module")
def found(seen):
    orders = []
    estimate = estimate_spectrum(seen, BALL, SOURCES, ORDER_2, orders.append)
    assert [one.basis.band_limit for one in orders] == [1, 2]
    return estimate


def test_the_lobe_of_a_diffuse_ball(found):
    assert isinstance(found, AnyEstimate)
    assert found.identifiable == {"lobe": True}
    incoming, outgoing = np.array([[0.0, 0.0, 1.0]]), np.array([[0.6, 0.0, 0.8]])
    value, error = found.spectrum.transfer(incoming, outgoing)
    np.testing.assert_allclose(value[0], PEAK * KD, rtol=0.1)
    assert (error < 0.05 * value).all()
    rho, interval = found.values["rho"], found.interval90["rho"]
    assert rho.shape == found.standard_error["rho"].shape == (found.spectrum.basis.count, 3)
    np.testing.assert_allclose(interval.mean(axis=-1), rho, atol=1e-12)


def test_it_is_printed_saved_and_rendered(found, tmp_path):
    words = str(found)
    assert words.startswith("BRDF to order 2: the fit converged")
    assert len([line for line in words.splitlines() if line.strip()[0] in "012"]) == 3
    saved = json.loads((found.save(tmp_path / "lobe") / "estimate.json").read_text())
    np.testing.assert_allclose(saved["values"]["rho"], found.values["rho"])
    np.testing.assert_array_equal(
        list(saved["indices"].values()), np.asarray(found.spectrum.basis.indices)
    )
    assert (saved["reciprocal"], saved["outcome"]) == (True, "converged")
    pose = look_at(np.array([4.0, 0.0, 1.0]), np.zeros(3), np.array([0.0, 0.0, 1.0]))
    camera = Orthographic(16, 16, pose, scale=0.13)
    images = [
        np.asarray(render_lit(one, SOURCES, BALL, camera))
        for one in (found.material, Lambertian(KD))
    ]
    bright = images[1] > 0.3 * images[1].max()
    ratio = images[0][bright] / images[1][bright]
    assert np.median(np.abs(ratio - 1)) < 0.1


def test_light_without_degrees_does_not_tell_the_lobe():
    found = estimate_spectrum(photographs(WHITE), BALL, WHITE, ORDER_2._replace(reciprocal=False))
    assert found.outcome.value == "not_identifiable"
    assert "next to nothing of degree 1, 2" in str(found)
    assert "not identifiable" in str(found)
    determined = [one.determined for one in found.by_degree()]
    assert determined[0] > 0.9
    assert max(determined[1:]) < 0.1


def test_bad_input_is_refused_in_words(seen):
    with pytest.raises(ValueError, match="the shape is concave"):
        estimate_spectrum(seen, sculpture(2, 0), SOURCES, ORDER_2)
    moving = KnownLight(None, SOURCES, (SOURCES,) * 4)
    with pytest.raises(ValueError, match="each photograph has a light of its own"):
        estimate_spectrum(seen, BALL, moving, ORDER_2)
    with pytest.raises(ValueError, match="8 rows has degrees to 3: lower the order"):
        estimate_spectrum(seen, BALL, Environment(np.ones((8, 16, 3))), SpectrumSettings(4))
    with pytest.raises(ValueError, match=r"100 samples for \d+ coefficients; lower the order"):
        estimate_spectrum(seen, BALL, SOURCES, SpectrumSettings(order=8, count=100))


def test_exposures_that_differ_are_in_the_errors():
    # Light of degrees to 2, of which a diffuse ball reflects no other.
    harmonics = np.array([3.0, 0.4, -0.3, 0.25, 0.2, -0.15, 0.25, 0.15, -0.2])
    light = HarmonicLight(harmonics[:, None] * np.ones(3))
    settings = SpectrumSettings(order=2, reciprocal=False)
    gains = np.exp(0.05 * np.random.default_rng(0).normal(size=10))
    clean, wrong = (
        estimate_spectrum(photographs(light, some), BALL, light, settings).spectrum
        for some in (np.ones(10), gains)
    )
    assert np.median(clean.standard_error / clean.if_exact().standard_error) < 1.3
    # What the prior holds moves with the weight of the prior.
    told = wrong.resolution > 0.95
    off = np.abs(wrong.values - clean.values)[told]
    assert np.max(off / wrong.if_exact().standard_error[told]) > 4
    assert np.max(off / wrong.standard_error[told]) < 3


def test_leaving_out_says_what_the_model_does_where_all_is_noise():
    rng = np.random.default_rng(0)
    clusters = Clusters(np.repeat(np.arange(20), 40), np.tile(np.arange(40), 20))
    rows, prior = rng.normal(size=(800, 5)), 3 * np.eye(5)
    shown = [without_each(rows, rng.normal(size=800), prior, clusters) for _ in range(40)]
    ratio = np.diag(np.mean(shown, axis=0)) / np.diag(np.linalg.inv(rows.T @ rows + prior))
    np.testing.assert_allclose(ratio, 1, atol=0.2)
    few = Clusters(clusters.photograph % 4, clusters.cell)
    assert (np.diag(without_each(rows, rng.normal(size=800), prior, few)) > 0).all()
