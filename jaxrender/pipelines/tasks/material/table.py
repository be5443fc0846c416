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

_GROUP = "table"
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
        "sentence": correction.sentence,
    }


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
