"""Single precision keeps its digits beside double precision: near the mirror and far from it."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import BRDFS, PARAMETRIC, lobe_named
from jaxrender.geometry import Components

# Of the largest value.
PROMISED = 1e-5
ONE = np.ones(1)


def model_named(name, sigma):
    plain = lobe_named(name, 1)
    return plain.with_roughness(sigma, plain.mu).with_amplitudes(
        *[ONE] * len(plain.amplitude_names)
    )


@eqx.filter_jit
def lobe(brdf, incoming, outgoing):
    return brdf.transfer(Components.of(incoming), Components.of(outgoing))[-1]


@pytest.mark.parametrize("name", [name for name in PARAMETRIC if name in BRDFS])
def test_narrow_lobes_are_those_of_double_precision(name):
    rng = np.random.default_rng(1)
    cosine = np.repeat([0.02, 0.15, 0.6, 1.0], 200)
    outgoing = np.stack([np.sqrt(1 - cosine**2), 0 * cosine, cosine], axis=-1)
    for sigma in (0.01, 0.1):
        mirror = outgoing * [-1, -1, 1]
        incoming = mirror + sigma * rng.uniform(0, 3, (800, 1)) * rng.standard_normal((800, 3))
        incoming /= np.linalg.norm(incoming, axis=1, keepdims=True)
        incoming[incoming[:, 2] < 1e-3] = mirror[incoming[:, 2] < 1e-3]
        given = model_named(name, sigma), incoming, outgoing
        few = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), given)
        many = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64), few)
        found, exact = lobe(*few), np.asarray(lobe(*many))
        assert found.dtype == jnp.float32
        # Each exit angle has a peak of its own.
        off = np.abs(np.asarray(found, float) - exact).reshape(4, 200).max(axis=1)
        assert (off < PROMISED * exact.max()).all(), (sigma, off / exact.max())


@pytest.mark.parametrize("name", ["phong", "lafortune"])
def test_a_power_below_one_keeps_its_digits_at_right_angles_to_the_mirror(name):
    """Where R . w_i is small its power grows steeply: 1 minus the versine has lost digits."""
    rng = np.random.default_rng(3)
    cosine = np.full(20_000, 0.3)
    outgoing = np.stack([np.sqrt(1 - cosine**2), 0 * cosine, cosine], axis=-1)
    incoming = rng.standard_normal((20_000, 3))
    # At right angles to the mirror direction, but for a thousandth.
    mirror = outgoing * [-1, -1, 1]
    incoming -= np.sum(incoming * mirror, axis=1, keepdims=True) * mirror
    incoming /= np.linalg.norm(incoming, axis=1, keepdims=True)
    incoming += 1e-3 * rng.uniform(0, 1, (20_000, 1)) * mirror
    given = model_named(name, 1.5), incoming, outgoing
    few = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), given)
    many = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64), few)
    off = np.abs(np.asarray(lobe(*few), float) - np.asarray(lobe(*many)))
    # With the versine alone nine tenths are within 2e-5 to 4e-5, not 4e-6.
    assert np.quantile(off, 0.9) < PROMISED * float(lobe(*many).max())
