"""Seconds by stage, with compilation as a stage of its own.

JAX reports the seconds of each tracing, lowering and compilation.  They are moved from their stage
to ``compile``.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager

import jax

from jaxrender.pipelines.progress import Progress

_COMPILING = "/jax/core/compile/"


class Clock:
    """Times the stages of one run and passes their names on to a progress display.

    JAX is listened to inside the ``with`` block.
    """

    def __init__(self, progress: Progress):
        self._progress = progress
        # When JAX was at it, by the clock: none of them overlap, and the last comes last.
        self._spans: list[tuple[float, float]] = []
        self.seconds: dict[str, float] = {"compile": 0.0}
        self._started = time.perf_counter()

    def __enter__(self) -> "Clock":
        jax.monitoring.register_event_duration_secs_listener(self._listen)
        return self

    def __exit__(self, *_: object) -> None:
        jax.monitoring.unregister_event_duration_listener(self._listen)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Name what is being done and time it, compilation apart."""
        started, compiled = time.perf_counter(), self._compiled
        with self._progress.stage(name):
            try:
                yield
            finally:
                elapsed = time.perf_counter() - started
                # Announced by another clock, which may be set: never longer than the stage took.
                compiling = min(self._compiled - compiled, elapsed)
                self.seconds["compile"] += compiling
                self.seconds[name] = self.seconds.get(name, 0.0) + elapsed - compiling

    def taken(self) -> dict[str, float]:
        """Return the seconds of all stages so far, and of everything since the start."""
        seconds = {**self.seconds, "total": time.perf_counter() - self._started}
        return {name: round(value, 4) for name, value in seconds.items()}

    @property
    def _compiled(self) -> float:
        return sum((end - start for start, end in self._spans), 0.0)

    def _listen(self, event: str, duration_secs: float, **_: str | int) -> None:
        if not event.startswith(_COMPILING):
            return
        end = time.perf_counter()
        start = end - duration_secs
        # What is traced within another trace is announced by itself first, then with it.
        while self._spans and self._spans[-1][1] > start:
            start = min(start, self._spans.pop()[0])
        self._spans.append((start, end))
