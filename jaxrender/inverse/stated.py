"""What is stated of one number of a material: fixed, or free within bounds, maybe with a prior.

``Stated`` is what a user says; ``Unknown`` is what a search makes of it.
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np


class Prior(NamedTuple):
    """What is known of a number beforehand: a normal distribution, in the number's own units."""

    mean: float
    standard_deviation: float


class Unknown(eqx.Module):
    """A parameter: ``fixed`` at a value (one, or one per channel), or free within its bounds.

    A free one may have a ``prior`` besides.
    """

    fixed: tuple[float, ...] | None = eqx.field(static=True, default=None)
    lower: float = eqx.field(static=True, default=0.0)
    upper: float = eqx.field(static=True, default=float("inf"))
    start: float | None = eqx.field(static=True, default=None)
    prior: Prior | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        if not self.lower < self.upper:
            raise ValueError(
                f"bounds [{self.lower}, {self.upper}]: the lower must be below the upper"
            )
        if self.prior is not None:
            self._check_prior(*self.prior)
        if self.start is not None and not self.lower <= self.start <= self.upper:
            raise ValueError(f"start {self.start} is outside [{self.lower}, {self.upper}]")

    @property
    def free(self) -> bool:
        """Whether the parameter is searched for."""
        return self.fixed is None

    def _check_prior(self, mean: float, deviation: float):
        if self.fixed is not None:
            raise ValueError("a fixed value needs no prior; leave one of them out")
        if not self.lower <= mean <= self.upper:
            raise ValueError(f"prior mean {mean:g} is outside [{self.lower}, {self.upper}]")
        if not 0 < deviation < float("inf"):
            raise ValueError(f"prior standard deviation {deviation:g}: give a number above 0")

    def first(self, otherwise: float) -> float:
        """Choose where a search begins: the fixed value, the stated start, or inside the bounds."""
        if self.fixed is not None:
            return float(self.fixed[0])
        otherwise = otherwise if self.prior is None else self.prior.mean
        inside = float(np.clip(otherwise, self.lower, self.upper))
        return inside if self.start is None else self.start


class Stated(NamedTuple):
    """What is stated of one of a model's own numbers: nothing, its value, or where it lies.

    ``fixed`` is one value, or one for each channel; ``bounds`` are the lowest and the highest;
    ``start`` is where the search starts; ``prior`` is what is known of it beforehand.
    """

    fixed: float | tuple[float, ...] | None = None
    bounds: tuple[float, float] | None = None
    start: float | None = None
    prior: Prior | None = None

    def unknown(self, lowest: float, highest: float) -> Unknown:
        """Make the unknown of a search, within these bounds unless stated otherwise."""
        if self.fixed is not None:
            fixed = tuple(float(value) for value in np.atleast_1d(self.fixed))
            return Unknown(fixed=fixed, prior=self.prior)
        low, high = map(float, self.bounds or (lowest, highest))
        start = None if self.start is None else float(self.start)
        prior = None if self.prior is None else Prior(*map(float, self.prior))
        return Unknown(None, low, high, start, prior)
