"""Rows of ``jaxrender.spectra``."""

from . import light, spectrum, transfers

ROWS = [*transfers.ROWS, *spectrum.ROWS, *light.ROWS]

_HOST = "a table, made on the host from whole numbers"
_ORDERS = "counts orders, on the host"
_RULE = "one number on the host: a rule of thumb"
_NODES = "says where nodes are, on which an integral does not depend"
EXCEPTIONS = {
    **dict.fromkeys(
        (
            "clipped_mirror_coefficients",
            "lambertian_transfer",
            "mirror_coefficients",
            "mirror_transfer",
        ),
        _HOST,
    ),
    **dict.fromkeys(("missing_energy", "missing_light", "required_orders"), _ORDERS),
    "residual_bound": _ORDERS,
    "mean_transfer.reach": _NODES,
    "mean_transfer.tail": _NODES,
    "azimuthal_transfer.reach": _NODES,
    "azimuthal_transfer.tail": _NODES,
    "central_spectrum.reach": _NODES,
    "central_spectrum.tail": _NODES,
    **dict.fromkeys(("crossover_exponent", "phong_order", "phong_width"), _RULE),
    "CentralTable": "numbers; tabulated_spectrum has their row",
    "lobe_ringing": "one number, found on the host by looking everywhere",
    "HemisphereRule": "a static rule, whose nodes are made on the host",
    "Orders": "what required_orders gives: whole numbers",
}
