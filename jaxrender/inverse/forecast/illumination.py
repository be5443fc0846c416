"""Which degrees of the light photographs of a known material will identify (T 2.4.2, 6.4.3).

The normal equations are those of ``inverse.lighting``, made from the photographs that a supposed
light would give.  So the singular values are those of its operator, and the recoverable degree is
the cut-off that it would choose.
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxrender.brdf import Glossy, Parametric
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import band_limit_of, coefficient_count
from jaxrender.inverse.forecast.situation import (
    Situation,
    Supposed,
    radiance_of,
    thinned,
    weights_of,
)
from jaxrender.inverse.forecast.spectrum import light_coefficients
from jaxrender.inverse.lighting.normal_equations import (
    DegreeReport,
    NormalEquations,
    degree_report,
    dense_normal_equations,
    normal_equations,
)
from jaxrender.inverse.lighting.operator import degree_slices, light_operator, sizes_by_degree
from jaxrender.inverse.posedness import RECOVERABLE
from jaxrender.reflection import polar_coefficients
from jaxrender.shapes import Float

# The lobe passes e^-4 of this degree times 1 / sigma; the matrix is kept small.
_DEGREE_TIMES_SIGMA, _FEWEST_DEGREES, _MOST_DEGREES = 2.0, 8, 20
_SAMPLES = 4000
# Nodes from the normal to the horizon, where a lobe is integrated: one of .05 radians is followed
# to a per mille at degree 10, one of .1 to a tenth of that at degree 20.
_POLAR_NODES = 64
# A coefficient shows when its singular value is above this part of the strongest.
_SILENT = 1e-6


class LightForecast(NamedTuple):
    """The forecast of each degree of the light; ``size`` is that of the supposed light."""

    report: DegreeReport
    size: Float[np.ndarray, "degree"]
    sentences: tuple[str, ...]

    @property
    def relative_error(self) -> Float[np.ndarray, "degree"]:
        """The standard error of each degree over its supposed size; infinite where it has none."""
        there = self.size > 1e-9 * self.size.max()
        return np.where(there, self.report.noise / np.where(there, self.size, 1), np.inf)

    @property
    def recoverable_degree(self) -> int | None:
        """The highest degree up to which all are identifiable; None where not even the mean is."""
        lost = np.flatnonzero(~(self.relative_error < RECOVERABLE))
        last = int(lost[0]) - 1 if lost.size else len(self.size) - 1
        return None if last < 0 else last

    def singular_values(self, degree: int) -> Float[np.ndarray, "value"]:
        """Those of one degree, all channels, lower degrees projected off."""
        return np.ravel(self.report.singular_values[:, degree_slices(degree)[degree]])


def forecast_light(
    situation: Situation, supposed: Supposed, band_limit: int | None = None
) -> LightForecast:
    """Predict the standard errors of each degree of the light, the material being known.

    All samples of the situation count, as in a recovery; a part of them stands for the others.
    Raises ``ValueError`` for fewer samples than coefficients of degree 0 and 1, and for light that
    differs from photograph to photograph.
    """
    light = situation.light
    if light.varies:
        raise ValueError(
            "the light differs from photograph to photograph: it cannot be recovered as one light"
        )
    brdf, count = supposed.brdf, len(situation.frame)
    wanted = 0
    if np.any(brdf.lobe_amplitude):
        wanted = int(np.ceil(_DEGREE_TIMES_SIGMA / float(brdf.width)))
    limit = band_limit or int(np.clip(wanted, _FEWEST_DEGREES, _MOST_DEGREES))
    while limit > 1 and coefficient_count(limit) > count / 2:
        limit -= 1
    if coefficient_count(limit) > count:
        raise ValueError(f"{count} samples cannot determine light of degree {limit}: use more")
    truth = light_coefficients(light, limit)
    limit = min(limit, band_limit_of(len(truth)))
    few, each = thinned(situation, _SAMPLES)
    weights = np.sqrt(each) * weights_of(supposed.noise, radiance_of(few, supposed))
    equations = _equations(brdf, few.samples, truth, weights)
    report = degree_report(equations, np.zeros(coefficient_count(limit)), True)
    forecast = LightForecast(report, sizes_by_degree(truth), ())
    return forecast._replace(sentences=_sentences(brdf, forecast))


def _equations(
    brdf: Parametric,
    samples: SurfaceSamples,
    truth: Float[np.ndarray, "coefficient channel"],
    weights: Float[np.ndarray, "sample channel"],
) -> NormalEquations:
    """Those of the photographs that a light would give: by frequency, or by the integral."""
    limit = band_limit_of(len(truth))
    if isinstance(brdf, Glossy):
        operator = light_operator(brdf, samples, limit)
        return normal_equations(operator, np.asarray(operator.apply(truth)), weights)
    columns = np.asarray(_under_harmonics(brdf, samples, limit, _POLAR_NODES))
    matrix = np.einsum("skm,kc->csm", columns, np.asarray(brdf.amplitudes))
    return dense_normal_equations(matrix, np.einsum("csm,mc->sc", matrix, truth), weights)


# One program, in the place of one for each of its steps.
_under_harmonics = eqx.filter_jit(polar_coefficients)


def _sentences(brdf: Parametric, forecast: LightForecast) -> tuple[str, ...]:
    last = forecast.recoverable_degree
    limit = len(forecast.size) - 1
    strongest = float(np.max(forecast.report.singular_values))
    silent = [
        degree
        for degree in range(limit + 1)
        if np.min(forecast.singular_values(degree)) < _SILENT * strongest
    ]
    if last == limit:
        found = [f"the light is identifiable to degree {limit}, the highest looked at"]
    elif last is None:
        found = ["not even the mean of the light is identifiable at this noise"]
    else:
        found = [f"the light is identifiable up to degree {last}; beyond, noise is stronger"]
        if not np.any(brdf.lobe_amplitude):
            found[0] += ": a diffuse material passes next to nothing above degree 2 (T 2.65)"
        elif last >= 0.7 / float(brdf.width):
            lobe = "roughness" if isinstance(brdf, Glossy) else "a lobe of width"
            found[0] += f": {lobe} {float(brdf.width):.3g} blurs what is finer"
    if silent:
        listed = ", ".join(map(str, silent[:8])) + (", ..." if len(silent) > 8 else "")
        found.append(f"of degree {listed} some of the light does not show at all in these views")
    return tuple(found)
