"""Score tests: how much of what a fit leaves would be explained by relaxing one assumption.

The columns of a cause are derivatives of the prediction by what it assumes.  Of these only the part
counts that the fit's own unknowns cannot make.  With q such columns, and n more values than the fit
has unknowns, the Bayesian information criterion prefers the cause where
n log(squares before / squares after) > q log n.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.shapes import Float

# Columns that others make up to this part of their length, in squares, are none of their own.
_DEPENDENT = 1e-9


class Score(NamedTuple):
    """What a cause explains: squares, by how many columns, and how far parameters would move.

    ``gain`` is by how much the criterion prefers it; ``shift`` is that of the fit's unknowns, and
    ``change`` that of the prediction by them and by the cause together.
    """

    explained: float
    columns: int
    gain: float
    shift: Float[np.ndarray, "unknown"]
    change: Float[np.ndarray, "value"]


class Leftover:
    """What a fit has left, weighted, and the derivatives of its prediction by its unknowns."""

    def __init__(
        self, left: Float[np.ndarray, "value"], jacobian: Float[np.ndarray, "value unknown"]
    ):
        size = np.linalg.norm(jacobian, axis=0)
        size = np.where(size > 0, size, 1)
        scaled = jacobian / size
        # By the Gram matrix: a texture has hundreds of unknowns, whose singular vectors take long.
        squares, turned = np.linalg.eigh(scaled.T @ scaled)
        real = squares > _DEPENDENT * squares.max(initial=0)
        root = np.sqrt(squares[real])
        self._basis = scaled @ (turned[:, real] / root)
        # What unknowns answer to values along each vector of the basis.
        self._answers = turned[:, real] / root / size[:, None]
        self._along = self._basis.T @ left
        # What is dark, and known to be, says nothing: it must not count as a perfect prediction.
        self._count = int(np.count_nonzero(left)) - int(real.sum())
        self.left = left - self._basis @ self._along

    @property
    def answer(self) -> Float[np.ndarray, "unknown"]:
        """How far the fit's unknowns would move to take up all they can."""
        return self._answers @ self._along

    def score(
        self,
        columns: Float[np.ndarray, "value column"],
        typical: Float[np.ndarray, "column"] | None = None,
    ) -> Score:
        """Test one cause, whose columns are weighted alike.

        ``typical`` are amounts that may be expected of each column.  They hold the shift where the
        fit's unknowns can make nearly all of what the cause does.
        """
        expected = np.full(columns.shape[1], np.inf) if typical is None else typical
        size = np.linalg.norm(columns, axis=0)
        columns, expected = (
            columns[:, size > 0] / size[size > 0],
            expected[size > 0] * size[size > 0],
        )
        made = self._basis.T @ columns
        gram = columns.T @ columns - made.T @ made
        values, vectors = np.linalg.eigh(gram) if gram.size else (np.zeros(0), gram)
        real = values > _DEPENDENT
        along = (vectors[:, real].T @ (columns.T @ self.left)) / np.sqrt(values[real])
        held = gram + np.diag(1 / expected**2)
        amounts = np.linalg.pinv(held, _DEPENDENT, hermitian=True) @ (columns.T @ self.left)
        # The prediction is J x + C a: where a comes in, x answers to what C does.
        shift = -self._answers @ (made @ amounts)
        change = columns @ amounts - self._basis @ (made @ amounts)
        return self._scored(float(along @ along), int(real.sum()), shift, change)

    def compared(self, others: "Leftover", unknowns: int) -> Score:
        """Test whether some values are none, as clipped ones are: what do all others leave?

        Those that are none count as ``unknowns`` columns.
        """
        explained = float(self.left @ self.left - others.left @ others.left)
        return self._scored(explained, unknowns, others.answer, np.zeros_like(self.left))

    def _scored(
        self,
        explained: float,
        columns: int,
        shift: Float[np.ndarray, "unknown"],
        change: Float[np.ndarray, "value"],
    ) -> Score:
        # What the fit's own unknowns have taken is no longer free to speak.
        before, count = float(self.left @ self.left), self._count
        if not (explained > 0 and count > 0):
            return Score(0.0, columns, 0.0, np.zeros_like(shift), np.zeros_like(change))
        after = max(before - explained, np.finfo(float).eps * before)
        gain = count * np.log(before / after) - columns * np.log(count)
        return Score(explained, columns, float(gain), shift, change)
