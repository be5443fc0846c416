"""Seconds by stage: what JAX spends on compiling is told apart, and nothing is lost.

- Stages that come twice add up; a stage that fails is timed; names reach the progress display.
- Compilation inside a stage is taken off it and counted as ``compile``; the sum is the elapsed
  time.
- What is traced within another trace is announced by itself and with it, and counts once.
- JAX is listened to inside the block only.
"""

import time

import jax
import jax.numpy as jnp
import pytest

from jaxrender.pipelines.clock import Clock
from jaxrender.pipelines.progress import SilentProgress

# Longer than the clock's own overhead by far, short enough for a test.
PAUSE = 0.05


def test_stages_add_up_and_reach_the_display():
    progress = SilentProgress()
    with Clock(progress) as clock:
        for _ in range(2):
            with clock.stage("load"):
                time.sleep(PAUSE)
        taken = clock.taken()
    assert taken["load"] >= 2 * PAUSE
    assert taken["compile"] == 0
    assert taken["total"] >= taken["load"]
    assert progress.seconds["load"] >= 2 * PAUSE


def fail_slowly():
    time.sleep(PAUSE)
    raise RuntimeError("broken")


def test_a_stage_that_fails_is_timed():
    with Clock(SilentProgress()) as clock:
        with pytest.raises(RuntimeError, match="broken"), clock.stage("load"):
            fail_slowly()
        assert clock.taken()["load"] >= PAUSE


def test_compilation_is_told_apart():
    with Clock(SilentProgress()) as clock:
        started = time.perf_counter()
        with clock.stage("solve"):
            # A program that nobody has compiled before.
            jax.jit(lambda x: jnp.sin(x) * 0.7310585 + jnp.cos(x))(jnp.ones(37)).block_until_ready()
        elapsed = time.perf_counter() - started
        taken = clock.taken()
    assert taken["compile"] > taken["solve"]
    # Rounded to four digits.
    assert taken["compile"] + taken["solve"] == pytest.approx(elapsed, abs=2e-3)


def test_what_is_compiled_outside_the_block_does_not_count():
    with Clock(SilentProgress()) as clock:
        pass
    before = clock._compiled
    jax.jit(lambda x: jnp.sin(x) * 0.6180339)(jnp.ones(41)).block_until_ready()
    assert clock._compiled == before


def test_nested_announcements_count_once():
    with Clock(SilentProgress()) as clock:
        with clock.stage("solve"):
            for announced in (PAUSE, PAUSE, 4 * PAUSE):
                time.sleep(2 * PAUSE)
                clock._listen("/jax/core/compile/jaxpr_trace_duration", announced)
        taken = clock.taken()
    # The last covers the second, not the first.
    assert taken["compile"] == pytest.approx(5 * PAUSE, abs=PAUSE / 2)


def test_nested_announcements_never_exceed_the_stage():
    with Clock(SilentProgress()) as clock:
        with clock.stage("solve"):
            clock._listen("/jax/core/compile/backend_compile_duration", 1e6)
            clock._listen("/jax/core/other", 1e6)
        assert clock.taken()["compile"] < 1
        assert clock.taken()["solve"] >= 0
