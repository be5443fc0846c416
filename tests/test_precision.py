"""Arrays of real numbers are converted to another precision, and nothing else of a tree is."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.shapes import in_precision


def test_real_arrays_alone_are_converted():
    given = {"real": np.arange(3.0), "whole": np.arange(3), "mask": np.ones(2, bool), "name": "x"}
    found = in_precision(np.float32, (given, jnp.asarray(2.0), 1.5, None))
    assert found[0]["real"].dtype == np.float32
    np.testing.assert_array_equal(found[0]["real"], given["real"])
    assert found[0]["whole"] is given["whole"]
    assert found[0]["mask"] is given["mask"]
    assert found[0]["name"] == "x"
    assert found[1].dtype == np.float32
    assert found[2:] == (1.5, None)


def test_double_precision_is_that_of_jax():
    single = np.ones(2, np.float32)
    for enabled, wanted in ((True, np.float64), (False, np.float32)):
        with jax.enable_x64(enabled):
            assert in_precision(np.float64, single).dtype == wanted
