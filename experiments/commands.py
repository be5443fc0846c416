"""Commands of the program, run as a newcomer types them."""

import subprocess
import sys
import time
from pathlib import Path


def run(*command: str | Path) -> float:
    """Run one command in a process of its own, and show it; returns its seconds."""
    print("$ jaxrender", *command, flush=True)
    start = time.perf_counter()
    subprocess.run([sys.executable, "-m", "jaxrender", *map(str, command)], check=True)
    return time.perf_counter() - start
