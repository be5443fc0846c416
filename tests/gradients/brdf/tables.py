"""Rows of tables and series over two directions."""

import numpy as np

from jaxrender import brdf

from ..page import Above, Row
from ..places import normal
from .pairs import CHANNELS, model

# Cells that the steps from the places of ``pairs`` stay in.
TABLE = np.abs(normal(5, 5, 4, 2))
MEANS_NOTHING = "an angle of the table has a cusp there"

ROWS = [
    model(
        "",
        brdf.IsotropicTable,
        {"values": Above(TABLE)},
        kinks=dict.fromkeys(("head-on", "at the mirror", "coincident"), MEANS_NOTHING),
    ),
    *(
        model(
            reconstruction,
            brdf.PolarIsotropicTable,
            {"values": Above(TABLE)},
            kinks=dict.fromkeys(("head-on", "coincident", "at the mirror"), MEANS_NOTHING),
            reconstruction=reconstruction,
        )
        for reconstruction in ("linear", "b-spline")
    ),
    model(
        "",
        brdf.CorrectedBRDF,
        {"factor": Above(TABLE)},
        kinks=dict.fromkeys(("head-on", "at the mirror", "coincident"), MEANS_NOTHING),
        model=brdf.Phong(CHANNELS["kd"], CHANNELS["ks"], 20.0),
    ),
    model(
        "",
        brdf.PolarNodesTable,
        {"values": Above(np.abs(normal(4, 6, 4, 6, 2)))},
        kinks={"head-on": MEANS_NOTHING},
        largest_polar=1.5,
    ),
    *(
        model(
            reconstruction,
            brdf.TabulatedBRDF,
            {"values": Above(np.abs(normal(4, 4, 4, 4, 2)))},
            kinks={"head-on": "the centre of the square is the corner of four cells"},
            reconstruction=reconstruction,
        )
        for reconstruction in ("linear", "cubic")
    ),
    model("", brdf.ZernikeBRDF, {"coefficients": normal(5, 2)}, order=2),
    Row(
        "TabulatedBRDF.at_places",
        lambda values, incoming, outgoing: brdf.TabulatedBRDF(values).at_places(incoming, outgoing),
        {
            "values": Above(np.abs(normal(4, 4, 4, 4, 2))),
            "incoming": np.array([[0.45, 0.52], [0.7, 0.33]]),
            "outgoing": np.array([[0.42, 0.57], [0.3, 0.44]]),
        },
    ),
]
