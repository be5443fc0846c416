"""The page of gradients: every public function by every array argument, at random and at the edges.

    python experiments/gradients.py [PACKAGE] [--exceptions]

For each argument the worst relative difference between its derivative, forward and reverse,
compiled and mapped, and differences of the sixth order, in double and in single precision.  The
rows, and what is asked of them, stand in `tests/gradients/`.  `--exceptions` names what is on no
row, and why.

Exits with 1 where a derivative is wrong or not finite, or a public function is on neither list.
"""

import argparse
import importlib
import math
import sys
from pathlib import Path

import jax

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.gradients import CHAPTERS, DOUBLE, SINGLE, Found, Row, check, unlisted


def page_of(name: str) -> tuple[int, int]:
    """Print a package's rows; return how many lines there are, and how many fail."""
    lines, failing = 0, 0
    chapter = CHAPTERS[name]
    for row in chapter.rows:
        for found in _checked(row):
            mark = " " if found.passes else "*"
            print(
                f"{mark} {name}.{found.function:34s} {found.argument:18s} {found.place:28s}"
                f" {found.double:8.1e} {found.single:8.1e}  {found.note}",
                flush=True,
            )
            lines, failing = lines + 1, failing + (not found.passes)
    for complaint in unlisted(importlib.import_module(f"jaxrender.{name}"), chapter):
        print(f"* {name}: {complaint}")
        failing += 1
    return lines, failing


def _checked(row: Row) -> list[Found]:
    """Check a row; one that cannot even be compiled is a fault like another."""
    try:
        return check(row)
    except (TypeError, ValueError) as error:
        why = f"{type(error).__name__}: {str(error).splitlines()[0]}"
        return [Found(row.name, "", "", math.inf, math.inf, why)]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("package", nargs="?", choices=list(CHAPTERS))
    parser.add_argument("--exceptions", action="store_true", help="what is on no row, and why")
    asked = parser.parse_args()
    names = [asked.package] if asked.package else list(CHAPTERS)
    if asked.exceptions:
        for name in names:
            for function, reason in CHAPTERS[name].exceptions.items():
                print(f"{name}.{function:34s} {reason}")
        return
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_numpy_dtype_promotion", "strict")
    print(f"{'function':46s} {'argument':18s} {'place':28s} {'double':>8s} {'single':>8s}")
    counts = [page_of(name) for name in names]
    lines, failing = (sum(column) for column in zip(*counts))
    print(
        f"{lines} derivatives, {failing} faults; demanded {DOUBLE:g} in double, {SINGLE:g} single"
    )
    sys.exit(failing > 0)


if __name__ == "__main__":
    main()
