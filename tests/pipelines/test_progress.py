"""What a run says of itself, and the seconds of its stages.

- Stages are timed, also when they fail or come twice; an inner stage counts inside the outer one.
- Plain lines carry the seconds since the start and are rare enough for a log.
- The live display is for terminals alone and is gone when a stage has ended.  It shows nothing in
  the first two seconds, and then stage, bar, elapsed and remaining time.
- Where nobody looks only notes are written; for programs each line is a JSON object.
"""

import io
import json
import re

import pytest
from rich.console import Console

from jaxrender.pipelines.kept import keeping, kept_after
from jaxrender.pipelines.progress import (
    JsonProgress,
    NotedProgress,
    PlainProgress,
    RichProgress,
    SilentProgress,
    choose,
)


class Clock:
    """A clock that goes on only when it is told to."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


class Terminal(io.StringIO):
    """A stream that claims to be a terminal."""

    def isatty(self):
        return True


def rich_on(stream, clock):
    return RichProgress(Console(file=stream, force_terminal=True, width=80), clock)


def fail_inside(progress, clock, seconds, error):
    with progress.stage("solve"):
        clock.now += seconds
        raise error


KINDS = {
    "silent": lambda stream, clock: SilentProgress(clock),
    "plain": PlainProgress,
    "noted": NotedProgress,
    "json": JsonProgress,
    "rich": rich_on,
}


@pytest.fixture(params=KINDS)
def make(request):
    return KINDS[request.param]


def test_stages_are_timed(make):
    clock = Clock()
    progress = make(io.StringIO(), clock)
    with progress.stage("load"):
        clock.now += 2.0
        progress.advance(0.5)
        progress.note("a note")
    with progress.stage("solve"):
        clock.now += 1.0
        with progress.stage("compile"):
            clock.now += 4.0
            progress.advance(1.0)
    with progress.stage("load"):
        clock.now += 0.5
    assert progress.seconds == {"load": 2.5, "compile": 4.0, "solve": 5.0}


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_a_stage_that_fails_is_timed_and_lets_the_error_through(make, error):
    clock = Clock()
    stream = io.StringIO()
    progress = make(stream, clock)
    with pytest.raises(error):
        fail_inside(progress, clock, 3.0, error)
    assert progress.seconds == {"solve": 3.0}
    with progress.stage("report"):
        pass
    assert "done in 3.00 s" not in stream.getvalue()


def test_advance_outside_a_stage_is_harmless(make):
    clock = Clock()
    progress = make(io.StringIO(), clock)
    clock.now += 100.0
    progress.advance(0.5)
    assert progress.seconds == {}


def test_plain_lines():
    clock, stream = Clock(), io.StringIO()
    progress = PlainProgress(stream, clock)
    with progress.stage("load"):
        clock.now += 1.25
        progress.note("3 photographs [red]")
    with pytest.raises(RuntimeError):
        fail_inside(progress, clock, 10.0, RuntimeError)
    assert stream.getvalue().split("\n") == [
        "[    0.0 s] load",
        "[    1.2 s] 3 photographs [red]",
        "[    1.2 s] load: done in 1.25 s",
        "[    1.2 s] solve",
        "[   11.2 s] solve: failed",
        "",
    ]


def test_plain_lines_about_advance_are_rare():
    clock, stream = Clock(), io.StringIO()
    progress = PlainProgress(stream, clock)
    with progress.stage("trace"):
        for step in range(100):
            clock.now += 0.5
            progress.advance((step + 1) / 100)
    lines = [line for line in stream.getvalue().split("\n") if "%" in line]
    assert lines == [f"[{10.0 * i:7.1f} s] trace: {20 * i}%" for i in range(1, 6)]


def test_live_display_leaves_one_line_a_stage():
    clock, stream = Clock(), Terminal()
    progress = rich_on(stream, clock)
    with progress.stage("load [1]"):
        clock.now += 2.25
        progress.note("3 photographs [red]")
        progress.advance(0.5)
    text = stream.getvalue()
    assert "load [1]: 2.2 s" in text
    assert "3 photographs [red]" in text
    # The cursor is hidden while the display lives and shown again when it ends.
    assert text.rfind("\x1b[?25h") > text.rfind("\x1b[?25l") >= 0


def test_silence_is_silent(capsys):
    progress = SilentProgress()
    with progress.stage("load"):
        progress.note("a note")
    assert capsys.readouterr() == ("", "")


def shown_after(seconds, fraction=None):
    """What stands on the terminal when a stage has run for so long."""
    clock, stream = Clock(), Terminal()
    progress = rich_on(stream, clock)
    with progress.stage("solve"):
        clock.now += seconds / 2
        if fraction is not None:
            progress.advance(fraction / 2)
        clock.now += seconds / 2
        if fraction is not None:
            progress.advance(fraction)
        stream.truncate(stream.seek(0))
        assert progress._display is not None
        progress._display.refresh()
        return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", stream.getvalue()).strip()


def test_a_bar_only_for_what_takes_its_time():
    assert shown_after(1.9) == ""
    bar = shown_after(63.0)
    assert "solve: fit in the frequency view" in bar
    assert "0:01:03" in bar
    assert "left" not in bar


def test_the_bar_says_what_remains():
    # A quarter done in twenty seconds, from then on.
    assert "0:00:20 0:01:00 left" in shown_after(20.0, 0.25)


def test_quick_stages_leave_no_line():
    clock, stream = Clock(), Terminal()
    progress = rich_on(stream, clock)
    with progress.stage("load"):
        clock.now += 1.9
    assert "load" not in stream.getvalue()


def test_only_notes_where_nobody_looks():
    clock, stream = Clock(), io.StringIO()
    progress = NotedProgress(stream, clock)
    with progress.stage("load"):
        clock.now += 20.0
        progress.advance(0.5)
        progress.note("a.exr: warning: left out")
    assert stream.getvalue() == "a.exr: warning: left out\n"


def test_lines_for_programs():
    clock, stream = Clock(), io.StringIO()
    progress = JsonProgress(stream, clock)
    with progress.stage("trace"):
        for step in range(4):
            clock.now += 0.25
            progress.advance((step + 1) / 8)
        progress.note("two\nlines")
    with pytest.raises(RuntimeError):
        fail_inside(progress, clock, 1.0, RuntimeError)
    assert [json.loads(line) for line in stream.getvalue().splitlines()] == [
        {"event": "begin", "time": 0.0, "stage": "trace"},
        {"event": "advance", "time": 0.25, "stage": "trace", "fraction": 0.125, "remaining": 1.75},
        {"event": "advance", "time": 0.75, "stage": "trace", "fraction": 0.375, "remaining": 1.25},
        {"event": "note", "time": 1.0, "text": "two\nlines"},
        {"event": "end", "time": 1.0, "stage": "trace", "seconds": 1.0},
        {"event": "begin", "time": 1.0, "stage": "solve"},
        {"event": "failed", "time": 2.0, "stage": "solve", "seconds": 1.0},
    ]


def test_an_interrupt_says_what_is_kept():
    stop = KeyboardInterrupt()
    assert kept_after(stop) == "nothing was written; an earlier result is as it was"
    rows = 3
    with pytest.raises(KeyboardInterrupt) as caught, keeping(lambda: f"{rows} rows are kept"):
        raise stop
    assert kept_after(caught.value) == "3 rows are kept"


def test_choose(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    assert isinstance(choose(Terminal()), RichProgress)
    assert type(choose(io.StringIO())) is NotedProgress
    monkeypatch.setenv("TERM", "dumb")
    assert isinstance(choose(Terminal()), PlainProgress)
    assert type(choose(Terminal(), quiet=True)) is SilentProgress
    assert isinstance(choose(Terminal(), as_json=True), JsonProgress)
