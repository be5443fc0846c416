"""T table 4.1: nine lighting coefficients of light probes, published and measured.

    python experiments/table_4_1.py grace=PATH/grace_cross.hdr stpeters=PATH/stpeters_cross.hdr

Probes (vertical crosses, or another --convention) belong to their makers and are not part of the
project; names are grace, eucalyptus and stpeters.  The table's values are scaled, by one unknown
factor a probe, which is fitted here; axes are the probe's own.  Demanded: root mean square of the
differences at most .004 (Grace), .0065 (St Peter's).
"""

import argparse
from pathlib import Path

import jax
import numpy as np

from jaxrender.harmonics import analyse
from jaxrender.io import read_environment

HARMONICS = ("00", "1-1", "10", "11", "2-2", "2-1", "20", "21", "22")
CHANNELS = ("red", "green", "blue")
PUBLISHED = {
    "grace": (
        "Grace Cathedral",
        ".79 .44 .54  .39 .35 .60  -.34 -.18 -.27  -.29 -.06 .01  -.11 -.05 -.12  "
        "-.26 -.22 -.47  -.16 -.09 -.15  .56 .21 .14  .21 -.05 -.30",
        0.004,
    ),
    "eucalyptus": (
        "Eucalyptus Grove",
        ".38 .43 .45  .29 .36 .41  .04 .03 .01  -.10 -.10 -.09  -.06 -.06 -.04  "
        ".01 -.01 -.05  -.09 -.13 -.15  -.06 -.05 -.04  .02 -.00 -.05",
        None,
    ),
    "stpeters": (
        "St Peter's Basilica",
        ".36 .26 .23  .18 .14 .13  -.02 -.01 -.00  .03 .02 .01  .02 .01 .00  "
        "-.05 -.03 -.01  -.09 -.08 -.07  .01 .00 .00  -.08 -.06 .00",
        0.0065,
    ),
}
# Printed to two digits: what differs by more than this is no rounding, and stands out by far.
MISPRINT = 0.02


def measured(path: Path, convention: str) -> np.ndarray:
    """Analyse a probe in its own axes, [9, 3]."""
    environment = read_environment(path, convention, axes="probe")
    return np.asarray(analyse(environment.grid, environment.radiance, 2))


def compare(name: str, found: np.ndarray):
    """Print both columns, the scale, the differences and what looks misprinted."""
    title, text, demanded = PUBLISHED[name]
    table = np.array(text.split(), float).reshape(9, 3)
    scale = np.sum(found * table) / np.sum(found**2)
    off = scale * found - table
    print(f"\n{title}: measured times {scale:.5f}")
    print(f"{'':6s}{'published':>21s}{'measured':>27s}{'difference':>27s}")
    for k, harmonic in enumerate(HARMONICS):
        columns = (
            " ".join(f"{value:6.2f}" for value in table[k]),
            " ".join(f"{value:8.4f}" for value in scale * found[k]),
            " ".join(f"{value:8.4f}" for value in off[k]),
        )
        print(f"L{harmonic:5s}{columns[0]:>21s}{columns[1]:>27s}{columns[2]:>27s}")
    rms = np.sqrt(np.mean(off**2))
    verdict = "" if demanded is None else f"; demanded {demanded}: {_met(rms <= demanded)}"
    print(f"root mean square of the differences {rms:.4f}{verdict}")
    for k, channel in np.argwhere(np.abs(off) > MISPRINT):
        print(
            f"misprint: L{HARMONICS[k]} {CHANNELS[channel]} is printed "
            f"{table[k, channel]:.2f}, the probe has {scale * found[k, channel]:.3f}"
        )


def _met(met: bool) -> str:
    return "met" if met else "NOT met"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("probes", nargs="+", metavar="NAME=PATH")
    parser.add_argument("--convention", default="cross")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    for probe in arguments.probes:
        name, _, path = probe.partition("=")
        if name not in PUBLISHED or not path:
            parser.error(f"{probe}: give NAME=PATH with a name of {', '.join(PUBLISHED)}")
        compare(name, measured(Path(path), arguments.convention))


if __name__ == "__main__":
    main()
