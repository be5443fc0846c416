"""The application that commands register with, its exit codes, and its entry ``main``."""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Sequence

from cyclopts import App, CycloptsError, Parameter

from jaxrender import __version__
from jaxrender.errors import InputError
from jaxrender.pipelines.kept import kept_after

DONE, NOT_CONVERGED, BAD_INPUT, INTERRUPTED, UNREAD = 0, 1, 2, 130, 141

_NAMED = Parameter(negative=())

app = App(
    name="jaxrender",
    help="Recover materials and lighting from photographs of objects of known shape.\n\n"
    "Exit codes: 0 done; 1 not converged or not identifiable (with --strict), or something that "
    "doctor found broken; 2 bad input; 130 interrupted; 141 the output was closed.",
    version=__version__,
    default_parameter=_NAMED,
    # What docstrings say is plain text; the library for Markdown would cost time.
    help_format="plaintext",
    result_action="return_value",
    exit_on_error=False,
    suppress_keyboard_interrupt=False,
)


app.register_install_completion_command(
    help="Let the shell complete commands and options (bash, zsh, fish, PowerShell)."
)


def examples(*lines: str) -> str:
    """The end of a command's help: command lines without the program's name."""
    return "Examples:\n\n" + "\n".join(f"  {app.name[0]} {line}" for line in lines)


def main(arguments: Sequence[str]) -> int:
    """Run a command line and return its exit code."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    try:
        return app(list(arguments)) or DONE
    except CycloptsError:
        # cyclopts has said what is wrong with the arguments.
        return BAD_INPUT
    except InputError as error:
        _tell(arguments, "error", str(error), "")
        return BAD_INPUT
    except KeyboardInterrupt as stop:
        _tell(arguments, "interrupted", kept_after(stop), "interrupted: ")
        return INTERRUPTED


def _tell(arguments: Sequence[str], event: str, text: str, heading: str) -> None:
    """Write how a command ended, as JSON for a program that reads its progress so."""
    line = json.dumps({"event": event, "text": text}) if "--json" in arguments else heading + text
    sys.stderr.write(f"{line}\n")
