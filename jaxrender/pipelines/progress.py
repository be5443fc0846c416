"""The progress of a run: its stages and their seconds.

A ``Progress`` gets the stages of a run.  On a terminal it is a live display; elsewhere it prints
lines with the seconds since the start; in calls from Python it is silent.  Each kind times the
stages, and the seconds go into the result.
"""

from __future__ import annotations

import os
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol, TextIO, cast, runtime_checkable

from rich.console import Console
from rich.progress import BarColumn, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as LiveDisplay

# Plain lines about a stage's advance are this far apart, so that a log stays readable.
_SECONDS_BETWEEN_LINES = 10.0


@runtime_checkable
class Progress(Protocol):
    """What a run reports its stages to."""

    @property
    def seconds(self) -> dict[str, float]:
        """Seconds spent in each stage so far; a stage that comes twice adds up."""
        ...

    def stage(self, name: str) -> AbstractContextManager[None]:
        """A context manager that names what is being done and times it."""
        ...

    def note(self, text: str) -> None:
        """Say something that a reader should know."""
        ...

    def advance(self, fraction: float) -> None:
        """Report how much of the current stage is done, from 0 to 1."""
        ...


@runtime_checkable
class Stream(Protocol):
    """What progress needs of a stream of text such as ``sys.stderr``."""

    def write(self, text: str, /) -> int:
        """Write a text."""
        ...

    def flush(self) -> None:
        """Send off what was written."""
        ...

    def isatty(self) -> bool:
        """Whether a person looks at it."""
        ...


class _Timed(ABC):
    """The timing of stages, which every kind of progress shares."""

    def __init__(self, clock: Callable[[], float]):
        self.seconds: dict[str, float] = {}
        self._clock = clock

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Name what is being done and time it, also when it fails."""
        start = self._clock()
        self._begin(name)
        finished = False
        try:
            yield
            finished = True
        finally:
            taken = self._clock() - start
            self.seconds[name] = self.seconds.get(name, 0.0) + taken
            self._end(name, taken if finished else None)

    @abstractmethod
    def _begin(self, name: str) -> None: ...

    @abstractmethod
    def _end(self, name: str, taken: float | None) -> None:
        """Close a stage that took so many seconds; None if it failed."""


class SilentProgress(_Timed):
    """Times the stages and prints nothing."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter):
        super().__init__(clock)

    def note(self, text: str) -> None:
        """Say nothing."""

    def advance(self, fraction: float) -> None:
        """Say nothing."""

    def _begin(self, name: str) -> None:
        pass

    def _end(self, name: str, taken: float | None) -> None:
        pass


class PlainProgress(_Timed):
    """Plain lines, each with the seconds since the start: for logs and pipes."""

    def __init__(self, stream: Stream, clock: Callable[[], float] = time.perf_counter):
        super().__init__(clock)
        self._stream = stream
        self._start = self._last_line = clock()
        self._open: list[str] = []

    def note(self, text: str) -> None:
        """Write a line."""
        self._last_line = self._clock()
        self._stream.write(f"[{self._last_line - self._start:7.1f} s] {text}\n")
        self._stream.flush()

    def advance(self, fraction: float) -> None:
        """Write how much is done, unless something was written a moment ago."""
        if self._clock() - self._last_line >= _SECONDS_BETWEEN_LINES:
            name = self._open[-1] if self._open else "all"
            self.note(f"{name}: {fraction:.0%}")

    def _begin(self, name: str) -> None:
        self._open.append(name)
        self.note(name)

    def _end(self, name: str, taken: float | None) -> None:
        self._open.pop()
        self.note(f"{name}: failed" if taken is None else f"{name}: done in {taken:.2f} s")


class RichProgress(_Timed):
    """A live display on a terminal; each finished stage leaves one line."""

    def __init__(self, console: Console, clock: Callable[[], float] = time.perf_counter):
        super().__init__(clock)
        self._console = console
        self._display: LiveDisplay | None = None
        self._open: list = []

    def note(self, text: str) -> None:
        """Write a line above the live display."""
        self._console.print(text, markup=False, highlight=False)

    def advance(self, fraction: float) -> None:
        """Move the bar of the current stage."""
        if self._display is not None:
            self._display.update(self._open[-1], total=1.0, completed=fraction)

    def _begin(self, name: str) -> None:
        if self._display is None:
            self._display = LiveDisplay(
                SpinnerColumn(),
                TextColumn("{task.description}", markup=False),
                BarColumn(),
                TimeElapsedColumn(),
                console=self._console,
                transient=True,
            )
            self._display.start()
        # Without a total the bar only shows that something goes on.
        self._open.append(self._display.add_task(name, total=None))

    def _end(self, name: str, taken: float | None) -> None:
        if self._display is None:
            return
        self._display.remove_task(self._open.pop())
        if not self._open:
            # Stopped between stages: what the program then writes must not be painted over.
            self._display.stop()
            self._display = None
        self.note(f"{name}: failed" if taken is None else f"{name}: {taken:.2f} s")


def choose(stream: Stream) -> Progress:
    """A live display if the stream is a terminal that can show one, plain lines otherwise."""
    is_live = stream.isatty() and os.environ.get("TERM", "dumb") != "dumb"
    return RichProgress(Console(file=cast(TextIO, stream))) if is_live else PlainProgress(stream)
