"""The table that corrects a material: what a result states and keeps of it, and reads again."""

from typing import Any

import numpy as np

from jaxrender.brdf import BRDF, CorrectedBRDF
from jaxrender.geometry import Shape
from jaxrender.inverse.brdf_table import Correction
from jaxrender.io.netcdf import Group, Variable, opened
from jaxrender.pipelines.result import ARRAYS, ARRAYS_FORMAT, FinishedRun
from jaxrender.pipelines.subject import CorrectedSubject, Subject, UniformSubject
from jaxrender.pipelines.tasks.task import material_of_run

# The corrected material as the MERL database writes one.
MERL = "table.binary"
_GROUP = "table"
# A right capture leaves about the noise; so many times the noise is no matter of the material.
_MUCH = 3.0
_COVARIANCE = ("channel", "function", "function_again")
_NODES = ("theta_h", "theta_d", "phi_d", "channel")


def table_document(correction: Correction) -> dict[str, Any]:
    """Lay out what ``result.json`` says of a table."""
    seen = correction.seen
    return {
        "nodes": list(seen.shape),
        "seen": float(np.mean(seen)),
        "prior_deviation": correction.strength,
        "unexplained": correction.unexplained,
        "settled": correction.settled,
        "residual": {
            "relative_rms": correction.after,
            "of_the_model": correction.before,
            "samples": correction.samples,
        },
        "sentence": sentence(correction),
    }


def sentence(correction: Correction) -> str:
    """Say what the table has changed."""
    before, after = 100 * correction.before, 100 * correction.after
    seen = 100 * float(np.mean(correction.seen))
    more = "" if correction.settled else "; its fit had not come to an end"
    if correction.unexplained > _MUCH:
        more += (
            f"; that is {correction.unexplained:.2g} times the noise, so more than the material is "
            "wrong: the capture, the light or the shape"
        )
    return (
        f"the table leaves {after:.2g} % of the radiance unexplained where the model leaves "
        f"{before:.2g} %; the photographs tell {seen:.0f} % of its "
        f"nodes, and the others are filled from the model{more}"
    )


def table_groups(correction: Correction) -> dict[str, Group]:
    """Lay out the factor at all nodes, its errors, and which nodes were seen."""
    variables = {
        "factor": Variable(
            _NODES, np.asarray(correction.brdf.factor), "1", "corrected BRDF over the model"
        ),
        "log_error": Variable(
            _NODES, correction.log_error, "1", "standard error of the logarithm of factor"
        ),
        "seen": Variable(_NODES[:3], correction.seen, "1", "whether photographs tell the factor"),
        "covariance": Variable(
            _COVARIANCE,
            correction.covariance,
            "1",
            "covariance of the weights of the smooth functions that log(factor) is a sum of",
        ),
    }
    return {_GROUP: Group(variables)}


def brdf_of_run(run: FinishedRun) -> BRDF:
    """Make the material of a finished run, corrected by its table where it has one.

    Raises ``InputError`` where it holds none, and where the table has gone or is damaged.
    """
    material = material_of_run(run)
    if "table" not in run.summary:
        return material
    with opened(run.folder / ARRAYS, ARRAYS_FORMAT) as file:
        factor = file.group(_GROUP).array("factor", _NODES)
    return CorrectedBRDF(material, factor)


def subject_of_run(run: FinishedRun, shape: Shape) -> Subject:
    """Make what can be rendered of a finished run."""
    brdf = brdf_of_run(run)
    if isinstance(brdf, CorrectedBRDF):
        with opened(run.folder / ARRAYS, ARRAYS_FORMAT) as file:
            covariance = file.group(_GROUP).array("covariance", _COVARIANCE)
        return CorrectedSubject(brdf, covariance, float(material_of_run(run).width))
    return UniformSubject(material_of_run(run))
