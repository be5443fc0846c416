"""What a run says of itself, and the seconds of its stages.

- Stages are timed, also when they fail or come twice; an inner stage counts inside the outer one.
- Plain lines carry the seconds since the start and are rare enough for a log.
- The live display is for terminals alone and is gone when a stage has ended.
"""

import io

import pytest
from rich.console import Console

from jaxrender.pipelines.progress import PlainProgress, RichProgress, SilentProgress, choose


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
        clock.now += 1.25
        progress.note("3 photographs [red]")
        progress.advance(0.5)
    text = stream.getvalue()
    assert "load [1]: 1.25 s" in text
    assert "3 photographs [red]" in text
    # The cursor is hidden while the display lives and shown again when it ends.
    assert text.rfind("\x1b[?25h") > text.rfind("\x1b[?25l") >= 0


def test_silence_is_silent(capsys):
    progress = SilentProgress()
    with progress.stage("load"):
        progress.note("a note")
    assert capsys.readouterr() == ("", "")


def test_choose(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    assert isinstance(choose(Terminal()), RichProgress)
    assert isinstance(choose(io.StringIO()), PlainProgress)
    monkeypatch.setenv("TERM", "dumb")
    assert isinstance(choose(Terminal()), PlainProgress)
