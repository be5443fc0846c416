"""The light as harmonic coefficients, from photographs of a known material (T 6.4.3, 6.15, 6.16).

Linear least squares in L_lm for l <= l*, from normal equations that are streamed once.  The
cut-off regularises.  l* is given, or ``auto``: the highest degree whose predicted standard error is
below 1/4 of its size.  It depends on roughness (the lobe passes e^-1 of degree 1 / sigma, so l* ~ 1
/ sigma) and on the noise.  What the model leaves unexplained counts as noise.  Options are a
penalty on detail, growing as l(l+1), and non-negative light (``positivity``).

With the operator's transfer ``none`` the result is the light filtered by the lobe; with any other,
the light itself, as far as its degrees go.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.harmonics import LatLongGrid, degrees, real_basis, synthesise
from jaxrender.inverse.lighting.normal_equations import (
    NO_INFORMATION,
    ChannelEquations,
    DegreeReport,
    NormalEquations,
    degree_report,
    noise_variance,
    normal_equations,
)
from jaxrender.inverse.lighting.operator import LightOperator
from jaxrender.inverse.lighting.positivity import (
    CoefficientMisfit,
    Positive,
    hard_positive,
    soft_positive,
)
from jaxrender.lighting import HarmonicLight
from jaxrender.shapes import AnyArray, Float, checked

POSITIVITIES = ("none", "soft", "hard")


class LightSettings(NamedTuple):
    """How a light is recovered; ``penalty`` is relative to what is known of degree 0.

    ``penalty`` p adds p l(l+1) times the information on degree 0 to that on each coefficient.
    ``strength`` is lambda of T 6.24.
    """

    band_limit: int | str = "auto"
    penalty: float = 0.0
    positivity: str = "none"
    strength: float = 1.0


DEFAULT_LIGHT = LightSettings()


class RecoveredLight(NamedTuple):
    """Coefficients with their error bars, and the evidence for each degree.

    Standard errors are infinite for coefficients that the photographs do not determine at all;
    those are 0.  They count the noise, scaled up where the residual exceeds it.  They leave out the
    bias of a cut-off or penalty, and positivity, which can only make them smaller.
    """

    coefficients: Float[np.ndarray, "coefficient channel"]
    standard_errors: Float[np.ndarray, "coefficient channel"]
    covariance: Float[np.ndarray, "channel coefficient coefficient"]
    band_limit: int
    degrees: DegreeReport
    chi_squared: Float[np.ndarray, "channel"]
    reasons: tuple[str, ...]

    @property
    def light(self) -> HarmonicLight:
        """The recovered light as a light like any other."""
        return HarmonicLight(self.coefficients)

    def image(self, height: int) -> Float[np.ndarray, "row column channel"]:
        """Sample it on a latitude-longitude image; unlike an environment it may be negative."""
        return np.asarray(synthesise(LatLongGrid(height, 2 * height), self.coefficients))


@checked
def recover_coefficients(
    operator: LightOperator,
    radiance: Float[AnyArray, "sample channel"],
    weights: Float[AnyArray, "sample channel"] | None = None,
    settings: LightSettings = DEFAULT_LIGHT,
) -> RecoveredLight:
    """Recover L_lm from radiance with weights 1 / noise (``None``: equal, the noise unknown).

    ``auto`` looks for the cut-off up to the operator's band limit.  Raises ``ValueError`` as
    ``solve_coefficients`` and ``normal_equations``.
    """
    equations = normal_equations(operator, radiance, weights)
    return solve_coefficients(equations, settings, noise_known=weights is not None)


def solve_coefficients(
    equations: NormalEquations, settings: LightSettings = DEFAULT_LIGHT, noise_known: bool = True
) -> RecoveredLight:
    """Solve normal equations that were added up before.

    Raises ``ValueError`` for a band limit beyond that of the equations, a negative penalty or
    strength, an unknown positivity, and no measurement at all.
    """
    _check(equations, settings)
    report = degree_report(equations, _penalty(equations, settings.penalty), noise_known)
    band_limit = settings.band_limit
    if band_limit == "auto":
        band_limit = report.recoverable_degree
    assert isinstance(band_limit, int)
    cut = equations.cut(band_limit)
    penalty = _penalty(cut, settings.penalty)
    nodes = _nodes(band_limit) if settings.positivity != "none" else None
    found = [_solve(channel, penalty, noise_known) for channel in cut.channels()]
    coefficients = np.stack([one.light for one in found], axis=1)
    reasons = _reasons(band_limit, settings, report)
    if nodes is not None:
        positive = [_positive(channel, penalty, nodes, settings) for channel in cut.channels()]
        coefficients = np.stack([one.light for one in positive], axis=1)
        if not all(one.converged for one in positive):
            reasons += (f"the {settings.positivity} positivity did not converge",)
    covariance = np.stack([one.covariance for one in found])
    errors = np.stack([_standard_errors(one) for one in found], axis=1)
    chi_squared = np.array(
        [channel.squares(light) for channel, light in zip(cut.channels(), coefficients.T)]
    )
    return RecoveredLight(
        coefficients, errors, covariance, band_limit, report, chi_squared, reasons
    )


class _Solution(NamedTuple):
    light: Float[np.ndarray, "coefficient"]
    covariance: Float[np.ndarray, "coefficient coefficient"]
    unknown: Float[np.ndarray, "coefficient"]


class _Nodes(NamedTuple):
    """Where light is kept from being negative: the harmonics there, and the solid angles."""

    basis: Float[np.ndarray, "node coefficient"]
    solid_angle: Float[np.ndarray, "node"]


def _solve(
    channel: ChannelEquations, penalty: Float[np.ndarray, "coefficient"], noise_known: bool
) -> _Solution:
    """Solve one channel, without the directions that no measurement determines."""
    values, vectors = np.linalg.eigh(channel.gram + np.diag(penalty))
    determined = values > len(penalty) * NO_INFORMATION * values.max()
    inverse = np.where(determined, 1 / np.where(determined, values, 1), 0)
    covariance = (vectors * inverse[None, :]) @ vectors.T
    light = covariance @ channel.moment
    freedom = channel.measured - determined.sum()
    variance = noise_variance(channel.squares(light), freedom, noise_known)
    return _Solution(light, covariance * variance, np.sum(vectors[:, ~determined] ** 2, axis=1))


def _standard_errors(one: _Solution) -> Float[np.ndarray, "coefficient"]:
    # A coefficient that lies in the null space to more than rounding is not known at all.
    return np.where(one.unknown > 1e-6, np.inf, np.sqrt(np.diag(one.covariance)))


def _positive(
    channel: ChannelEquations,
    penalty: Float[np.ndarray, "coefficient"],
    nodes: _Nodes,
    settings: LightSettings,
) -> Positive:
    # A trace of penalty makes the minimum unique where the data are silent.
    floor = NO_INFORMATION * len(penalty) * np.trace(channel.gram)
    misfit = CoefficientMisfit(
        gram=channel.gram + np.diag(penalty + floor),
        moment=channel.moment,
        energy=float(channel.energy),
        measured=float(channel.measured),
        basis=nodes.basis,
        weights=nodes.solid_angle,
    )
    if settings.positivity == "soft":
        return soft_positive(misfit, settings.strength)
    return hard_positive(misfit)


def _penalty(equations: NormalEquations, strength: float) -> Float[np.ndarray, "coefficient"]:
    degree = degrees(equations.band_limit)
    known = float(np.mean(np.asarray(equations.gram)[:, 0, 0]))
    return strength * known * degree * (degree + 1.0)


def _nodes(band_limit: int) -> _Nodes:
    """Make a grid that is fine enough for the harmonics."""
    rows = 2 * (band_limit + 1)
    grid = LatLongGrid(rows, 2 * rows)
    basis = np.asarray(real_basis(grid.directions().reshape(-1, 3), band_limit))
    return _Nodes(basis, grid.weights().ravel())


def _reasons(band_limit: int, settings: LightSettings, report: DegreeReport) -> tuple[str, ...]:
    """Say what limits the light."""
    highest, last = report.recoverable_degree, len(report.size) - 1
    error = report.relative_error
    reasons = [
        f"degree {highest} is the highest that is identifiable: relative standard error "
        f"{100 * error[highest]:.2g} %"
        + (f", {100 * error[highest + 1]:.2g} % one degree further" if highest < last else "")
    ]
    if settings.band_limit == "auto" and highest == last:
        reasons.append(
            f"the cut-off is the highest degree asked for, {last}: higher ones may be too"
        )
    if band_limit > highest:
        lost = np.flatnonzero(error[: band_limit + 1] >= 0.25)
        reasons.append(f"of degree {lost[0]} to {band_limit} there is more noise than light")
    if report.unexplained > 2:
        reasons.append(
            f"the residual is {report.unexplained**0.5:.2g} times the noise: the light has detail "
            "beyond the band limit, or the material is another"
        )
    return tuple(reasons)


def _check(equations: NormalEquations, settings: LightSettings) -> None:
    limit, most = settings.band_limit, equations.band_limit
    if limit != "auto" and not (isinstance(limit, int) and 0 <= limit <= most):
        raise ValueError(
            f"band_limit={limit!r}: give 'auto' or a degree from 0 to {most}, the operator's"
        )
    if settings.penalty < 0 or settings.strength < 0:
        raise ValueError(
            f"penalty={settings.penalty}, strength={settings.strength}: neither may be negative"
        )
    if settings.positivity not in POSITIVITIES:
        raise ValueError(
            f"positivity={settings.positivity!r}: choose one of {', '.join(POSITIVITIES)}"
        )
    if not np.all(np.asarray(equations.measured) > 0) or not np.any(np.asarray(equations.gram)):
        raise ValueError(
            "the equations hold no measurement that light reaches: give samples of weight above 0 "
            "and a material that reflects"
        )
