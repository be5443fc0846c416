"""Seconds by stage, with what JAX spent on compiling told apart.

JAX announces how long each tracing, lowering and compilation took; those inside a stage are taken
off its time and added to ``compile``.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager

import jax

from jaxrender.pipelines.progress import Progress

_COMPILING = "/jax/core/compile/"


class Clock:
    """Times the stages of one run and passes their names on to a progress display."""

    def __init__(self, progress: Progress):
        self._progress = progress
        self._compiled = 0.0
        self.seconds: dict[str, float] = {"compile": 0.0}
        self.started = time.perf_counter()
        jax.monitoring.register_event_duration_secs_listener(self._listen)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Name what is being done and time it, compilation apart."""
        started, compiled = time.perf_counter(), self._compiled
        with self._progress.stage(name):
            try:
                yield
            finally:
                elapsed = time.perf_counter() - started
                # Nested traces are announced twice; a stage cannot compile longer than it took.
                compiling = min(self._compiled - compiled, elapsed)
                self.seconds["compile"] += compiling
                self.seconds[name] = self.seconds.get(name, 0.0) + elapsed - compiling

    def close(self) -> dict[str, float]:
        """Stop listening and return the seconds of all stages and the total."""
        jax.monitoring.unregister_event_duration_listener(self._listen)
        self.seconds["total"] = time.perf_counter() - self.started
        return {name: round(seconds, 4) for name, seconds in self.seconds.items()}

    def _listen(self, event: str, seconds: float, **_: object) -> None:
        if event.startswith(_COMPILING):
            self._compiled += seconds
