"""Point lights: intensity by direction, cones, flaps, and what arrives.

- Integrated over the sphere an isotropic light has power 4 pi I, a spot 2 pi I / (n + 1), and a
  cone of half angle a of an isotropic one 2 pi (1 - cos a) I: by quadrature.
- The light is asked along -w_s: a light at the ceiling that shines down lights the floor, and with
  the argument w_s (as L 6.3 prints, ERRATA 67) would not.
- The rotation turns the beam; flaps cut by places; a table of intensities fits in.
- Derivatives by position and exponent are those of finite differences; single precision stays.
- Bad exponents, cones and rotations are refused.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.lighting.photometric import AngularIntensity
from jaxrender.lighting.positional import (
    ConeIntensity,
    Flaps,
    IsotropicIntensity,
    PointLight,
    SpotIntensity,
)

ONE = np.array([1.0, 2.0])
# Local +Z to world -Z.
DOWN = np.diag([1.0, -1, -1])
POINTS = np.array([[0.5, 0.2, 0], [-1.0, 1, 0], [0, 0, 5.0]])


def sphere_rule():
    cosine = (np.arange(20000) + 0.5) / 10000 - 1
    azimuth = 2 * np.pi * (np.arange(4) + 0.5) / 4
    sine = np.sqrt(1 - cosine**2)
    directions = np.stack(
        [
            np.outer(sine, np.cos(azimuth)),
            np.outer(sine, np.sin(azimuth)),
            np.outer(cosine, 1 + 0 * azimuth),
        ],
        axis=-1,
    ).reshape(-1, 3)
    return directions, np.full(len(directions), 4 * np.pi / len(directions))


@pytest.mark.parametrize(
    ("light", "power"),
    [
        (IsotropicIntensity(ONE), 4 * np.pi),
        (SpotIntensity(ONE, 5.0), 2 * np.pi / 6),
        (ConeIntensity(IsotropicIntensity(ONE), 0.6), 2 * np.pi * (1 - np.cos(0.6))),
    ],
    ids=["isotropic", "spot", "cone"],
)
def test_power(light, power):
    directions, weights = sphere_rule()
    np.testing.assert_allclose(
        weights @ np.asarray(light.intensity(directions)), power * ONE, rtol=1e-3
    )


def test_a_light_that_shines_down_lights_the_floor():
    light = PointLight(np.array([0, 0, 3.0]), SpotIntensity(ONE, 2.0), DOWN)
    arrival = light.arriving(POINTS)
    towards = np.array([0, 0, 3.0]) - POINTS
    distance = np.linalg.norm(towards, axis=1)
    np.testing.assert_allclose(arrival.directions, towards / distance[:, None])
    np.testing.assert_allclose(arrival.distance, distance)
    cosine = np.maximum(towards[:, 2] / distance, 0)
    np.testing.assert_allclose(arrival.intensity, cosine[:, None] ** 2 * ONE, rtol=1e-12)
    assert (np.asarray(arrival.intensity)[:2] > 0).all()
    assert not np.asarray(arrival.intensity)[2].any()


def test_flaps_cut_by_places():
    flaps = Flaps(np.array([[1.0, 0, 0], [0, 0, 1.0]]), np.array([0.3, 4.0]))
    light = PointLight(np.array([0, 0, 3.0]), IsotropicIntensity(ONE), flaps=flaps)
    lit = np.asarray(light.arriving(POINTS).intensity)[:, 0] > 0
    np.testing.assert_array_equal(lit, [False, True, False])


def test_at_the_light_itself_there_is_none():
    light = PointLight(np.zeros(3), IsotropicIntensity(ONE))
    arrival = light.arriving(np.zeros((1, 3)))
    assert not np.asarray(arrival.intensity).any()
    assert np.isfinite(np.asarray(arrival.directions)).all()


def test_a_table_of_intensities_fits_in():
    table = AngularIntensity(
        np.zeros(1), np.array([0, np.pi / 2]), np.array([[[4.0, 8.0], [0.0, 0.0]]])
    )
    light = PointLight(np.array([0, 0, 3.0]), table)
    arrival = light.arriving(np.array([[0, 0, 0.0], [3.0, 0, 0], [0, 0, 4.0]]))
    np.testing.assert_allclose(arrival.intensity, [[4, 8], [2, 4], [0, 0]], atol=1e-12)


def test_derivatives():
    @jax.jit
    def total(parameters):
        position, exponent = parameters[:3], parameters[3]
        light = PointLight(position, SpotIntensity(ONE, exponent), DOWN)
        arrival = light.arriving(jnp.asarray(POINTS[:2]))
        return jnp.sum(arrival.intensity / arrival.distance[:, None] ** 2)

    start = jnp.array([0.1, 0.3, 3.0, 2.0])
    slopes = jax.grad(total)(start)
    for index, slope in enumerate(slopes):
        step = 1e-5 * jnp.eye(4)[index]
        finite = (total(start + step) - total(start - step)) / 2e-5
        assert float(slope) == pytest.approx(float(finite), rel=1e-6)


def test_single_precision_stays():
    light = PointLight(np.zeros(3), ConeIntensity(SpotIntensity(ONE, 2.0), 0.5), DOWN)
    arrival = light.arriving(POINTS.astype(np.float32))
    assert {part.dtype for part in arrival} == {np.dtype(np.float32)}


def test_bad_lights_are_refused():
    with pytest.raises(ValueError, match="0 or more"):
        SpotIntensity(ONE, -1.0)
    with pytest.raises(ValueError, match="half angle"):
        ConeIntensity(IsotropicIntensity(ONE), 0.0)
    with pytest.raises(ValueError, match="no rotation"):
        PointLight(np.zeros(3), IsotropicIntensity(ONE), np.diag([1.0, 1, -1]))
