"""BRDFs as tables: measured with a moving source (T 2.1, 6.4.1), and as a correction to a model.

``moving_source``
    photographs under one source each as samples of the BRDF; the fit of T 6.2 to their table
``table``
    means, counts and errors in half-angle coordinates
``correction`` ``cell_sums`` ``smoothness``
    a fitted material times a smooth table; its integral by cells; its prior
"""

from jaxrender.inverse.brdf_table.correction import (
    Correction,
    Prediction,
    check_correctable,
    correct_by_table,
    predict_corrected,
)
from jaxrender.inverse.brdf_table.moving_source import (
    TableFit,
    brdf_samples,
    fit_table,
    table_error,
)
from jaxrender.inverse.brdf_table.table import BRDFSamples, BRDFTable, HalfAngleGrid, tabulate

__all__ = [
    "BRDFSamples",
    "BRDFTable",
    "Correction",
    "HalfAngleGrid",
    "Prediction",
    "TableFit",
    "brdf_samples",
    "check_correctable",
    "correct_by_table",
    "fit_table",
    "predict_corrected",
    "table_error",
    "tabulate",
]
