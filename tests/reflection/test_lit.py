"""Pictures under any light.

- A sum of lights gives the sum of pictures; lobes are integrated, on convex shapes, to the digits
  of the quadrature, and concave ones are shadowed.
- Derivatives by material, light and the direction of a source are central differences.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import brdf_named
from jaxrender.geometry import Pinhole, Sphere, look_at, sculpture
from jaxrender.lighting import DirectionalSources, Environment, HarmonicLight, SmoothLobes
from jaxrender.reflection import ExactForward, ShadowedForward, forward_of, render, render_lit

CAMERA = Pinhole(
    10, 10, look_at(np.array([6.0, 0, 1]), np.zeros(3), np.array([0.0, 0, 1])), fl_x=25.0
)
BALL = Sphere()
SOURCE = DirectionalSources(np.array([[0.7, 0.6, 0.8]]), np.array([[1.0, 0.9, 0.8]]))
PROBE = Environment(np.random.default_rng(0).uniform(size=(8, 16, 3)))
LOBES = SmoothLobes(np.array([[1.0, 0.4, 1.0]]), np.array([0.4]), np.array([[2.0, 1.0, 0.5]]))
KD = np.array([0.2, 0.1, 0.1])


def ggx(sigma=0.3, kd=KD):
    return brdf_named("ggx", kd=kd, ks=jnp.full(3, 0.1), sigma=sigma, mu=1.5)


def test_a_sum_of_lights_is_a_sum_of_pictures():
    apart = [np.asarray(render_lit(ggx(), part, BALL, CAMERA)) for part in (PROBE, SOURCE, LOBES)]
    found = render_lit(ggx(), PROBE + SOURCE + LOBES, BALL, CAMERA)
    assert all(image.any() for image in apart)
    np.testing.assert_allclose(found, sum(apart), rtol=1e-12, atol=1e-14)


def test_lobes_are_integrated():
    """By a quadrature about each normal, which the sum over many nodes comes close to."""
    model = forward_of(LOBES, BALL)
    assert isinstance(model, ExactForward)
    assert model.lobes is not None
    found = np.asarray(render_lit(ggx(), LOBES, BALL, CAMERA))
    summed = np.asarray(render(ggx(), CAMERA, BALL, ExactForward(LOBES.nodes())))
    assert 0 < np.abs(found - summed).max() < 0.02 * found.max()


def test_concave_shapes_shadow_themselves():
    shape = sculpture(2, 0)
    assert isinstance(forward_of(SOURCE, shape), ShadowedForward)
    found = np.asarray(render_lit(ggx(), SOURCE + LOBES, shape, CAMERA))
    lit = np.asarray(render(ggx(), CAMERA, shape, ExactForward((SOURCE + LOBES).nodes())))
    assert (found <= lit + 1e-12).all()
    assert (found < 0.9 * lit).any()


SLOW = np.random.default_rng(1).normal(size=(9, 3)) * 0.1 + np.eye(9, 3)
PATHS = {
    "sigma": (0.3, lambda s: render_lit(ggx(s), SOURCE, BALL, CAMERA)),
    "kd": (KD, lambda kd: render_lit(ggx(kd=kd), SOURCE, BALL, CAMERA)),
    "coefficients": (SLOW, lambda c: render_lit(ggx(), HarmonicLight(c) + SOURCE, BALL, CAMERA)),
    "lobes": (
        np.asarray(LOBES.middle),
        lambda m: render_lit(
            ggx(), SOURCE + SmoothLobes(LOBES.directions, LOBES.widths, m), BALL, CAMERA
        ),
    ),
    "direction": (
        np.array([[0.7, 0.6, 0.8]]),
        lambda d: render_lit(ggx(), DirectionalSources(d, SOURCE.irradiance), BALL, CAMERA),
    ),
}


@pytest.mark.parametrize("which", PATHS)
def test_derivatives_are_differences(which):
    start, picture = PATHS[which]
    move = np.random.default_rng(2).normal(size=np.shape(start))

    def loss(step):
        return jnp.sum(jnp.sin(picture(start + step * move)))

    h = 1e-4
    wanted = (8 * (loss(h) - loss(-h)) - (loss(2 * h) - loss(-2 * h))) / (12 * h)
    assert jax.jit(jax.grad(loss))(0.0) == pytest.approx(float(wanted), rel=1e-6)
