"""The command line: ``jaxrender fit``, ``batch``, ``render``, ``analyze`` and the other commands.

It sets precision, the compilation cache and logging, and hands files to ``pipelines``.  The
commands import JAX themselves, so that ``--help`` is quick.

``app``
    the application that commands register with, exit codes, ``main``
``reporting``
    the options ``--quiet`` and ``--json`` of every command that takes a while
``process``
    the process of a command: output, bundled examples, JAX, the end
``photographs`` ``captures`` ``sweeps`` ``probes`` ``reflectance`` ``exports`` ``installation``
    the commands: fit, render, view, evaluate, synth, check; import; batch, schema; prefilter,
    analyze, light; measure, compress; export; doctor, demo

Exit codes: 0 done; 1 not converged or not identifiable (with ``--strict``), or something that
``doctor`` found broken; 2 bad input; 130 interrupted; 141 the output was closed.
"""

# To import the commands is to register them.
from jaxrender.cli import (  # noqa: F401
    captures,
    exports,
    installation,
    photographs,
    probes,
    reflectance,
    sweeps,
)
from jaxrender.cli.app import main
from jaxrender.cli.process import console

__all__ = ["console", "main"]
