"""T 3.2.1 to 3.2.7: the thesis's verification examples, each beside a reference and its source.

    python experiments/verification_3_2.py [--out FOLDER]

Every line is a claim of the section, measured beside a reference value from one of three sources:

``thesis``
    a number that T prints, or a formula of T's that gives one
``ERRATA n``
    the entry that corrects the print or states a number that T does not; where there is one, the
    number that T's own formula gives stands in the last column
``second path``
    the same quantity computed by us on another route (quadrature, sum over nodes, angular sum)

Draws the differences of reference and measurement to ``verification_3_2.png``.
"""

import argparse
import os
from pathlib import Path

import jax
import numpy as np
from verification_examples import (
    Line,
    axial_and_uniform,
    directional,
    lambertian,
    microfacet,
    mirror,
    phong,
)

OUT = Path(__file__).parent / "out"


def print_table(lines: list[Line]):
    print(f"section  {'claim':38s} {'reference':>10s}  {'source':11s}   measured  off    T prints")
    for line in lines:
        printed = "" if line.printed is None else f"{line.printed:10.5f}"
        print(
            f"{line.section:7s}  {line.claim:38s} {line.reference:10.5f}  {line.source:11s}"
            f" {line.measured:10.5f}  {line.difference:.0e}  {printed}"
            f"{'' if line.holds else '  MISSED'}"
        )
    counts = ", ".join(f"{len(own)} {name}" for name, own in by_source(lines).items())
    print(f"{sum(line.holds for line in lines)} of {len(lines)} hold within their rounding")
    print(f"references: {counts}")


def by_source(lines: list[Line]) -> dict[str, list[Line]]:
    """The lines of each kind of source; the entries of ERRATA together."""
    found: dict[str, list[Line]] = {}
    for line in lines:
        kind = "ERRATA" if line.source.startswith("ERRATA") else line.source
        found.setdefault(kind, []).append(line)
    return found


def draw(lines: list[Line], path: Path):
    os.environ.setdefault("MPLBACKEND", "Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(8, 9), layout="constrained")
    place = np.arange(len(lines))[::-1]
    floor = 1e-17
    kinds = by_source(lines)
    for number, (kind, own) in enumerate(kinds.items()):
        rows = [where for where, line in zip(place, lines) if line in own]
        off = [max(line.difference, floor) for line in own]
        axis.barh(rows, off, left=floor, color=f"C{number}", label=f"reference: {kind}")
    axis.plot([line.allowed for line in lines], place, "k|", ms=9, mew=2, label="allowed")
    axis.set(xscale="log", xlim=(floor, 1), xlabel="| reference - measured |")
    axis.set_yticks(place, [f"{line.section}  {line.claim.strip()}" for line in lines], fontsize=7)
    axis.set_title("T 3.2.1 to 3.2.7, verified")
    axis.legend(loc="upper right")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    print(f"written: {path}")


def main():
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    parts = (directional, axial_and_uniform, mirror, lambertian, phong, microfacet)
    lines = [line for part in parts for line in part()]
    print_table(lines)
    draw(lines, arguments.out / "verification_3_2.png")


if __name__ == "__main__":
    main()
