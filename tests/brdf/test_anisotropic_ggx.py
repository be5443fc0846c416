"""Anisotropic GGX facets.

- They are Heitz's formulas (2014), written out in NumPy: distribution, masking, Fresnel ratio.
- Where both widths are the same they are the model ``ggx``, however the tangent is turned.
- A turned tangent is the lobe of turned directions; a quarter of a turn exchanges the widths.
- A number outside its interval is refused by name.  Unknown light is refused: it tells two numbers.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxrender.brdf import AnisotropicGGX, brdf_named
from jaxrender.geometry import Sphere, SurfaceSamples
from jaxrender.inverse import Observations, Scene, fit, unknown

KD, KS = np.array([0.1, 0.2]), np.array([0.3, 0.15])
numbers = st.tuples(st.floats(0.05, 1), st.floats(0.05, 1), st.floats(-1.5, 1.5))


def directions(count=300, seed=0):
    found = np.random.default_rng(seed).normal(size=(2, count, 3))
    found[..., 2] = np.abs(found[..., 2]) + 0.02
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


INCOMING, OUTGOING = directions()


def turn(vectors, angle):
    c, s = np.cos(angle), np.sin(angle)
    return vectors @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def by_heitz(along, across, mu, rotation, incoming, outgoing):
    """Evaluate D G / (4 cos cos) times the Fresnel ratio."""
    one, two = turn(incoming, -rotation), turn(outgoing, -rotation)
    half = one + two
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    inside = (half[:, 0] / along) ** 2 + (half[:, 1] / across) ** 2 + half[:, 2] ** 2
    density = 1 / (np.pi * along * across * inside**2)

    def hidden(w):
        slope = ((along * w[:, 0]) ** 2 + (across * w[:, 1]) ** 2) / w[:, 2] ** 2
        return (np.sqrt(1 + slope) - 1) / 2

    masking = 1 / (1 + hidden(one) + hidden(two))
    cosine = np.sum(one * half, axis=1)

    def reflectance(c):
        g = np.sqrt(mu**2 - 1 + c**2)
        ratio = ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2
        return ((g - c) / (g + c)) ** 2 * (1 + ratio) / 2

    fresnel = 1.0 if mu is None else reflectance(cosine) / reflectance(1.0)
    return density * masking * fresnel / (4 * one[:, 2] * two[:, 2])


@settings(deadline=None, max_examples=25)
@given(numbers, st.sampled_from([None, 1.3, 2.0]))
def test_the_lobe_is_that_of_heitz(values, mu):
    along, across, rotation = values
    model = AnisotropicGGX(KD, KS, along, across, mu, rotation)
    lobe = by_heitz(along, across, mu, rotation, INCOMING, OUTGOING)
    expected = KD + KS * lobe[:, None]
    np.testing.assert_allclose(model.evaluate(INCOMING, OUTGOING), expected, rtol=1e-9)


@settings(deadline=None, max_examples=25)
@given(numbers)
def test_one_width_is_ggx(values):
    width, _, rotation = values
    model = AnisotropicGGX(KD, KS, width, width, 1.5, rotation)
    same = brdf_named("ggx", kd=KD, ks=KS, sigma=width, mu=1.5)
    assert model.isotropic
    np.testing.assert_allclose(
        model.evaluate(INCOMING, OUTGOING), same.evaluate(INCOMING, OUTGOING), rtol=1e-9
    )


@settings(deadline=None, max_examples=25)
@given(numbers)
def test_a_turned_tangent_is_turned_directions(values):
    along, across, rotation = values
    still = AnisotropicGGX(KD, KS, along, across, 1.5)
    turned = AnisotropicGGX(KD, KS, along, across, 1.5, rotation)
    np.testing.assert_allclose(
        turned.evaluate(turn(INCOMING, rotation), turn(OUTGOING, rotation)),
        still.evaluate(INCOMING, OUTGOING),
        rtol=1e-9,
    )
    quarter = AnisotropicGGX(KD, KS, across, along, 1.5, np.pi / 2)
    np.testing.assert_allclose(
        quarter.evaluate(INCOMING, OUTGOING), still.evaluate(INCOMING, OUTGOING), rtol=1e-9
    )


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"roughness": 0.0}, "roughness=0.0: must lie in"),
        ({"roughness_y": 1.2}, "roughness_y=1.2: must lie in"),
        ({"mu": 1.0}, "mu=1.0: must lie in"),
        ({"tangent_rotation": 2.0}, "tangent_rotation=2.0: must lie in"),
    ],
)
def test_a_number_outside_its_interval_is_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        AnisotropicGGX(KD, KS, **{"roughness": 0.2, "roughness_y": 0.3, "mu": 1.5, **wrong})


def test_unknown_light_is_refused():
    samples = SurfaceSamples(INCOMING, INCOMING)
    photographs = Observations(samples, np.ones((len(INCOMING), 3)), np.zeros(len(INCOMING), int))
    with pytest.raises(ValueError, match="under known light alone"):
        fit(Scene(unknown("anisotropic-ggx"), Sphere()), photographs)
