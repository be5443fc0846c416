"""BLAS kept from waiting at a processor's expense.

XLA calls LAPACK for its factorizations of matrices.  LAPACK's own threads, once woken by a large
one, spin for a while in case more is coming, each on a processor that XLA's next step then lacks:
on two processors, a fit that factorizes a matrix of some hundred rows at every step takes a third
longer.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from threading import Lock

from threadpoolctl import ThreadpoolController

# The limit is the whole process's: of uses that overlap the first sets it, the last lifts it.
_LOCK, _LIMIT, _USES = Lock(), ExitStack(), set[object]()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Make BLAS and LAPACK work on the calling thread alone, until the context is left."""
    use = object()
    with _LOCK:
        if not _USES:
            _LIMIT.enter_context(_controller().limit(limits=1, user_api="blas"))
        _USES.add(use)
    try:
        yield
    finally:
        with _LOCK:
            _USES.remove(use)
            if not _USES:
                _LIMIT.close()


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()
