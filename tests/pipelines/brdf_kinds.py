"""One material in every kind of file that a BRDF is read from, made by the project's own writers.

Rough facets over diffuse paint, so that small tables hold it to a few per cent.
"""

from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import numpy as np
from small_captures import write_ball, write_json

from jaxrender.brdf import BRDF, Microfacet, RglSize, tabulate, tabulate_rgl
from jaxrender.brdf.compression.squares import Goal
from jaxrender.brdf.tables.polar_nodes import node_directions
from jaxrender.io.alta import AltaMeasurements, write_alta
from jaxrender.io.merl import MerlTable, write_merl
from jaxrender.io.rgl import write_rgl
from jaxrender.io.tables import BRDFTable, write_table
from jaxrender.io.utia import LARGEST_POLAR
from jaxrender.pipelines.compress import compress

NUMBERS = {"kd": [0.2, 0.15, 0.1], "ks": 0.12, "sigma": 0.5, "mu": 1.5}
TRUTH = Microfacet(np.array(NUMBERS["kd"]), np.full(3, NUMBERS["ks"]), 0.5, 1.5, "half", "smith")
evaluate = eqx.filter_jit(BRDF.evaluate)


def _merl(path: Path) -> None:
    write_merl(path, MerlTable.of(TRUTH))


def pairs(count: int = 240) -> tuple[np.ndarray, np.ndarray]:
    """Draw pairs of directions above the horizon."""
    rng = np.random.default_rng(0)
    pair = rng.normal(size=(2, count, 3))
    pair[..., 2] = np.abs(pair[..., 2]) + 0.2
    incoming, outgoing = pair / np.linalg.norm(pair, axis=-1, keepdims=True)
    return incoming, outgoing


def _alta(path: Path) -> None:
    between = pairs()
    write_alta(path, AltaMeasurements(*between, np.asarray(evaluate(TRUTH, *between))))


def _cornell(path: Path) -> None:
    """Write three wavelengths; each holds what all three channels have in the mean."""
    between = pairs()
    gray = np.asarray(evaluate(TRUTH, *between)).mean(axis=1)
    polar = [np.arccos(one[:, 2]) for one in between]
    around = [np.arctan2(one[:, 1], one[:, 0]) % (2 * np.pi) for one in between]
    rows = np.column_stack([polar[0], around[0], polar[1], around[1], gray, gray, gray])
    lines = [" ".join(f"{number:.6f}" for number in row) for row in rows]
    path.write_text("\n".join(["3 450 550 650", *lines]) + "\n")


def _utia(path: Path) -> None:
    nodes = node_directions((6, 48), LARGEST_POLAR).reshape(-1, 3)
    between = np.repeat(nodes, len(nodes), axis=0), np.tile(nodes, (len(nodes), 1))
    values = np.asarray(evaluate(TRUTH, *between))
    path.write_bytes(values.T.astype("<f8").tobytes())


def _rgl(path: Path) -> None:
    write_rgl(path, tabulate_rgl(TRUTH, size=RglSize(8, 64, 32, 17, 24)))


def _table(path: Path) -> None:
    write_table(path, BRDFTable(np.asarray(tabulate(TRUTH, 8, cell_samples=2).values), None))


def _result(path: Path) -> None:
    write_ball(path)
    choices = {"model": "microfacet", "fresnel": "half", "masking": "smith"}
    found = {"task": "brdf", "outcome": "converged", "brdf": choices | NUMBERS}
    write_json(path / "result.json", found)


def _tree(path: Path) -> None:
    table = path.with_name("table.nc")
    if not table.exists():
        _table(table)
    compress(str(table), path, Goal(0.5), size=8, cell_samples=1)


def _half_tree(path: Path) -> None:
    result = path.with_name("result")
    if not result.exists():
        _result(result)
    compress(str(result), path, Goal(0.5), size=16, embedding="half-difference")


# By the name of the file; the model is named by its numbers, in one channel.
KINDS: dict[str, Callable[[Path], None]] = {
    "paint.binary": _merl,
    "paint.alta": _alta,
    "paint.brdf": _cornell,
    "paint.bin": _utia,
    "paint.bsdf": _rgl,
    "table.nc": _table,
    "result": _result,
    "tree.nc": _tree,
    "half.nc": _half_tree,
}
MODEL = "microfacet:sigma=0.5,mu=1.5,kd=0.15,ks=0.12,fresnel=half,masking=smith"


def made(folder: Path, kind: str) -> str:
    """Make a kind in a folder, unless it is there, and return what names it."""
    if kind == MODEL:
        return kind
    if not (folder / kind).exists():
        KINDS[kind](folder / kind)
    return str(folder / kind)
