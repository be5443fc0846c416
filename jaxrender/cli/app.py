"""The application that commands register with, its exit codes, and its entry ``main``."""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence

from cyclopts import App, CycloptsError, Parameter

from jaxrender import __version__
from jaxrender.errors import InputError

DONE, NOT_CONVERGED, BAD_INPUT, INTERRUPTED, UNREAD = 0, 1, 2, 130, 141

_NAMED = Parameter(negative=())

app = App(
    name="jaxrender",
    help="Recover materials and lighting from photographs of objects of known shape.\n\n"
    "Exit codes: 0 done; 1 not converged or not identifiable (with --strict), or something that "
    "doctor found broken; 2 bad input; 130 interrupted; 141 the output was closed.",
    version=__version__,
    default_parameter=_NAMED,
    result_action="return_value",
    exit_on_error=False,
    suppress_keyboard_interrupt=False,
)


def main(arguments: Sequence[str]) -> int:
    """Run a command line and return its exit code."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    try:
        return app(list(arguments)) or DONE
    except CycloptsError:
        # cyclopts has said what is wrong with the arguments.
        return BAD_INPUT
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return BAD_INPUT
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        return INTERRUPTED
