"""Cells of the shell on pages: their output in one piece, and an error where a command fails.

IPython reads this file as a kernel starts.  Its own ``%%bash`` prints as bytes come, which breaks
lines where they happen to.
"""

import subprocess

from IPython.core.magic import register_cell_magic


@register_cell_magic
def bash(line: str, cell: str) -> None:
    """Run a cell of the shell."""
    done = subprocess.run(["bash", "-euo", "pipefail", "-c", cell], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"exit code {done.returncode}\n{done.stdout}\n{done.stderr}")
    print(done.stdout, end="")
