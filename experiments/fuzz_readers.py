"""Damaged files of every format: is each one read, or refused with the documented error?

    python experiments/fuzz_readers.py [FORMAT ...] [--count 10000] [--first 0]

A child process damages a small file and reads it, thousands of times; it may take 1 GiB beyond what
it holds before, and 5 s of a processor a file, and is started anew where it ends or is ended; what
waits for something ends after a minute.  Demanded: whatever
is not read raises ``InputError`` whose message names the file, can be printed, and is short; no
warning and no ignored error shows.  The line of each failure has the seed that makes it again:
``fuzz_readers.py FORMAT --first SEED --count 1``.  The formats and the damage stand in
`tests/hostile/`.  Exits with 1 where anything else has happened.
"""

import argparse
import faulthandler
import os
import resource
import select
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
os.environ["OPENBLAS_NUM_THREADS"] = "1"
# As the command line has it.
os.environ["JAX_ENABLE_X64"] = "1"

SECONDS, BYTES = 5.0, 2**30
# A child's first file waits for the libraries.
START_SECONDS = 120.0
# On a busy machine a second of a processor takes longer, up to this many.
PATIENCE = 12


class Child:
    """A process that reads damaged files of one format, and ends where one of them ends it."""

    def __init__(self, name: str):
        command = [sys.executable, __file__, name, "--child"]
        # What the libraries print is no result.
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        said = self.answer(START_SECONDS)
        if said != "ready":
            raise SystemExit(f"{name}: the child did not start: {said}")

    def answer(self, seconds: float) -> str:
        """Wait for a line; what happened where none came."""
        assert self.process.stdout is not None
        begun, last = self.spent(), time.monotonic() + PATIENCE * seconds
        while not select.select([self.process.stdout], [], [], 0.2)[0]:
            if self.spent() - begun > seconds or time.monotonic() > last:
                self.end()
                return f"no answer within {seconds:g} s"
        line = self.process.stdout.readline().decode(errors="replace").rstrip("\n")
        if not line:
            return f"the process ended with {self.process.wait()}"
        return line

    def spent(self) -> float:
        """Count the seconds of a processor that the process has taken."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def read(self, seed: int) -> str:
        """Damage and read one file."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(f"{seed}\n".encode())
            self.process.stdin.flush()
        except BrokenPipeError:
            return f"the process ended with {self.process.wait()} after the file before"
        return self.answer(SECONDS)

    def end(self) -> None:
        """Stop the process, whatever it does."""
        self.process.kill()
        self.process.wait()


def serve(name: str) -> None:
    """Be the child: answer each seed on the input with one line."""
    from tests.hostile import SUBJECTS, judged, mutated

    faulthandler.disable()
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    subject = SUBJECTS[name]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / subject.name
        subject.make(path)
        whole = path.read_bytes()
        subject.read(path)
        _limit_memory()
        print("ready", file=answers, flush=True)
        for line in sys.stdin:
            path.write_bytes(mutated(whole, subject.kind, [int(line)]))
            said = judged(subject.read, path).replace("\n", " / ")[:300]
            print(said.encode("ascii", "backslashreplace").decode(), file=answers, flush=True)


def _limit_memory() -> None:
    status = Path("/proc/self/status").read_text().split()
    held = int(status[status.index("VmData:") + 1]) * 1024
    resource.setrlimit(resource.RLIMIT_DATA, (held + BYTES, held + BYTES))


def fuzz(name: str, first: int, count: int) -> Counter[str]:
    """Try one format; print its row, and the first failures of each sort."""
    child, found = Child(name), Counter[str]()
    said: Counter[str] = Counter()
    for seed in range(first, first + count):
        answer = child.read(seed)
        if child.process.poll() is not None:
            child = Child(name)
        if answer in ("read", "refused"):
            found[answer] += 1
            continue
        found["else"] += 1
        sort = answer[:40]
        said[sort] += 1
        if said[sort] <= 3:
            print(f"  {name}, seed {seed}: {answer}", flush=True)
    child.end()
    row = (count, found["read"], found["refused"], found["else"])
    print(f"{name:22s}" + "".join(f"{number:>10d}" for number in row), flush=True)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("formats", nargs="*")
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--child", action="store_true")
    options = parser.parse_args()
    if options.child:
        serve(options.formats[0])
        return 0
    from tests.hostile import SUBJECTS

    unknown = [name for name in options.formats if name not in SUBJECTS]
    if unknown:
        parser.error(f"unknown format {unknown[0]!r}; known are {', '.join(SUBJECTS)}")
    print(f"{'format':22s}{'tried':>10s}{'read':>10s}{'refused':>10s}{'else':>10s}", flush=True)
    names = options.formats or list(SUBJECTS)
    rows = [fuzz(name, options.first, options.count) for name in names]
    return int(any(row["else"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
