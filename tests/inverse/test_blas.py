"""BLAS keeps to one thread while it is asked to, and has its own again afterwards.

- While a factorization runs, and not after it.
- Uses that overlap, as of fits in several threads: the last to leave lifts the limit.
"""

import numpy as np
import pytest
from inverse_problems import ball_samples
from threadpoolctl import threadpool_info, threadpool_limits

from jaxrender.brdf import Microfacet
from jaxrender.inverse import FactorSettings, Observations, factorize
from jaxrender.inverse.blas import one_blas_thread


def threads() -> set[int]:
    return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}


@pytest.mark.slow
def test_while_a_factorization_runs():
    samples, _ = ball_samples(100, 0.2, seed=0)
    grey = 1 + 0.3 * np.asarray(samples.normals)[:, 2:] * np.ones((1, 3))
    observations = Observations(samples, grey, np.zeros(len(grey), int))
    paint = Microfacet(np.full(3, 0.3), np.full(3, 0.3), 0.2, None)
    seen = []
    with threadpool_limits(2, user_api="blas"):
        factorize(
            observations,
            paint,
            FactorSettings(1, 1, refine=False),
            watch=lambda _: seen.append(threads()),
        )
        assert threads() == {2}
    assert seen
    assert all(counts == {1} for counts in seen)


def test_uses_that_overlap():
    with threadpool_limits(2, user_api="blas"):
        first, second = one_blas_thread(), one_blas_thread()
        with first:
            second.__enter__()
            assert threads() == {1}
        assert threads() == {1}
        second.__exit__(None, None, None)
        assert threads() == {2}
