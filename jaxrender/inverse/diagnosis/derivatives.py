"""What a fit leaves of some samples, and how its prediction changes with its unknowns.

Of an unknown light most coefficients have a prior.  They are integrated out, and are then noise
that the samples share.  The samples' own weighted noise has the covariance 1.  Let P be the
weighted columns of these unknowns, in standard deviations of their prior.  Then both together have
the covariance 1 + P P'.  What is left and all columns are whitened by it.  The cost depends on the
number of samples, and hardly on that of the coefficients.
"""

import dataclasses
from functools import cached_property
from typing import NamedTuple

import numpy as np

from jaxrender.inverse.elimination import Data
from jaxrender.inverse.models import LinearisedModel
from jaxrender.inverse.parameters import slopes_of_parameters, weighted_jacobian
from jaxrender.inverse.passes import Stop
from jaxrender.inverse.uncertainty import held_at_bounds
from jaxrender.shapes import Bool, Float, Int

# Squares of this part of the largest are rounding.
_NOTHING = 1e-13


@dataclasses.dataclass(frozen=True)
class Derivatives:
    """Weighted residuals and derivatives of the prediction, sample by sample, channel by channel.

    ``residual`` is what is left.  ``by_unknown`` are the derivatives by unknowns without a prior,
    ``weights`` those of the samples.  ``prior`` are the columns of unknowns under a prior, of each
    channel; without channels where there are none.  ``parameters`` are the derivatives of what the
    fit states, by the unknowns without and then by those with a prior, channel by channel.
    """

    residual: Float[np.ndarray, "sample channel"]
    by_unknown: Float[np.ndarray, "sample channel unknown"]
    weights: Float[np.ndarray, "sample channel"]
    prior: tuple[Float[np.ndarray, "sample part"], ...]
    parameters: Float[np.ndarray, "parameter number"]

    @classmethod
    def of(cls, stop: Stop, index: Int[np.ndarray, "sample"]) -> "Derivatives":
        """Differentiate the prediction of some samples where a fit under known light has ended."""
        physical = stop.problem.unknowns.unpack(stop.fit.solution.point)
        near = LinearisedModel.about(stop.model, physical.numbers).take(index)
        data = Data(*(np.asarray(part)[index] for part in stop.data))
        end = stop.fit.solution.point, stop.fit.linear.eliminated
        predicted = np.asarray(stop.fit.predicted)[index]
        weights = np.asarray(data.weights, float)
        # What is at its bound stays there, as for the error bars.
        moves = ~held_at_bounds(stop.problem, stop.fit)
        jacobian = moves * np.asarray(weighted_jacobian(stop.problem, near, data, *end), float)
        parameters = moves * np.asarray(slopes_of_parameters(stop.problem, *end))
        return cls(
            weights * (np.asarray(data.radiance) - predicted),
            jacobian.reshape(*weights.shape, -1),
            weights,
            (),
            parameters,
        )

    @property
    def left(self) -> Float[np.ndarray, "value"]:
        """What is left, white."""
        return self._white(self.residual[:, :, None])[:, 0]

    @cached_property
    def jacobian(self) -> Float[np.ndarray, "value unknown"]:
        """Derivatives of the prediction by the unknowns, white."""
        return self._white(self.by_unknown)

    def weighted(
        self, columns: Float[np.ndarray, "sample channel column"]
    ) -> Float[np.ndarray, "value column"]:
        """Weigh columns, and whiten them."""
        return self._white(self.weights[:, :, None] * columns)

    def expected(self, deviation: Float[np.ndarray, "sample channel"]) -> float:
        """Say what squares noise of a standard deviation would leave."""
        squares = (self.weights * deviation) ** 2
        for shared, of_channel in zip(self._shared, squares.T):
            of_channel -= of_channel * (shared.along**2 @ (1 - shared.kept**2))
        return float(np.sum(squares))

    def without(self, values: Bool[np.ndarray, "sample channel"]) -> "Derivatives":
        """Let some values say nothing."""
        return self._times(np.where(values, 0.0, 1.0))

    def no_surer_than(self, deviation: float) -> "Derivatives":
        """Let no value say more than one of this standard deviation, in radiance, beside its noise.

        Where the model is exactly dark and its noise relative, light would count infinitely.
        """
        return self._times(1 / np.hypot(1, self.weights * deviation))

    def _times(self, factor: Float[np.ndarray, "sample channel"]) -> "Derivatives":
        return dataclasses.replace(
            self,
            residual=factor * self.residual,
            by_unknown=factor[:, :, None] * self.by_unknown,
            weights=factor * self.weights,
            prior=tuple(own[:, None] * part for own, part in zip(factor.T, self.prior)),
        )

    def moved(
        self, shift: Float[np.ndarray, "unknown"], change: Float[np.ndarray, "value"]
    ) -> Float[np.ndarray, "parameter"]:
        """Say how far the parameters move, where the prediction changes and unknowns shift.

        ``change`` is white, without what unknowns under a prior make of it, which answer to it.
        ``shift`` may go on with others' unknowns.
        """
        by_channel = change.reshape(self.weights.shape).T
        answers = [
            -part.T @ shared.white(of_channel)
            for shared, part, of_channel in zip(self._shared, self.prior, by_channel)
        ]
        return self.parameters @ np.concatenate([shift[: self.by_unknown.shape[2]], *answers])

    @cached_property
    def _shared(self) -> tuple["_Shared", ...]:
        return tuple(_Shared.of(part) for part in self.prior)

    def _white(
        self, weighted: Float[np.ndarray, "sample channel column"]
    ) -> Float[np.ndarray, "value column"]:
        if self.prior:
            parts = (one.white(weighted[:, c]) for c, one in enumerate(self._shared))
            weighted = np.stack(list(parts), axis=1)
        return weighted.reshape(self.weights.size, -1)


class _Shared(NamedTuple):
    """Noise that samples share: along which directions, and what whitening keeps of each.

    With P = U S V' the symmetric root of the inverse of 1 + P P' is 1 - U (1 - (1 + S^2)^-1/2) U'.
    U comes from P'P, which is small.  Where S is nothing beside the largest, U is not needed.
    """

    along: Float[np.ndarray, "sample part"]
    kept: Float[np.ndarray, "part"]

    @classmethod
    def of(cls, prior: Float[np.ndarray, "sample part"]) -> "_Shared":
        squares, turned = np.linalg.eigh(prior.T @ prior)
        real = squares > _NOTHING * squares.max(initial=0)
        return cls(
            prior @ (turned[:, real] / np.sqrt(squares[real])), 1 / np.sqrt(1 + squares[real])
        )

    def white(self, values: Float[np.ndarray, "sample *any"]) -> Float[np.ndarray, "sample *any"]:
        """Whiten values, or columns of them."""
        return values - (self.along * (1 - self.kept)) @ (self.along.T @ values)
