"""Arrays of ``result.nc`` that several tasks share: samples, and a light."""

import numpy as np

from jaxrender.harmonics import band_limit_of, degrees, orders
from jaxrender.inverse import Observations
from jaxrender.io.netcdf import Group, Variable
from jaxrender.shapes import AnyArray, Float

_DIRECTION, _RADIANCE = ("sample", "component"), ("sample", "channel")
_COEFFICIENT, _SOURCE = ("coefficient", "channel"), ("source", "channel")
# What a light may hold: dimensions, units, meaning.
_LIGHT = {
    "slow": (_COEFFICIENT, "radiance", "coefficients of the slow light"),
    "slow_error": (_COEFFICIENT, "radiance", "standard errors of slow"),
    "total": (_COEFFICIENT, "radiance", "coefficients of slow light and sources together"),
    "direction": (("source", "component"), "1", "unit vector towards each source, world axes"),
    "irradiance": (_SOURCE, "irradiance", "irradiance of each source, facing it"),
    "irradiance_error": (_SOURCE, "irradiance", "standard errors of irradiance"),
    "direction_error": (("source",), "radian", "standard error of each source's direction"),
    "width": (("source",), "radian", "where each source has fallen to 1/e; 0 is a point"),
}


def sample_arrays(
    observations: Observations, predicted: Float[AnyArray, "sample channel"]
) -> dict[str, Variable]:
    """Lay out samples with their measured and predicted radiance."""
    normals, outgoing = observations.samples.normals, observations.samples.outgoing
    return {
        "normal": Variable(_DIRECTION, normals, "1", "surface normal, world axes"),
        "outgoing": Variable(_DIRECTION, outgoing, "1", "unit vector to the camera, world axes"),
        "radiance": Variable(_RADIANCE, observations.radiance, "radiance", "photographed"),
        "predicted": Variable(_RADIANCE, predicted, "radiance", "predicted by the fit"),
        "frame": Variable(("sample",), observations.frame, "1", "number of the photograph"),
    }


def light_group(slow: Float[AnyArray, "coefficient channel"], **more: AnyArray | None) -> Group:
    """Lay out a light by the names of ``_LIGHT``, without arrays that are None or empty."""
    band_limit = band_limit_of(len(slow))
    coefficient = ("coefficient",)
    variables = {
        "degree": Variable(coefficient, degrees(band_limit), "1", "degree of the harmonic"),
        "order": Variable(coefficient, orders(band_limit), "1", "order of the harmonic"),
    }
    for name, values in {"slow": slow, **more}.items():
        if values is not None and np.size(values):
            dimensions, units, meaning = _LIGHT[name]
            variables[name] = Variable(dimensions, values, units, meaning)
    return Group(variables)
