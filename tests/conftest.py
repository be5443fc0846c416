"""Annotations are executed, and the numerics run strict: float64, no silent broadcasting."""

import ctypes
import gc
import mmap
import os
from pathlib import Path
from unittest import mock

import jax
import pytest
from annotations import execute_annotations
from jax._src.api_util import donation_vector
from jax._src.interpreters import mlir

# Compiled programs and traces are most of what a process of tests holds, and each program holds
# some of the 65,530 memory maps that Linux lets a process have.  All are let go at this many bytes,
# which leaves the largest test room below 2 GB; the cache of compiled programs gives them back.
# What stays after that may grow, and each time costs more than a second.
_LIMIT, _LEAST_GROWTH = 1.4e9, 0.15e9
# Of the many threads of the compiler each would keep what it has freed for itself: one arena for
# all holds a tenth less (glibc's M_ARENA_MAX).
if os.name == "posix" and hasattr(ctypes.CDLL(None), "mallopt"):
    ctypes.CDLL(None).mallopt(-8, 1)

# Most of the tests' time goes into compiling.  XLA's older emitters of loops do it a third faster
# (what they make is slower where much is integrated, and quicker elsewhere), and a seventh comes
# from fewer optimisations, short vectors and one thread; the collector need not look through all
# traces so often.
_QUICK_TO_COMPILE = (
    "--xla_cpu_use_fusion_emitters=false",
    "--xla_backend_optimization_level=1",
    "--xla_cpu_prefer_vector_width=128",
    "--xla_cpu_parallel_codegen_split_count=1",
)
os.environ["XLA_FLAGS"] = " ".join([os.environ.get("XLA_FLAGS", ""), *_QUICK_TO_COMPILE])
# Each core has its process of tests: threads of BLAS would wait for one another.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
gc.set_threshold(50_000, 20, 50)

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

# Programs that are not optimised compile in less than half the time; what they compute is small.
jax.config.update("jax_disable_most_optimizations", True)

# For every program JAX makes a context of its intermediate language: 4 to 8 ms, and 1.2 MB that
# stay as long as the program does.  One serves them all, but what is lowered within another.
_new_context = mlir.make_ir_context
_CONTEXT = _new_context()
mlir.make_ir_context = lambda: _new_context() if mlir.ir.Context.current is _CONTEXT else _CONTEXT

execute_annotations()


def pytest_configure(config):
    """What one process has compiled is there for the others, and for the next run."""
    jax.config.update("jax_compilation_cache_dir", str(config.cache.mkdir("compiled")))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


# Where whole fits are made.  Their files take longest, so that they go first: short ones then fill
# up the last minute of both processes.
_FITS = ("inverse", "pipelines", "gradients")


def pytest_collection_modifyitems(items):
    """Files that take long come first, all others as they were."""
    items.sort(key=lambda item: not any(part in item.path.parts for part in _FITS))


_limit = _LIMIT


def _resident_bytes():
    held = Path("/proc/self/statm")
    return int(held.read_text().split()[1]) * mmap.PAGESIZE if held.exists() else 0


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown():
    """After a test that leaves much, every compiled program is let go."""
    global _limit
    if _resident_bytes() > _limit:
        jax.clear_caches()
        # JAX forgets this one, whose keys hold functions, and with them all that these have seen.
        donation_vector.cache_clear()
        gc.collect()
        # The C library keeps what is freed until it is told to give it back.
        ctypes.CDLL(None).malloc_trim(0)
        _limit = max(_LIMIT, _resident_bytes() + _LEAST_GROWTH)


@pytest.fixture(scope="session", autouse=True)
def commands_leave_the_settings_of_jax_alone():
    """A command keeps its programs in the user's folder, and would keep later ones there, too."""
    with mock.patch("jaxrender.cli.process.set_up_jax"):
        yield


@pytest.fixture(scope="module", autouse=True)
def programs_are_optimised_where_much_is_computed(request):
    """A file that says ``COMPUTES_MUCH = True`` runs longer than it compiles."""
    jax.config.update(
        "jax_disable_most_optimizations", not getattr(request.module, "COMPUTES_MUCH", False)
    )
