"""Blender as another process: where it is, and how a script runs in it.

Its wheel ``bpy`` asks for NumPy below 2, which JAX has left behind; it holds one scene for the
whole process, changes signal handlers and prints.  So it never runs in ours.  A child process may
be our own interpreter, where ``bpy`` was installed without its dependencies, or Blender itself.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from jaxrender.errors import InputError

# Names Blender, or a Python that has bpy.
VARIABLE = "JAXRENDER_BLENDER"
REMEDY = (
    'pip install --no-deps "bpy==5.0.*" (Python 3.11), or install Blender and put it on the path, '
    f"or name it by {VARIABLE}"
)
_HEADLESS = ("--background", "--factory-startup", "--python-exit-code", "1", "--python")


def blender_command() -> tuple[str, ...]:
    """Find what runs a script: ``JAXRENDER_BLENDER``, the wheel ``bpy``, or ``blender``.

    Raises ``InputError`` with the remedy where there is none.
    """
    named = os.environ.get(VARIABLE)
    if named:
        found = shutil.which(named)
        if found is None:
            raise InputError(f"{VARIABLE}={named}: no such program; name Blender, or a Python")
        return _command(found)
    if find_spec("bpy") is not None:
        return _command(sys.executable)
    found = shutil.which("blender")
    if found is None:
        raise InputError(f"Blender is not there: {REMEDY}")
    return _command(found)


def run_in_blender(script: Path, arguments: Sequence[str | Path]) -> str:
    """Run a script that imports ``bpy``, and return what it printed.

    The arguments are the last of its ``sys.argv``.  Raises ``InputError`` where Blender is missing,
    and with its last words where the script failed.
    """
    command = blender_command()
    parts = [*command, str(script), "--", *map(str, arguments)]
    done = subprocess.run(parts, capture_output=True, text=True, errors="replace", check=False)
    if done.returncode:
        said = [line for line in (done.stdout + done.stderr).splitlines() if line.strip()]
        last = said[-1].strip() if said else "nothing"
        raise InputError(
            f"{command[0]}: Blender ended with code {done.returncode}; its last words: {last}"
        )
    return done.stdout


def _command(program: str) -> tuple[str, ...]:
    """A Python must not take modules from beside the script; Blender has no window to open."""
    is_python = Path(program).stem.startswith("python")
    return (program, "-P") if is_python else (program, *_HEADLESS)
