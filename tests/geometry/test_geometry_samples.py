"""Surface samples: normals and outgoing directions of pixels.

Pinned down: the exit cosine is N.V; R lies in the plane of N and V, on the other side of N at the
same angle; seen head-on, R is the normal; the samples are a pytree that differentiates.
"""

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import SurfaceSamples, direction_from_angles

ROUNDING = 1e-15
# The camera at azimuth .4 and 50 degrees from +Z; the normal at the same azimuth, 20 degrees.
DEGREES = np.pi / 180
SAMPLES = SurfaceSamples(
    np.asarray(direction_from_angles(np.full(1, 20 * DEGREES), np.full(1, 0.4))),
    np.asarray(direction_from_angles(np.full(1, 50 * DEGREES), np.full(1, 0.4))),
)


def test_exit_cosine_is_that_of_the_angle_between():
    np.testing.assert_allclose(SAMPLES.exit_cosines, [np.cos(30 * DEGREES)], atol=ROUNDING)


def test_reflected_direction_lies_across_the_normal():
    """30 degrees on the other side of 20 is -10: polar angle 10 at the opposite azimuth."""
    expected = direction_from_angles(np.full(1, 10 * DEGREES), np.full(1, 0.4 + np.pi))
    np.testing.assert_allclose(SAMPLES.reflected, expected, atol=ROUNDING)


def test_head_on_the_mirror_looks_back():
    head_on = SurfaceSamples(SAMPLES.normals, SAMPLES.normals)
    np.testing.assert_allclose(head_on.reflected, SAMPLES.normals, atol=ROUNDING)
    np.testing.assert_allclose(head_on.exit_cosines, [1], atol=ROUNDING)


def test_derivative_of_the_exit_cosine():
    """d(N.V) / dN = V."""
    slope = jax.grad(lambda s: s.exit_cosines.sum())(jax.tree.map(jnp.asarray, SAMPLES))
    np.testing.assert_allclose(slope.normals, SAMPLES.outgoing, atol=ROUNDING)
    np.testing.assert_allclose(slope.outgoing, SAMPLES.normals, atol=ROUNDING)


def test_single_precision_stays_single():
    single = SurfaceSamples(*(a.astype(np.float32) for a in SAMPLES))
    assert single.exit_cosines.dtype == single.reflected.dtype == jnp.float32
