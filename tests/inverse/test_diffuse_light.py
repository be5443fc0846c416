"""Unknown light that a diffuse body was photographed in.

- A Lambertian ball gives its source, and the light's degrees 0, 1, 2 and 4; degree 3, and every odd
  degree above 1, is said not to be identifiable (T 3.2.7), and what is stated of all of them holds.
- Grooves (Oren and Nayar) reflect back towards the source: such a ball tells degree 3 as well, and
  its roughness together with the light, as was foreseen.
- A body that hides half of the light from itself tells degree 3 by its shadows.
"""

import numpy as np
import pytest
from area_and_source import AREA, ENERGY, KD, NOISE, SOURCE, photographs
from inverse_problems import ball_samples

from jaxrender.brdf import Microfacet, OrenNayarLobe
from jaxrender.geometry import SurfacePlaces, sculpture
from jaxrender.harmonics import degrees
from jaxrender.inverse import KnownLight, Observations
from jaxrender.inverse.factorization import FactorSettings, Known, factorize
from jaxrender.inverse.forecast.joint import forecast_joint
from jaxrender.inverse.forecast.situation import Situation, Supposed
from jaxrender.inverse.stated import Unknown
from jaxrender.lighting import DirectionalSources
from jaxrender.spectra import light_coefficients

NO_SPECULAR, ALL_OF_IT = (0.0,) * 3, (1.0,) * 3
ANY_SIGMA = Unknown(fixed=(0.1,))
SETTINGS = FactorSettings(6, 2)
STATED_ERRORS = 4.5
LAMBERTIAN = Microfacet(KD, np.zeros(3), 0.1, None)
GROOVED = OrenNayarLobe(KD, 0.5)
SUN = DirectionalSources(SOURCE[None], ENERGY[None])


def true_light(band_limit) -> np.ndarray:
    return np.asarray(light_coefficients(AREA.to_environment(64), band_limit)) * KD


def assert_source_is_found(found):
    strongest = found.scene.sources
    assert strongest.directions[0] @ SOURCE > np.cos(np.radians(0.5))
    off = np.asarray(strongest.irradiance)[0] - ENERGY * KD
    assert np.all(np.abs(off) < STATED_ERRORS * found.scene.energy_error[0])


@pytest.fixture(scope="module")
def lambertian():
    return factorize(photographs(LAMBERTIAN), LAMBERTIAN, SETTINGS, Known(NO_SPECULAR, ANY_SIGMA))


@pytest.fixture(scope="module")
def grooved():
    return factorize(photographs(GROOVED), GROOVED, SETTINGS, Known(ALL_OF_IT))


@pytest.mark.slow
def test_a_lambertian_ball_tells_source_and_even_degrees(lambertian):
    assert_source_is_found(lambertian)
    determined = lambertian.scene.determined
    assert np.all(determined[[0, 1, 2]] > 0.99)
    assert determined[4] > 0.9
    assert np.all(determined[[3, 5]] < 0.05)
    assert lambertian.identifiable == {}
    np.testing.assert_array_equal(lambertian.parameters.value.ks, 0)
    assert lambertian.relative_rms == pytest.approx(0.01, rel=0.15)


def test_what_is_stated_of_the_light_holds_for_all_degrees(lambertian):
    off = np.abs(lambertian.scene.slow - true_light(6))[:36]
    stated = lambertian.scene.slow_error[:36]
    odd = np.isin(degrees(5), (3, 5))
    assert np.all(off[~odd] < STATED_ERRORS * stated[~odd])
    # Odd degrees are expectation, and said to be: nothing in the photographs contradicts it.
    assert stated[odd].min() > 10 * np.median(stated[~odd])
    assert np.all(off[odd] < STATED_ERRORS * stated[odd])


@pytest.mark.slow
def test_grooves_tell_an_odd_degree_and_their_roughness(grooved):
    assert_source_is_found(grooved)
    assert grooved.scene.determined[3] > 0.9
    assert grooved.identifiable == {"sigma": True}
    found = grooved.parameters.value, grooved.parameters.standard_error
    value, error = (float(part.of("sigma")) for part in found)
    assert abs(value - 0.5) < STATED_ERRORS * error
    assert error < 0.02
    # All the light that a diffuse body reflects is by kd.
    np.testing.assert_array_equal(grooved.parameters.value.of("kd"), 1)


@pytest.mark.slow
def test_the_roughness_of_grooves_is_foreseen(grooved):
    light = KnownLight(AREA.to_environment(32), SUN)
    observed = photographs(GROOVED)
    situation = Situation(observed.samples, np.asarray(observed.frame), light)
    forecast = forecast_joint(situation, Supposed(GROOVED, NOISE), 6)
    assert forecast.identifiable == {"sigma": True}
    ratio = float(forecast.parameters.standard_error.numbers["sigma"]) / float(
        grooved.parameters.standard_error.numbers["sigma"]
    )
    assert 0.6 < ratio < 1.6
    diffuse = Supposed(LAMBERTIAN, NOISE)
    with pytest.raises(ValueError, match="of a Lambertian body the product of light and kd shows"):
        forecast_joint(situation, diffuse)


def test_shadows_tell_what_a_ball_does_not():
    """Of the same light, samples and noise: what a body hides from itself tells degree 3."""
    shape = sculpture(3)
    rng = np.random.default_rng(3)
    kept = np.sort(rng.choice(len(shape.vertices), 600, replace=False))
    places = SurfacePlaces(*(rows[kept] for rows in SurfacePlaces.of_vertices(shape)))
    samples, _ = ball_samples(600, 0.15, seed=1)
    samples = type(samples)(shape.normals[kept], np.asarray(samples.outgoing))
    settings = FactorSettings(4, 0, refine=False)
    # What is determined depends on the geometry; the radiance sets the noise alone.
    even = np.ones((600, 3)) + NOISE.relative * rng.normal(size=(600, 3))
    seen = Observations(samples, even, np.zeros(600, int), places)
    known = Known(NO_SPECULAR, ANY_SIGMA)
    convex = factorize(seen, LAMBERTIAN, settings, known).scene.determined
    concave = factorize(seen, LAMBERTIAN, settings, known, shape=shape).scene.determined
    assert convex[3] < 0.05
    assert concave[3] > 0.5
