"""Functions of many samples: what batches return, how large they are, and what is compiled."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxrender.batches import even, in_batches


@pytest.mark.parametrize("count", [0, 1, 3, 4, 7, 12])
def test_batches_return_what_each_sample_alone_does(count):
    rng = np.random.default_rng(0)
    samples = {"rows": jnp.asarray(rng.normal(size=(count, 2))), "at": jnp.arange(count)}

    def function(one):
        return {"sum": jnp.sum(one["rows"]), "at": 3 * one["at"]}

    found = in_batches(function, samples, 4)
    expected = jax.vmap(function)(samples)
    assert jax.tree.structure(found) == jax.tree.structure(expected)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(expected)):
        np.testing.assert_array_equal(one, other)


def test_the_function_is_compiled_once_for_any_number_of_samples():
    program = jax.make_jaxpr(lambda x: in_batches(jnp.sin, x, 4))(jnp.ones(10))
    assert str(program).count("sin ") == 1


def test_what_fills_up_has_no_part_in_derivatives():
    x = jnp.asarray([0.3, 2.0, 5.0, 7.0, 11.0])
    slope = jax.grad(lambda x: jnp.sum(in_batches(jnp.log, x, 2)))(x)
    np.testing.assert_allclose(slope, 1 / x, rtol=1e-15)


@given(st.integers(0, 10**6), st.integers(0, 10**4))
def test_batches_are_few_and_even(count, most):
    batches, size = even(count, most)
    assert batches == -(-count // max(most, 1))
    assert size <= max(most, 1)
    assert 0 <= batches * size - count < max(batches, 1)
