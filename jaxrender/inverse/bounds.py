"""A fit that ended without a specular lobe, or at the bound of a width, is held against a start
from the data.

A search that lost the highlights ends with ks = 0 or with a lobe as wide as allowed, and looks
converged.  So the widths are tried in turn on the same samples, kd and ks at their best for each:
the residual of the diffuse part about the mirror directions chooses among them.  The fit goes on
from the best, and the lower of the two ends is kept.
"""

import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.elimination import cost_at
from jaxrender.inverse.models import Model
from jaxrender.inverse.passes import FitSettings, Stop, descend
from jaxrender.shapes import Float

# Widths that are tried, evenly in the logarithm.
_TRIED = 16
# Less than this part of the cost is no gain.
_GAIN = 1e-6


def checked_at_bound(stop: Stop, model: Model, settings: FitSettings) -> Stop:
    """Keep a fit that ended inside its bounds; else the better of it and one from the data."""
    if not lost(stop):
        return stop
    start = _from_data(stop, model)
    other = descend(stop.problem, model, stop.observations, _begin(stop, start), settings)
    return other if _gains(other, stop, model) else stop


def lost(stop: Stop) -> bool:
    """Whether the lobe of a fit is gone, or its width at a bound."""
    unknowns = stop.problem.unknowns
    if not unknowns.searched:
        return False
    amplitudes = np.asarray(stop.fit.linear.amplitudes)
    gone = any(
        unknowns.amplitudes[at].free and not np.any(amplitudes[at] > 0) for at in unknowns.shaped
    )
    at_bound = dict(zip(unknowns.names, unknowns.at_bound(stop.fit.solution.point)))
    width = unknowns.searched[0].name
    return bool(unknowns[width].free and (gone or at_bound[width]))


def _from_data(stop: Stop, model: Model) -> Float[np.ndarray, "unknown"]:
    """Find the width that explains most of what the diffuse part leaves, the rest as it began."""
    unknowns = stop.problem.unknowns
    points = np.repeat(unknowns.starts(1), _TRIED, axis=0)
    first = unknowns.unpack(jnp.asarray(points[0])).numbers
    width = unknowns.searched[0].name
    low, high = unknowns[width].lower, unknowns[width].upper
    place = unknowns.names.index(width)
    # Not the bounds themselves, where the search variable no longer moves.
    for point, tried in zip(points, np.geomspace(low, high, _TRIED + 2)[1:-1]):
        packed = unknowns.pack({**{n: float(v) for n, v in first.items()}, width: float(tried)})
        point[place] = packed[place]
    costs = [float(cost_at(stop.problem, model, stop.data, jnp.asarray(p))) for p in points]
    return points[int(np.nanargmin(costs))]


def _begin(stop: Stop, start: Float[np.ndarray, "unknown"]):
    return stop.onward(np.asarray(stop.fit.predicted))._replace(starts=start[None])


def _gains(other: Stop, stop: Stop, model: Model) -> bool:
    """Whether another end explains the same data better, weighed as that other end does."""
    costs = [
        float(cost_at(stop.problem, model, other.data, jnp.asarray(end.fit.solution.point)))
        for end in (other, stop)
    ]
    return costs[0] < (1 - _GAIN) * costs[1]
