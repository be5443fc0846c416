"""What commands that take a while say of their progress: the options of them all."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cyclopts import Parameter

from jaxrender.errors import InputError

if TYPE_CHECKING:
    from jaxrender.pipelines.progress import Progress


@Parameter(name="*")
@dataclass(frozen=True)
class Reporting:
    """How a command reports its progress."""

    quiet: bool = False
    """Say nothing on the way; errors and the result are still printed."""

    json: bool = False
    """Report progress and errors as lines of JSON on the error output."""

    def progress(self) -> Progress:
        """Choose what gets the stages of a run."""
        from jaxrender.pipelines.progress import choose

        if self.quiet and self.json:
            raise InputError("--quiet and --json ask for two things; give one of them")
        return choose(sys.stderr, self.quiet, self.json)


AS_USUAL = Reporting()
