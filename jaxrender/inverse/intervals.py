"""Values with their 90 % intervals, and what these say: how far they reach, what rests on a prior.

The numbers of a lobe lie above their origins, so their intervals are symmetric in the logarithm of
the distance.
"""

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import jax
import numpy as np

from jaxrender.inverse.parameters import Parameters
from jaxrender.inverse.stated import Prior
from jaxrender.shapes import AnyArray, Float

# Half the width of a 90 % interval of the normal distribution, in standard errors.
NORMAL_90 = 1.6448536269514722
# A parameter is not identifiable when its interval reaches further than this to either side.
IDENTIFIABLE_WITHIN = 0.25
# An interval that reaches beyond this factor above its origin has no end there.
_ENDLESS = 1e4
# An error that the data leave above this part of the prior's is the prior's.
_ALL_BUT = 0.9


class Uncertain(NamedTuple):
    """Values, 90 % intervals (lower and upper) and standard errors of the same parameters.

    What is fixed has a standard error of zero and an interval of its value alone.  ``covariance``
    is that of all of ``Parameters`` one after the other.
    ``disagreement`` is how far two halves of the samples are apart: the chi-squared of the
    difference between what each of them says, over what 99.9 % of halves stay below.  ``origins``
    are what the lobe's numbers lie above; ``ends`` are the bounds of closed numbers, and of those
    that a fit has put at a bound.  ``if_exact`` is the same as it would be if the model were exact,
    where this one knows of misfit.
    """

    value: Parameters
    lower: Parameters
    upper: Parameters
    standard_error: Parameters
    covariance: Float[np.ndarray, "number number"] | None = None
    disagreement: float = 0.0
    origins: Mapping[str, float] = MappingProxyType({})
    ends: Mapping[str, tuple[float, float]] = MappingProxyType({})
    if_exact: "Uncertain | None" = None

    def with_covariance(self, covariance: Float[np.ndarray, "number number"]) -> "Uncertain":
        """Put intervals of another covariance about the same values; these stay as ``if_exact``."""
        error = standard_errors(self.value, covariance)
        found = intervals(self.value, error, self.origins, covariance, self.ends)
        return found._replace(disagreement=self.disagreement, if_exact=self.if_exact or self)

    def summed(self, sums: Mapping[str, tuple[str, ...]]) -> "Uncertain":
        """Add up amplitudes, each sum by its name; those that are in none stay by themselves."""
        if not sums:
            return self
        return self._added({own: name for name, parts in sums.items() for own in parts})

    def only(self, names: Iterable[str]) -> "Uncertain":
        """Keep the amplitudes of these names."""
        left_out = {*self.value.amplitudes} - {*names}
        return self._added(dict.fromkeys(left_out)) if left_out else self

    def _added(self, of: Mapping[str, str | None]) -> "Uncertain":
        """Add amplitudes to those whose names are given; None leaves one out."""
        assert self.covariance is not None
        amplitudes: dict = {}
        for own, amount in self.value.amplitudes.items():
            name = of.get(own, own)
            if name is not None:
                amplitudes[name] = amplitudes.get(name, np.zeros(np.shape(amount))) + amount
        value = self.value._replace(amplitudes=amplitudes)
        rows = {label: row for row, label in enumerate(value.labels)}
        adding = np.zeros((len(rows), len(self.value.labels)))
        for column, label in enumerate(self.value.labels):
            own, bracket, channel = label.partition("[")
            name = of.get(own, own)
            if name is not None:
                adding[rows[f"{name}{bracket}{channel}"], column] = 1
        covariance = adding @ self.covariance @ adding.T
        error = standard_errors(value, covariance)
        found = intervals(value, error, self.origins, covariance, self.ends)
        exact = None if self.if_exact is None else self.if_exact._added(of)
        return found._replace(disagreement=self.disagreement, if_exact=exact)

    def spread_by(self, shifts: Float[np.ndarray, "number cause"]) -> "Uncertain":
        """Let these intervals reach as far as causes shift the values, a column each.

        So do those if the model were exact.
        """
        if self.covariance is None:
            return self
        more = shifts @ shifts.T
        wider, exact = self.with_covariance(self.covariance + more), self.if_exact
        if exact is not None and exact.covariance is not None:
            exact = exact.with_covariance(exact.covariance + more)._replace(if_exact=None)
        return wider._replace(if_exact=exact)


def standard_errors(
    value: Parameters, covariance: Float[np.ndarray, "number number"]
) -> Parameters:
    """Lay standard errors out as the parameters are."""
    leaves, structure = jax.tree.flatten(value)
    errors = np.sqrt(np.maximum(np.diag(covariance), 0))
    parts = np.split(errors, np.cumsum([leaf.size for leaf in leaves])[:-1])
    shaped = [part.reshape(leaf.shape) for part, leaf in zip(parts, leaves)]
    return jax.tree.unflatten(structure, shaped)


def intervals(
    value: Parameters,
    error: Parameters,
    origins: Mapping[str, float],
    covariance: Float[np.ndarray, "number number"] | None = None,
    ends: Mapping[str, tuple[float, float]] = MappingProxyType({}),
) -> Uncertain:
    """Put 90 % intervals about values of known standard error, within the ends of closed ones."""
    low, high = (_bound(value, error, origins, sign) for sign in (-1, 1))
    low, high = (
        bound._replace(numbers={**bound.numbers, **_clipped(bound.numbers, ends)})
        for bound in (low, high)
    )
    return Uncertain(value, low, high, error, covariance, origins=origins, ends=ends)


def _clipped(
    numbers: Mapping[str, Float[AnyArray, "..."]], ends: Mapping[str, tuple[float, float]]
) -> dict[str, Float[AnyArray, "..."]]:
    """Keep numbers between their ends."""
    return {name: np.asarray(np.clip(numbers[name], *both)) for name, both in ends.items()}


def within_reach(uncertain: Uncertain, name: str, beside: Iterable[str] = ()) -> bool:
    """Say whether a parameter's interval lies within 25 % of its value above its origin.

    ``beside`` are amplitudes that count with its own: a base that is all but black is known well
    where it is known to be dark beside the lobe.
    """
    origin = uncertain.origins.get(name, 0.0)
    value, low, high = (
        np.asarray(part.of(name)) - origin
        for part in (uncertain.value, uncertain.lower, uncertain.upper)
    )
    whole = np.abs(value) + sum(float(np.mean(uncertain.value.of(other))) for other in beside)
    reach = IDENTIFIABLE_WITHIN * whole
    return bool(np.all(high - value <= reach) and np.all(value - low <= reach))


def rests_on_prior(uncertain: Uncertain, name: str, prior: Prior | None) -> bool:
    """Say whether the data leave the error of a parameter all but that of its prior."""
    if prior is None:
        return False
    error = np.asarray(uncertain.standard_error.of(name))
    return bool(np.any(error > _ALL_BUT * prior.standard_deviation))


def off_prior(uncertain: Uncertain, name: str, prior: Prior | None) -> float:
    """Say how many standard deviations the data alone put a parameter off its prior.

    The value v and its error e hold both: the data alone differ from the prior's mean m by
    (v - m) / sqrt(p^2 - e^2) standard deviations of the difference, p being the prior's.
    """
    if prior is None:
        return 0.0
    value, error = (
        np.asarray(part.of(name)) for part in (uncertain.value, uncertain.standard_error)
    )
    variance = np.maximum(prior.standard_deviation**2 - error**2, np.finfo(float).tiny)
    return float(np.max(np.abs(value - prior.mean) / np.sqrt(variance)))


def relative_error(uncertain: Uncertain, name: str) -> float:
    """A standard error as a part of the value above its origin, in the worst channel."""
    value = np.asarray(uncertain.value.of(name)) - uncertain.origins.get(name, 0.0)
    error = np.asarray(uncertain.standard_error.of(name))
    return float(np.max(error / np.where(value != 0, np.abs(value), np.nan)))


def _bound(
    value: Parameters, error: Parameters, origins: Mapping[str, float], sign: int
) -> Parameters:
    """Move each value by the 90 % half width, the lobe's numbers by a factor above their origin.

    What the photographs do not bound is infinite, or at the origin.  No amplitude is below zero.
    """
    moved = {}
    for name, centre in value.numbers.items():
        above = centre - origins[name]
        spread = NORMAL_90 * error.numbers[name] / above
        endless = np.inf if sign > 0 else 0.0
        factor = np.exp(sign * np.minimum(spread, np.log(_ENDLESS)))
        factor = np.where(spread < np.log(_ENDLESS), factor, endless)
        moved[name] = np.asarray(origins[name] + above * factor)
    amplitudes = {
        name: np.maximum(centre + sign * NORMAL_90 * error.amplitudes[name], np.minimum(centre, 0))
        for name, centre in value.amplitudes.items()
    }
    gains, scale = (
        getattr(value, name) + sign * NORMAL_90 * getattr(error, name)
        for name in ("gains", "scale")
    )
    return Parameters(amplitudes, moved, gains, scale)
