"""Tables of a BRDF over two directions as NetCDF files of named arrays, to be used without us.

``brdf`` [kappa_i, lambda_i, kappa_r, lambda_r, channel] is rho in 1/sr at the centres of the cells
of an ``embedding`` of the hemisphere, ``standard_error`` of the same shape where there is one; all
else is attributes, with a sentence for each convention.  A number that is negative or not finite is
no measurement: reading makes it zero and counts it.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrender.geometry import EMBEDDINGS, NUSSELT, Embedding
from jaxrender.io.netcdf import Format, Group, Variable, opened, write
from jaxrender.shapes import Float

FORMAT = Format("jaxrender BRDF table", 1, "jaxrender measure")
DIMENSIONS = ("kappa_i", "lambda_i", "kappa_r", "lambda_r", "channel")

_MEANING = {
    "nusselt": "direction (x, y, z): kappa = (x + 1) / 2, lambda = (y + 1) / 2; cells whose centre "
    "lies outside the disc are no directions",
    "polar": "kappa = polar angle / (pi / 2), lambda = azimuth / (2 pi)",
}
_CONVENTION = (
    "radiance into direction r over irradiance from direction i; local frame, +Z the normal, both "
    "directions away from the surface; sample j of n lies at (j + 1/2) / n"
)

Values = Float[np.ndarray, "kappa_i lambda_i kappa_r lambda_r channel"]


class BRDFTable(NamedTuple):
    """What a file holds."""

    values: Values
    standard_errors: Values | None
    embedding: Embedding = NUSSELT
    masked: int = 0
    """How many numbers were no measurements, and are zero."""
    about: Mapping[str, Any] = {}
    """All other attributes: where the table comes from."""


def write_table(path: str | Path, table: BRDFTable) -> None:
    """Write a table, whole or not at all.

    Raises ``InputError`` where the folder is missing, ``ValueError`` for an empty table and for
    errors of another shape.
    """
    values, errors = np.asarray(table.values), table.standard_errors
    shapes = {array.shape for array in (values, errors) if array is not None}
    if len(shapes) > 1 or min(values.shape) < 1:
        raise ValueError(
            f"values and standard errors of {sorted(shapes)}: give two tables of one shape, no "
            "axis of them empty"
        )
    variables = {"brdf": Variable(DIMENSIONS, values, "1/sr", "BRDF")}
    if errors is not None:
        words = "standard error of the BRDF"
        variables["standard_error"] = Variable(DIMENSIONS, errors, "1/sr", words)
    for name, count in zip(DIMENSIONS[:4], values.shape):
        centres = (np.arange(count) + 0.5) / count
        variables[name] = Variable((name,), centres, "1", f"{name} at the centre of a cell")
    words = {"embedding": table.embedding.name, **_sentences(table.embedding)}
    write(path, FORMAT, Group(variables, {**table.about, **words}))


def read_table(path: str | Path) -> BRDFTable:
    """Read a table as ``write_table`` wrote it.

    Raises ``InputError`` for a file that is missing, damaged, too large or something else.
    """
    floats = (np.float32, np.float64)
    with opened(path, FORMAT) as file:
        embedding = EMBEDDINGS[file.one_of("embedding", EMBEDDINGS)]
        known = {"embedding", *_sentences(embedding)}
        about = {name: value for name, value in file.attributes.items() if name not in known}
        values, errors = file.array("brdf", DIMENSIONS, floats), None
        if "standard_error" in file:
            errors = file.array("standard_error", DIMENSIONS, floats)
            if errors.shape != values.shape:
                file.refuse("`standard_error` has another shape than `brdf`")
    broken = ~(np.isfinite(values) & (values >= 0))
    values[broken] = 0
    return BRDFTable(values, errors, embedding, int(broken.sum()), about)


def _sentences(embedding: Embedding) -> dict[str, str]:
    return {"embedding_meaning": _MEANING[embedding.name], "convention": _CONVENTION}
