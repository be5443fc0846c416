"""BLAS kept from waiting at a processor's expense.

XLA calls LAPACK for its factorizations of matrices.  LAPACK's own threads, once woken by a large
one, spin for a while in case more is coming, each on a processor that XLA's next step then lacks:
on two processors, a fit that factorizes a matrix of some hundred rows at every step takes a third
longer.
"""

from contextlib import AbstractContextManager
from functools import cache

from threadpoolctl import ThreadpoolController


def one_blas_thread() -> AbstractContextManager:
    """Make BLAS and LAPACK work on the calling thread alone, until the context is left."""
    return _controller().limit(limits=1, user_api="blas")


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()
