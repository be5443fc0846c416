"""Pictures under sources that have a place.

- A matt plane has kd E cos t / d^2 at every pixel; other light adds up.
- A concave shape hides sources from itself; far away it is shadowed as by directional ones.
- The place of a source is differentiable, in compiled programs too; shadows ask for its numbers.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import brdf_named
from jaxrender.geometry import Mesh, Pinhole, Sphere, look_at, observe, sculpture
from jaxrender.lighting import DirectionalSources, PointSources
from jaxrender.reflection import render_lit

SIDE = Pinhole(
    12, 12, look_at(np.array([4.0, 1, 3]), np.zeros(3), np.array([0.0, 0, 1])), fl_x=20.0
)
KD = np.array([0.2, 0.1, 0.05])
MATT = brdf_named("lambertian", kd=KD)
GLOSSY = brdf_named("ggx", kd=KD, ks=np.full(3, 0.1), sigma=0.3, mu=1.5)
PLACE, INTENSITY = np.array([[0.5, 1.5, 2.0]]), np.array([[3.0, 2.0, 1.0]])
LAMP = PointSources(PLACE, INTENSITY)
CARD = Mesh(
    np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
)


def test_a_matt_plane_is_lit_by_the_inverse_square():
    view = observe(SIDE, CARD)
    found = np.asarray(render_lit(MATT, LAMP, CARD, SIDE))
    assert view.hit.sum() > 20
    arrow = PLACE[0] - view.points[view.hit]
    distance = np.linalg.norm(arrow, axis=1)
    expected = KD * INTENSITY * (arrow[:, 2] / distance**3)[:, None]
    np.testing.assert_allclose(found[view.hit], expected, rtol=1e-9)
    assert not found[~view.hit].any()
    # It is not the picture of a light that is far away.
    assert np.ptp(expected[:, 0]) > 0.3 * expected[:, 0].max()


def test_all_lights_add_up():
    sun = DirectionalSources(np.array([[1.0, 0.2, 0.5]]), np.ones((1, 3)))
    other = PointSources(np.array([[2.0, -2.0, 1.0]]), np.ones((1, 3)))
    apart = [np.asarray(render_lit(GLOSSY, one, Sphere(), SIDE)) for one in (sun, LAMP, other)]
    found = render_lit(GLOSSY, LAMP + sun + other, Sphere(), SIDE)
    assert all(image.any() for image in apart)
    np.testing.assert_allclose(found, sum(apart), rtol=1e-9, atol=1e-12)


def test_concave_shapes_hide_sources():
    shape = sculpture(2, 0)
    lit = np.asarray(render_lit(GLOSSY, LAMP, Sphere(), SIDE))
    assert lit.any()
    far, energy = 1e5 * PLACE, 1e10 * INTENSITY
    found = np.asarray(render_lit(GLOSSY, PointSources(far, energy), shape, SIDE))
    sun = DirectionalSources(PLACE, INTENSITY / np.sum(PLACE**2))
    np.testing.assert_allclose(found, render_lit(GLOSSY, sun, shape, SIDE), rtol=1e-3, atol=1e-6)
    unshadowed = np.asarray(render_lit(GLOSSY, PointSources(far, energy), _Convex.of(shape), SIDE))
    assert (found < 0.9 * unshadowed).any()


class _Convex(Mesh):
    """A mesh that is taken to cast no shadows."""

    @classmethod
    def of(cls, mesh):
        return cls(mesh.vertices, mesh.faces)

    def is_convex(self):
        return True


@pytest.mark.parametrize("compiled", [False, True])
def test_the_place_of_a_source_is_differentiable(compiled):
    weights = np.random.default_rng(0).normal(size=(12, 12, 3))

    def loss(place):
        sources = PointSources(place, jnp.asarray(INTENSITY))
        return jnp.sum(weights * render_lit(GLOSSY, sources, Sphere(), SIDE))

    gradient = jax.grad(loss)
    found = np.asarray((jax.jit(gradient) if compiled else gradient)(jnp.asarray(PLACE)))
    for k in range(3):
        moved = np.zeros((1, 3))
        moved[0, k] = 1e-5
        difference = (float(loss(PLACE + moved)) - float(loss(PLACE - moved))) / 2e-5
        np.testing.assert_allclose(found[0, k], difference, rtol=1e-6, atol=1e-9)


def test_shadows_ask_for_the_place():
    shape = sculpture(1, 0)

    def loss(place):
        return jnp.sum(render_lit(MATT, PointSources(place, INTENSITY), shape, SIDE))

    with pytest.raises(ValueError, match="shadows of point sources are traced on the host"):
        jax.grad(loss)(jnp.asarray(PLACE))
