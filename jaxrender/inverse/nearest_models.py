"""Which model is nearest to a BRDF that is a table or a tree: its parameters and what it misses.

A candidate kd + ks f(w_i, w_o; numbers) is fitted to the BRDF's values at pairs of directions by
variable projection (``elimination``), minimising

    int int (rho - model)^2 cos t_i cos t_o dw_i dw_o,

which over Nusselt's squares is the plain mean of squares (L 4.1): pairs are cells of a table, or a
part of them chosen evenly.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF, PARAMETRIC, Parametric, lobe_named
from jaxrender.geometry import NUSSELT, Components
from jaxrender.inverse.elimination import Data, Problem
from jaxrender.inverse.models import Columns, Numbers, Rows
from jaxrender.inverse.search import search
from jaxrender.inverse.unknowns import unknowns_of
from jaxrender.shapes import AnyArray, Float

CANDIDATES = ("microfacet", "ggx", "ward", "phong", "blinn-phong", "torrance-sparrow")
KNOWN = tuple(PARAMETRIC)

_STARTS = 4
_evaluate = eqx.filter_jit(BRDF.evaluate)


class Candidate(NamedTuple):
    """A fitted model; ``relative_rms`` is of what it misses over the BRDF's own."""

    name: str
    brdf: Parametric
    relative_rms: float
    parameters: dict[str, float | list[float]]
    converged: bool


class _Pairs(eqx.Module):
    """The forward model: a BRDF's lobes at pairs of directions."""

    variant: Parametric
    incoming: Float[AnyArray, "sample 3"]
    outgoing: Float[AnyArray, "sample 3"]
    channels: int = eqx.field(static=True)

    def columns(self, numbers: Numbers) -> Columns:
        """Evaluate each lobe in 1/sr."""
        incoming, outgoing = (Components.of(w) for w in (self.incoming, self.outgoing))
        lobes = self.variant.with_numbers(numbers).transfer(incoming, outgoing)
        shape = (len(self.incoming), self.channels)
        values = (jnp.broadcast_to((lobe / incoming.z)[:, None], shape) for lobe in lobes)
        return Columns(*values, shaped=self.variant.shaped())

    def take(self, index: Rows) -> "_Pairs":
        """Keep the pairs of the given indices."""
        pairs = self.incoming[index], self.outgoing[index]
        return _Pairs(self.variant, *pairs, self.channels)


def best_models(
    brdf: BRDF,
    candidates: Sequence[str] = CANDIDATES,
    size: int = 32,
    most_pairs: int = 2**16,
) -> list[Candidate]:
    """Fit each candidate to a BRDF and rank them, the least error first.

    ``size`` is that of the squares whose cells' centres the pairs are, best a tree's or a table's
    own: a Haar tree is a table's value there, and differs between.  Of more than ``most_pairs`` so
    many are taken.  The first fit of a candidate compiles for some seconds.  Raises
    ``ValueError`` for a candidate that there is none of, a size below 2, and a BRDF that is zero or
    not finite there.
    """
    unknown = [name for name in candidates if name not in KNOWN]
    if unknown or not candidates:
        raise ValueError(f"candidates={tuple(candidates)}: choose some of {', '.join(KNOWN)}")
    if size < 2 or most_pairs < 1:
        raise ValueError(f"size={size}, most_pairs={most_pairs}: give at least 2 and 1")
    incoming, outgoing = _pairs_of_cells(size, most_pairs)
    values = np.asarray(_evaluate(brdf, incoming, outgoing), float)
    if not (np.isfinite(values).all() and values.any()):
        raise ValueError("a BRDF that is zero, or not finite, at some cells; mend its values")
    found = [_fitted(name, values, incoming, outgoing) for name in candidates]
    return sorted(found, key=lambda one: one.relative_rms)


def _fitted(
    name: str,
    values: Float[np.ndarray, "sample channel"],
    incoming: Float[np.ndarray, "sample 3"],
    outgoing: Float[np.ndarray, "sample 3"],
) -> Candidate:
    channels = values.shape[1]
    variant = lobe_named(name, channels)
    unknowns = unknowns_of(variant, ks_per_channel=True, expected=False)
    model = _Pairs(variant, incoming, outgoing, channels)
    data = Data(values, np.ones_like(values), np.zeros(len(values), int))
    problem = Problem.of(unknowns, channels)
    fit = search(problem, model, data, unknowns.starts(_STARTS))
    physical = unknowns.unpack(fit.solution.point)
    amplitudes = np.asarray(fit.linear.amplitudes, float)
    numbers = {one.name: float(physical.numbers[one.name]) for one in unknowns.searched}
    brdf = variant.with_numbers(numbers).with_amplitudes(*amplitudes)
    missed = np.sqrt(np.sum((values - np.asarray(fit.predicted)) ** 2) / np.sum(values**2))
    found = zip(variant.amplitude_names, amplitudes)
    parameters: dict[str, float | list[float]] = {name: part.tolist() for name, part in found}
    parameters |= numbers
    return Candidate(name, brdf, float(missed), parameters, bool(fit.solution.converged))


def _pairs_of_cells(
    size: int, most: int
) -> tuple[Float[np.ndarray, "pair 3"], Float[np.ndarray, "pair 3"]]:
    """List the directions of all pairs of cells, or of so many of them, evenly chosen."""
    cells = NUSSELT.cell_directions((size, size)).reshape(-1, 3)
    cells = cells[np.asarray(NUSSELT.covers(NUSSELT.centres((size, size)))).ravel()]
    count = len(cells) ** 2
    chosen = np.arange(count)
    if count > most:
        chosen = np.sort(np.random.default_rng(0).choice(count, most, replace=False))
    return cells[chosen // len(cells)], cells[chosen % len(cells)]
