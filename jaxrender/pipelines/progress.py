"""The progress of a run: its stages and their seconds.

A ``Progress`` gets the stages of a run.  On a terminal it is a live display.  Where nobody looks it
says what a reader should know, and no more; for programs it writes lines of JSON; in calls from
Python it is silent.  Each kind times the stages, and the seconds go into the result.
"""

from __future__ import annotations

import json
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from datetime import timedelta
from typing import Protocol, TextIO, cast, runtime_checkable

from rich.console import Console, RenderableType
from rich.progress import (
    BarColumn,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.progress import Progress as LiveDisplay
from rich.text import Text

# Plain lines about a stage's advance are this far apart, so that a log stays readable.
_SECONDS_BETWEEN_LINES = 10.0
# A program that draws a bar of its own wants them closer.
_SECONDS_BETWEEN_REPORTS = 0.5
# What takes less needs no bar: it would only flicker.
_PATIENCE = 2.0

# What the stages of a fit, and of other commands, are about.
MEANINGS = {
    "synth": "rendering the photographs of the recipe",
    "load": "reading photographs, masks, geometry and light",
    "trace": "finding the surface point of each pixel",
    "rough": "first rough fit, from many starts",
    "split": "separating slow light and sources",
    "table": "tabulating the model over roughness",
    "compile": "compiling",
    "solve": "fit in the frequency view",
    "refine": "refinement by the exact integral",
    "light": "finding the light, source by source",
    "texture": "sigma and mu, then the material of every texel",
    "spectrum": "solving for the coefficients",
    "shadows": "tracing shadows",
    "misfit": "noise between neighbouring pixels",
    "diagnosis": "what would explain the rest",
    "calibration": "finding what was freed",
    "account": "error bars",
    "compare": "comparing the models on held-out pixels",
    "interreflection": "light that bounces between parts of the object",
    "variants": "fits of other choices for the specular part",
    "forecast": "predicted error bars",
    "result": "summing up",
    "predict": "rendering the predictions",
    "write": "writing files",
    "report": "the report's page",
}


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


class NotedProgress(SilentProgress):
    """Writes what a reader should know, and nothing about the stages: for pipes."""

    def __init__(self, stream: Stream, clock: Callable[[], float] = time.perf_counter):
        super().__init__(clock)
        self._stream = stream

    def note(self, text: str) -> None:
        """Write a line."""
        self._stream.write(f"{text}\n")
        self._stream.flush()


class JsonProgress(_Timed):
    """One JSON object a line, for programs.

    Each has ``event`` (begin, advance, end, failed, note) and ``time``, seconds since the start;
    ``stage``, ``fraction``, ``remaining`` (seconds, of this stage), ``seconds`` and ``text`` as the
    event needs them.
    """

    def __init__(self, stream: Stream, clock: Callable[[], float] = time.perf_counter):
        super().__init__(clock)
        self._stream = stream
        self._start = clock()
        self._last_report = self._start - _SECONDS_BETWEEN_REPORTS
        # Each open stage, and when it began.
        self._open: list[tuple[str, float]] = []

    def note(self, text: str) -> None:
        """Report a text."""
        self._report("note", text=text)

    def advance(self, fraction: float) -> None:
        """Report how much is done, unless that was reported a moment ago."""
        now = self._clock()
        if not self._open or now - self._last_report < _SECONDS_BETWEEN_REPORTS:
            return
        self._last_report = now
        name, began = self._open[-1]
        left = (now - began) * (1 - fraction) / fraction if fraction > 0 else None
        remaining = {} if left is None else {"remaining": round(left, 3)}
        self._report("advance", stage=name, fraction=round(float(fraction), 4), **remaining)

    def _begin(self, name: str) -> None:
        self._open.append((name, self._clock()))
        self._report("begin", stage=name)

    def _end(self, name: str, taken: float | None) -> None:
        _, began = self._open.pop()
        event = "failed" if taken is None else "end"
        self._report(event, stage=name, seconds=round(self._clock() - began, 3))

    def _report(self, event: str, **values: str | float) -> None:
        time_ = round(self._clock() - self._start, 3)
        self._stream.write(json.dumps({"event": event, "time": time_} | values) + "\n")
        self._stream.flush()


class _Remaining(ProgressColumn):
    """The remaining time of a stage that says how much of it is done."""

    def render(self, task: Task) -> Text:
        """Show nothing where nothing is known."""
        ends = task.fields.get("ends")
        if ends is None:
            return Text("")
        left = timedelta(seconds=max(0, round(ends - task.get_time())))
        return Text(f"{left} left", style="progress.remaining")


class _Patient(LiveDisplay):
    """A live display that shows nothing before it is worth it."""

    # It is asked for what to show before it is told when.
    is_due: Callable[[], bool] = staticmethod(lambda: False)

    def get_renderables(self) -> Iterable[RenderableType]:
        """Show the stages, or nothing yet."""
        return super().get_renderables() if self.is_due() else ()


class RichProgress(_Timed):
    """A live display on a terminal: stage, bar, elapsed and remaining time.

    It appears when the run has taken two seconds.  Each stage that took as long leaves one line.
    """

    def __init__(self, console: Console, clock: Callable[[], float] = time.perf_counter):
        super().__init__(clock)
        self._console = console
        self._start = clock()
        self._display: _Patient | None = None
        # Each open stage, and when it began.
        self._open: list[tuple[TaskID, float]] = []

    def note(self, text: str) -> None:
        """Write a line above the live display."""
        self._console.print(text, markup=False, highlight=False)

    def advance(self, fraction: float) -> None:
        """Move the bar of the current stage."""
        if self._display is None:
            return
        now, (task, began) = self._clock(), self._open[-1]
        # As long again for each part as those that are done took.
        ends = began + (now - began) / fraction if fraction > 0 else None
        self._display.update(task, total=1.0, completed=fraction, ends=ends)

    def _begin(self, name: str) -> None:
        if self._display is None:
            self._display = _Patient(
                SpinnerColumn(),
                TextColumn("{task.description}", markup=False),
                BarColumn(bar_width=None),
                TimeElapsedColumn(),
                _Remaining(),
                console=self._console,
                transient=True,
                get_time=self._clock,
                expand=True,
            )
            self._display.is_due = lambda: self._clock() - self._start >= _PATIENCE
            self._display.start()
        # Without a total the bar only shows that something goes on.
        task = self._display.add_task(_described(name), total=None, ends=None)
        self._open.append((task, self._clock()))

    def _end(self, name: str, taken: float | None) -> None:
        if self._display is None:
            return
        self._display.remove_task(self._open.pop()[0])
        if not self._open:
            # Stopped between stages: what the program then writes must not be painted over.
            self._display.stop()
            self._display = None
        if taken is None:
            self.note(f"{name}: stopped")
        elif taken >= _PATIENCE:
            self.note(f"{_described(name)}: {taken:.1f} s")


def _described(name: str) -> str:
    """A stage's name with its meaning, where it is known."""
    return f"{name}: {MEANINGS[name]}" if name in MEANINGS else name


def choose(stream: Stream, quiet: bool = False, as_json: bool = False) -> Progress:
    """Choose the kind for a stream, and for what was asked.

    JSON or silence on request; a live display if the stream is a terminal that can show one, lines
    if it can't; elsewhere only what a reader should know.
    """
    if quiet:
        return SilentProgress()
    if as_json:
        return JsonProgress(stream)
    if not stream.isatty():
        return NotedProgress(stream)
    if os.environ.get("TERM", "dumb") == "dumb" and os.name != "nt":
        return PlainProgress(stream)
    return RichProgress(Console(file=cast(TextIO, stream)))
