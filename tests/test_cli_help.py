"""What the command line says of itself: examples that are understood, completion, pages.

- The help of every command ends with two examples, and each would run as it stands.
- Every command that takes a while says how its progress is reported.
- A page opens only where a person can see it.
"""

import inspect
import sys
import types
from pathlib import Path

import pytest

import jaxrender
from jaxrender import cli
from jaxrender.cli import process
from jaxrender.cli.app import app


def commands():
    return sorted(name for name in app if not name.startswith("-"))


@pytest.mark.parametrize("command", commands())
def test_help_ends_with_two_examples_that_are_understood(command, capsys):
    assert cli.main([command, "--help"]) == 0
    _, examples = capsys.readouterr().out.split("Examples:\n")
    # The help is as wide as the terminal of who asked for it first, and breaks longer lines.
    nothing, *lines = " ".join(examples.split()).split("jaxrender ")
    assert (nothing, len(lines)) == ("", 2)
    for line in lines:
        words = line.split()
        assert words[0] == command
        function, bound, _ = app.parse_args(words, exit_on_error=False, print_error=False)
        assert function is app[command].default_command
        # A config or a recipe of ours that is named is there.
        for word in words:
            if word.startswith(("configs/", "data_synth/")):
                assert process.bundled(Path(word)).exists(), word
        assert bound is not None


def test_every_command_that_takes_a_while_reports():
    for command in set(commands()) - {"schema", "doctor"}:
        function = app[command].default_command
        assert "reporting" in inspect.signature(function).parameters, command


def test_completion_is_written_where_it_is_asked_for(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("HOME", str(tmp_path))
    script = tmp_path / "completion"
    for shell in ("bash", "zsh", "fish"):
        line = ["--install-completion", "--shell", shell, "--output", str(script)]
        assert cli.main(line) == 0
        text = script.read_text()
        assert "evaluate" in text
        assert "dry-run" in text
    assert str(script) in capsys.readouterr().out


@pytest.mark.parametrize(
    ("platform", "display", "terminal", "opens"),
    [
        ("linux", ":0", True, True),
        ("linux", "", True, False),
        ("linux", ":0", False, False),
        ("darwin", "", True, True),
        ("win32", "", False, False),
    ],
)
def test_pages_open_where_a_person_can_see_them(monkeypatch, platform, display, terminal, opens):
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(sys, "stdout", types.SimpleNamespace(isatty=lambda: terminal))
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert process.can_open_pages() is opens


def test_version(capsys):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"{jaxrender.__version__}\n"
