"""The command line: ``jaxrender fit | batch | render | synth | prefilter | measure | compress`` ...

It sets precision, the compilation cache and logging, and hands files to ``pipelines``; nothing
else.  JAX and all that imports it are imported inside the commands, so that ``--help`` is quick.

``app``
    the application that commands register with, exit codes, ``main``
``process``
    what a command does to its own process: output, bundled examples, JAX, the end
``photographs`` ``sweeps`` ``probes`` ``reflectance``
    the commands: fit, render, synth; batch, schema; prefilter, analyze; measure, compress

Exit codes: 0 done; 1 ran, but not converged or not identifiable (with ``--strict``); 2 bad input;
130 interrupted; 141 nobody reads the output any more.
"""

# To import the commands is to register them.
from jaxrender.cli import photographs, probes, reflectance, sweeps  # noqa: F401
from jaxrender.cli.app import main
from jaxrender.cli.process import console

__all__ = ["console", "main"]
