"""Captures that are spoilt on purpose, and commands that must refuse them.

A way to spoil a capture is a function of its folder.  A case is such a function, what a command
line overrides, and a pattern of what is said.
"""

import re
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from small_captures import Ball, edit_json, jaxrender, write_ball


def working_directory(folder: Path, monkeypatch) -> Path:
    """Work beside a capture that is fine, ``cap``: three photographs of 16 x 16 pixels."""
    write_ball(folder / "work" / "cap", Ball(views=3, size=16, noise=0))
    monkeypatch.chdir(folder / "work")
    return folder / "work"


def contents(folder):
    return {
        path.relative_to(folder): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


def refused(work, capsys, command):
    """Run a command that must be refused; returns what it said."""
    before = contents(work)
    assert jaxrender(*command, cache=work.parent / "cache") == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in err
    assert contents(work) == before
    assert not (work.parent / "cache").exists()
    said = [line for line in err.splitlines() if not re.match(r"\[ +\d+\.\d s\]", line)]
    assert said
    return "\n".join(said)


def assert_refused(work, capsys, case, *flags):
    """Spoil the capture; a fit must be refused with the message of the case."""
    spoil, overrides, message = case
    spoil(work / "cap")
    said = refused(work, capsys, fit(*overrides, *flags))
    assert re.search(message, said), said


def fit(*overrides):
    return ["fit", "cap/config.yaml", "output=out", *overrides]


# ---------------------------------------------------------------- ways to spoil a capture


def nothing(folder):
    pass


def written(name, text):
    return lambda folder: (folder / name).write_text(text)


def removed(name):
    return lambda folder: (folder / name).unlink()


def frame(number, **given):
    def change(content):
        content["frames"][number].update(given)

    return lambda folder: edit_json(folder / "transforms.json", change)


def write_any(path, pixels):
    """Write an EXR of whatever values, which the project's own writer refuses."""
    rows, columns, channels = pixels.shape
    output = oiio.ImageOutput.create(str(path))
    output.open(str(path), oiio.ImageSpec(columns, rows, channels, "float"))
    output.write_image(np.ascontiguousarray(pixels, np.float32))
    output.close()
