"""The only place that knows the optimisation libraries.

Least squares in unconstrained variables by optimistix's Levenberg-Marquardt, its linear algebra by
lineax; the thesis's simplex by optimistix's Nelder-Mead; small box-bounded quadratics by jaxopt's
coordinate descent, imported when a program first needs it, and large ones by active sets, since
descent hardly moves among unknowns that are nearly collinear.
Every function here can be called inside ``jit`` and ``vmap``.
"""

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx

from jaxrender.shapes import Array, Bool, Float, Int

_MAX_STEPS = 64
# The first damping of Levenberg-Marquardt is 1 beside the squared Jacobian.  With residuals this
# much larger it is so slight that even the first steps are those of Gauss and Newton, except along
# directions that the data hardly determine.
_RESIDUAL_UNIT = 1e4
# A search ends when a step moves the variables by less than this, and the residuals in that unit:
# by a few millionths of what is measured.  Rounding of single precision hides that much.
_LAST_STEP = {"float64": 0.03, "float32": 0.3}
# Costs that differ by so many roundings are the same.
_ROUNDINGS = 8
_SIMPLEX_STEPS = 600
_BOX_SWEEPS = 200
# More unknowns than this are not left to coordinate descent.
_FEW = 24
# A walk of active sets has so many turns at most, for each unknown; and its ridge, in roundings.
_TURNS, _RIDGE = 6, 1e5


class Solution(NamedTuple):
    """Where a solver stopped: the point, half the sum of squares there, and whether it may stop.

    ``aux`` is what the residuals came with there.
    """

    point: Float[Array, "unknown"]
    cost: Float[Array, ""]
    converged: Bool[Array, ""]
    steps: Int[Array, ""]
    aux: Any = None


def least_squares(
    residuals: Callable, start: Float[Array, "unknown"], args, *, has_aux: bool = False
) -> Solution:
    """Minimise half the sum of squares of ``residuals(point, args)`` by Levenberg-Marquardt.

    Variables are to be of order one, and so is the sum of squares of what is measured.  Steps
    shrink quadratically: the one after the last would be far shorter than ``_LAST_STEP``.

    With ``has_aux`` the function returns a pair: the residuals, and what is worth keeping of how
    they were made.  Who asks for it need not evaluate the function once more at the end, which
    would make programs longer by a third.
    """
    residuals = residuals if has_aux else _alone(residuals)
    if start.shape[0] == 0:
        return _nothing_to_do(residuals, start, args)
    # Normal equations by Cholesky are ten times faster than QR and lose nothing in float64.
    linear = lx.Normal(lx.Cholesky()) if start.dtype == jnp.float64 else lx.QR()
    last = _LAST_STEP[start.dtype.name]

    def enlarged(point: Float[Array, "unknown"], args):
        left, aux = residuals(point, args)
        return _RESIDUAL_UNIT * left, (left, aux)

    solver = optx.LevenbergMarquardt(rtol=0.0, atol=last, linear_solver=linear)
    found = optx.least_squares(
        enlarged,
        eqx.tree_at(lambda own: own.search, solver, _UpToRounding(solver.search)),
        start,
        args,
        has_aux=True,
        options={"jac": "fwd"},
        max_steps=_MAX_STEPS,
        throw=False,
    )
    # ``found.aux`` is of the step before the last.
    return _solution(found, *found.state.aux)


class _UpToRounding(optx.AbstractSearch):
    """Accept a step that changes the cost by no more than its rounding, too.

    A search ends at a step that was accepted.  At the minimum, rounding decides whether the cost
    falls, and steps would be tried again and again.
    """

    search: optx.AbstractSearch

    def init(self, y, f_info_struct):
        """Begin as the search itself does."""
        return self.search.init(y, f_info_struct)

    def step(self, first_step, y, y_eval, f_info, f_eval_info, state):
        """Accept what the search itself accepts, and what is the same."""
        size, accept, result, state = self.search.step(
            first_step, y, y_eval, f_info, f_eval_info, state
        )
        before, after = f_info.as_min(), f_eval_info.as_min()
        same = jnp.abs(after - before) <= _ROUNDINGS * jnp.finfo(before.dtype).eps * before
        return size, accept | same, result, state


def simplex(
    residuals: Callable,
    start: Float[Array, "unknown"],
    args,
    *,
    has_aux: bool = False,
    tolerance: float = 1e-8,
) -> Solution:
    """Minimise the same by Nelder and Mead's simplex: the thesis's method, and the twin."""
    residuals = residuals if has_aux else _alone(residuals)
    if start.shape[0] == 0:
        return _nothing_to_do(residuals, start, args)
    found = optx.minimise(
        lambda point, args: _half_sum_of_squares(residuals(point, args)[0]),
        optx.NelderMead(rtol=tolerance, atol=tolerance),
        start,
        args,
        max_steps=_SIMPLEX_STEPS,
        throw=False,
    )
    return _solution(found, *residuals(found.value, args))


@jax.jit
def solve_in_box(
    matrix: Float[Array, "unknown unknown"],
    vector: Float[Array, "unknown"],
    lower: Float[Array, "unknown"],
    upper: Float[Array, "unknown"],
) -> Float[Array, "unknown"]:
    """Minimise x' A x / 2 - b' x within a box; differentiable where the active set is constant.

    The unconstrained solution is tried first.  If it leaves the box, coordinate descent finds the
    unknowns at a bound.  The others are solved for with those held.
    """
    # Which are at a bound does not change nearby: without derivatives, programs are much smaller.
    given = jax.lax.stop_gradient((matrix, vector, lower, upper))
    alone = _solve(*given[:2])
    inside = jnp.all((alone >= lower) & (alone <= upper))
    nowhere = jnp.full_like(alone, jnp.nan)
    held = jax.lax.cond(inside, lambda *_: nowhere, _values_held_at_bounds, *given)
    active = ~jnp.isnan(held)
    pinned = jnp.where(active, held, 0)
    identity = jnp.eye(len(vector), dtype=vector.dtype)
    kept = jnp.where(active[:, None] | active[None, :], identity, matrix)
    right = jnp.where(active, pinned, vector - matrix @ pinned)
    # Exactly at the bound, so that whoever asks can see it; the ridge would leave a rounding.
    return jnp.clip(jnp.where(active, pinned, _solve(kept, right)), lower, upper)


def _values_held_at_bounds(matrix, vector, lower, upper) -> Float[Array, "unknown"]:
    """Find which unknowns end at a bound (their value there), NaN for the others."""
    if len(vector) > _FEW:
        return _walked(matrix, vector, lower, upper)
    with warnings.catch_warnings():
        # jaxopt is archived and says so on import; optimistix and lineax take no bounds.
        warnings.simplefilter("ignore", DeprecationWarning)
        import jaxopt
    scale = 1 / jnp.sqrt(jnp.diag(matrix))
    scaled = matrix * scale[:, None] * scale[None, :]
    descent = jaxopt.BoxCDQP(maxiter=_BOX_SWEEPS, tol=1e-10, implicit_diff=False)
    box = (lower / scale, upper / scale)
    start = jnp.clip(jnp.zeros_like(vector), *box)
    best = descent.run(start, params_obj=(scaled, -vector * scale), params_ineq=box).params * scale
    margin = 1e-9 * jnp.maximum(jnp.max(jnp.abs(best)), 1e-30)
    at_lower, at_upper = best <= lower + margin, best >= upper - margin
    return jnp.where(at_lower, lower, jnp.where(at_upper, upper, jnp.nan))


class _Walk(NamedTuple):
    """A point in the box, and which unknowns are held at their lower (-1) or upper (1) bound.

    ``barred`` are those that came back to their bound as soon as they were let go.
    """

    point: Float[Array, "unknown"]
    held: Int[Array, "unknown"]
    barred: Bool[Array, "unknown"]
    done: Bool[Array, ""]
    turn: Int[Array, ""]


def _walked(matrix, vector, lower, upper) -> Float[Array, "unknown"]:
    """Find the same by active sets (Lawson and Hanson 1974; Stark and Parker 1995).

    All begin at their bounds.  The one that gains most is let go, and all that are free move to
    their best as far as the box lets them.  Each turn solves for these once.
    """
    scale = jax.lax.rsqrt(jnp.maximum(jnp.diag(matrix), jnp.finfo(matrix.dtype).tiny))
    epsilon = float(jnp.finfo(matrix.dtype).eps)
    identity = jnp.eye(len(vector), dtype=matrix.dtype)
    # A ridge far below noise, so that columns that are all but the same do not cancel.
    scaled = matrix * scale[:, None] * scale[None, :] + _RIDGE * epsilon * identity
    right, low, high = vector * scale, lower / scale, upper / scale
    gain = epsilon**0.65 * jnp.max(jnp.abs(right))

    def step(now: _Walk) -> _Walk:
        free = now.held == 0
        kept = jnp.where(free[:, None] & free[None, :], scaled, identity)
        pinned = jnp.where(free, 0, now.point)
        there = jnp.where(free, right - scaled @ pinned, now.point)
        best = jax.scipy.linalg.solve(kept, there, assume_a="pos")
        under, over = free & (best < low), free & (best > high)
        outside = under | over
        room = jnp.where(under, low, high) - now.point
        part = jnp.where(outside, room / jnp.where(outside, best - now.point, 1), 1)
        share = jnp.clip(jnp.min(part), 0, 1)
        stopped = outside & (part <= share)
        point = jnp.where(free, now.point + share * (best - now.point), now.point)
        point = jnp.where(stopped & under, low, jnp.where(stopped & over, high, point))
        held = jnp.where(stopped & under, -1, jnp.where(stopped & over, 1, now.held))
        stuck = jnp.any(outside) & (share <= 0)
        moved = jnp.max(jnp.abs(point - now.point)) > epsilon**0.5 * jnp.max(jnp.abs(point))
        barred = jnp.where(stuck, now.barred | stopped, now.barred & ~moved)
        # Let one go where all free unknowns are at their best.
        slope = scaled @ point - right
        wrong = jnp.where((held != 0) & ~barred & (low < high), held * slope, 0)
        worst = jnp.argmax(wrong)
        settled = ~jnp.any(outside)
        loosened = held.at[worst].set(jnp.where(wrong[worst] > gain, 0, held[worst]))
        done = settled & ~(wrong[worst] > gain)
        return _Walk(point, jnp.where(settled, loosened, held), barred, done, now.turn + 1)

    start = jnp.where(jnp.isfinite(low), -1, jnp.where(jnp.isfinite(high), 1, 0))
    point = jnp.where(start < 0, low, jnp.where(start > 0, high, 0))
    begin = _Walk(point, start, start > 1, jnp.asarray(False), jnp.asarray(0))
    most = _TURNS * len(vector)
    end = jax.lax.while_loop(lambda now: ~now.done & (now.turn < most), step, begin)
    return jnp.where(end.held < 0, lower, jnp.where(end.held > 0, upper, jnp.nan))


def _solve(matrix, vector) -> Float[Array, "unknown"]:
    """Solve a small symmetric positive system, scaled so that its units do not matter."""
    scale = jax.lax.rsqrt(jnp.maximum(jnp.diag(matrix), jnp.finfo(matrix.dtype).tiny))
    scaled = matrix * scale[:, None] * scale[None, :]
    # Collinear columns leave pivots of some roundings; Cholesky wants them positive.
    ridge = 8 * jnp.finfo(matrix.dtype).eps * jnp.eye(len(vector), dtype=matrix.dtype)
    return jax.scipy.linalg.solve(scaled + ridge, vector * scale, assume_a="pos") * scale


def _alone(residuals: Callable) -> Callable:
    """Let residuals that come alone come with nothing."""
    return lambda point, args: (residuals(point, args), None)


def _half_sum_of_squares(left: Float[Array, "residual"]) -> Float[Array, ""]:
    return jnp.sum(left**2) / 2


def _solution(found: optx.Solution, left: Float[Array, "residual"], aux) -> Solution:
    point = found.value
    # Asked of the point, not of the cost: who does not need the cost does not pay for it.
    converged = (found.result == optx.RESULTS.successful) & jnp.all(jnp.isfinite(point))
    steps = jnp.asarray(found.stats["num_steps"])
    return Solution(point, _half_sum_of_squares(left), converged, steps, aux)


def _nothing_to_do(residuals: Callable, start: Float[Array, "unknown"], args) -> Solution:
    left, aux = residuals(start, args)
    cost = _half_sum_of_squares(left)
    return Solution(start, cost, jnp.isfinite(cost), jnp.zeros((), int), aux)
