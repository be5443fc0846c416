"""A BRDF measured with a moving source (T 2.1, 6.4.1): a table, and the model fitted to it.

``moving_source``
    photographs under one source each as samples of the BRDF; the fit of T 6.2 to their table
``table``
    means, counts and errors in half-angle coordinates
"""

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
    "HalfAngleGrid",
    "TableFit",
    "brdf_samples",
    "fit_table",
    "table_error",
    "tabulate",
]
