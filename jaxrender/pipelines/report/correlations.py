"""The table of correlations: which numbers the photographs tell only together."""

from typing import NamedTuple

import numpy as np

from jaxrender.pipelines.report.contents import Contents
from jaxrender.pipelines.report.parameters import model_of
from jaxrender.pipelines.report.wording import MISSING, shown

# From here on a pair is known much better together than each number alone: its error along the
# ellipse is over three times that across.
_TOGETHER = 0.8


class Correlations(NamedTuple):
    """The strongest correlation of each pair of parameters, and what it means."""

    names: tuple[tuple[str, str], ...]
    rows: tuple[tuple[str, ...], ...]
    sentence: str


def correlations(contents: Contents) -> Correlations | None:
    """Pick the strongest over the channels; None where fewer than two parameters were free."""
    given = contents.result.get("correlations")
    if given is None:
        return None
    owners = [number.partition("[")[0] for number in given["numbers"]]
    names, matrix = list(dict.fromkeys(owners)), np.array(given["matrix"], float)
    if len(names) < 2:
        return None
    place = {name: [k for k, own in enumerate(owners) if own == name] for name in names}
    strongest = {
        (one, other): _strongest(matrix[np.ix_(place[one], place[other])])
        for one in names
        for other in names
        if one != other
    }
    rows = tuple(
        tuple(MISSING if one == other else shown(strongest[one, other], 2) for other in names)
        for one in names
    )
    symbols = tuple(_symbol(contents, name) for name in names)
    said = dict(zip(names, ("".join(symbol) for symbol in symbols)))
    pairs = [
        f"{said[one]} and {said[other]}"
        for k, one in enumerate(names)
        for other in names[k + 1 :]
        if abs(strongest[one, other]) >= _TOGETHER
    ]
    told = ", ".join(pairs)
    sentence = (
        f"The photographs tell these pairs much better together than each alone: {told}"
        if pairs
        else "No pair is told much better together than each of its numbers alone"
    )
    return Correlations(symbols, rows, sentence)


def _strongest(block: np.ndarray) -> float:
    return float(block.flat[np.argmax(np.abs(block))])


def _symbol(contents: Contents, name: str) -> tuple[str, str]:
    """Find letter and index of a parameter; the scale of the light has neither."""
    known = {number.name: number for number in model_of(contents).numbers}
    return (known[name].letter, known[name].index) if name in known else (name, "")
