"""The solvers behind the fits.

- A box-bounded quadratic ends where SciPy's ``lsq_linear`` and ``nnls`` end, whatever bounds are
  active, however the unknowns are scaled.
- So does one of many unknowns that are nearly collinear.
- Its derivative is that of the free unknowns alone, right where bounds are active and where not.
- Levenberg-Marquardt ends where SciPy's does; the simplex ends there too.
- jaxopt, which is archived upstream, is imported by nothing but the box-bounded quadratic.
- A search without unknowns is its start; one that runs out of steps says so.
- One that begins at the minimum ends at once, whatever rounding makes of the cost.
"""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares as scipy_least_squares
from scipy.optimize import lsq_linear, nnls

from jaxrender.inverse import solvers

# The box solver's normal equations square the condition (some 10) of these random matrices.
BOX_TOLERANCE = 1e-8
# Where Levenberg-Marquardt stops: its own relative tolerance is 1e-8 of a step.
SEARCH_TOLERANCE = 1e-6
# A simplex is small long before its middle is exact.
SIMPLEX_TOLERANCE = 1e-4


def random_system(seed, rows=12, unknowns=5):
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(rows, unknowns)) * 10.0 ** rng.uniform(-2, 2, unknowns)
    return matrix, rng.normal(size=rows)


def normal_equations(matrix, target):
    return jnp.asarray(matrix.T @ matrix), jnp.asarray(matrix.T @ target)


def in_box(matrix, target, lower, upper):
    normal = normal_equations(matrix, target)
    return np.asarray(
        jax.jit(solvers.solve_in_box)(*normal, jnp.asarray(lower), jnp.asarray(upper))
    )


@pytest.mark.parametrize("seed", range(6))
def test_box_ends_where_scipy_ends(seed):
    matrix, target = random_system(seed)
    free = np.linalg.lstsq(matrix, target, rcond=None)[0]
    # Bounds that cut some of the unconstrained solution off, at either side.
    lower = np.where(np.arange(5) % 2, -np.inf, free - 0.5 * np.abs(free))
    upper = np.where(np.arange(5) % 3, free + np.abs(free), free - 0.3 * np.abs(free))
    lower = np.minimum(lower, upper - 0.1 * np.abs(free))
    expected = lsq_linear(matrix, target, (lower, upper), method="bvls", tol=1e-14).x
    active = np.isclose(expected, lower) | np.isclose(expected, upper)
    assert active.any(), "no bound is active: nothing is tested"
    found = in_box(matrix, target, lower, upper)
    np.testing.assert_allclose(found / np.abs(free), expected / np.abs(free), atol=BOX_TOLERANCE)
    # What is at a bound is exactly there: that is how a fit sees it.
    assert np.all((found >= lower) & (found <= upper))
    np.testing.assert_array_equal((found == lower) | (found == upper), active)


@pytest.mark.parametrize("seed", range(4))
def test_box_ends_where_nnls_ends(seed):
    matrix, target = random_system(seed + 20)
    expected = nnls(matrix, target)[0]
    assert np.any(expected == 0)
    found = in_box(matrix, target, np.zeros(5), np.full(5, np.inf))
    np.testing.assert_allclose(found, expected, atol=BOX_TOLERANCE * np.abs(expected).max())
    assert np.all(found[expected == 0] == 0)


def test_many_collinear_columns_end_where_nnls_ends():
    # Bumps that overlap so much that neighbours are all but the same, of very different heights.
    places = np.linspace(0, 1, 400)
    centres = np.linspace(0, 1, 40)
    matrix = np.exp(-(((places[:, None] - centres) / 0.1) ** 2)) * 10.0 ** np.linspace(-3, 3, 40)
    rng = np.random.default_rng(4)
    target = matrix @ (rng.uniform(size=40) < 0.2) / 10.0**3 + 0.01 * rng.normal(size=400)
    expected = nnls(matrix, target, maxiter=10_000)[0]
    found = in_box(matrix, target, np.zeros(40), np.full(40, np.inf))
    assert 1 < np.count_nonzero(expected) < 39
    np.testing.assert_allclose(matrix @ found, matrix @ expected, atol=1e-8)
    assert np.all(found >= 0)


def test_many_unknowns_end_at_either_bound():
    rng = np.random.default_rng(5)
    matrix, target = rng.normal(size=(80, 36)), 5 * rng.normal(size=80)
    free = np.linalg.lstsq(matrix, target, rcond=None)[0]
    lower, upper = -0.3 * np.abs(free).max() * np.ones(36), 0.2 * np.abs(free)
    lower[::5], upper[1::5], upper[2], lower[2] = -np.inf, np.inf, 0.1, 0.1
    lower = np.minimum(lower, upper)
    expected = lsq_linear(matrix, target, (lower - 1e-12, upper + 1e-12), method="bvls").x
    found = in_box(matrix, target, lower, upper)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert np.any(found == upper)
    assert np.any(found == lower)
    assert found[2] == 0.1


def test_box_without_active_bounds_is_the_plain_solution():
    matrix, target = random_system(3)
    expected = np.linalg.lstsq(matrix, target, rcond=None)[0]
    found = in_box(matrix, target, np.full(5, -np.inf), np.full(5, np.inf))
    np.testing.assert_allclose(found, expected, rtol=BOX_TOLERANCE)


@pytest.mark.parametrize("bound", [0.0, -np.inf])
def test_box_gradient_is_that_of_finite_differences(bound):
    matrix, target = random_system(21)
    normal, right = normal_equations(matrix, target)
    lower, upper = jnp.full(5, bound), jnp.full(5, jnp.inf)
    direction = jnp.asarray(np.random.default_rng(1).normal(size=5)) * jnp.sqrt(jnp.diag(normal))

    @jax.jit
    def along(step):
        return solvers.solve_in_box(normal, right + step * direction, lower, upper)

    _, slope = jax.jvp(along, (0.0,), (1.0,))
    step = 1e-5
    difference = (along(step) - along(-step)) / (2 * step)
    np.testing.assert_allclose(slope, difference, atol=1e-6 * np.abs(difference).max())
    if bound == 0:
        assert np.any(np.asarray(along(0.0)) == 0)
        assert np.any(np.asarray(slope) == 0)


def test_the_package_alone_does_not_import_jaxopt():
    code = "import sys, jaxrender.inverse; sys.exit('jaxopt' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def misfit(point, args):
    x, y = args
    return jnp.exp(-x * jnp.exp(point[0])) + point[1] - y


def curve():
    x = np.linspace(0, 3, 40)
    noise = 0.01 * np.random.default_rng(0).normal(size=40)
    return jnp.asarray(x), jnp.asarray(np.exp(-1.7 * x) + 0.3 + noise)


@pytest.mark.parametrize(
    ("solve", "tolerance"),
    [(solvers.least_squares, SEARCH_TOLERANCE), (solvers.simplex, SIMPLEX_TOLERANCE)],
)
def test_searches_end_where_scipy_ends(solve, tolerance):
    args = curve()
    expected = scipy_least_squares(lambda p: np.asarray(misfit(jnp.asarray(p), args)), [0.0, 0.0])
    found = jax.jit(lambda start: solve(misfit, start, args))(jnp.zeros(2))
    assert bool(found.converged)
    np.testing.assert_allclose(found.point, expected.x, atol=tolerance)
    np.testing.assert_allclose(found.cost, expected.cost, rtol=1e-6)
    assert int(found.steps) > 1


@pytest.mark.parametrize("solve", [solvers.least_squares, solvers.simplex])
@pytest.mark.parametrize("unknowns", [0, 2])
def test_what_residuals_come_with_is_of_the_point_where_the_search_ended(solve, unknowns):
    def with_curve(point, args):
        x, y = args
        at = point if unknowns else jnp.zeros(2)
        curve = jnp.exp(-x * jnp.exp(at[0])) + at[1]
        return curve - y, {"curve": curve}

    args = curve()
    found = jax.jit(lambda start: solve(with_curve, start, args, has_aux=True))(jnp.zeros(unknowns))
    left, there = with_curve(found.point, args)
    np.testing.assert_allclose(found.aux["curve"], there["curve"], rtol=1e-14)
    np.testing.assert_allclose(found.cost, np.sum(np.square(left)) / 2, rtol=1e-12)


def test_single_precision_ends_close_by():
    x, y = curve()
    double = solvers.least_squares(misfit, jnp.zeros(2), (x, y))
    with jax.enable_x64(False):
        single = (jnp.asarray(x, jnp.float32), jnp.asarray(y, jnp.float32))
        found = solvers.least_squares(misfit, jnp.zeros(2), single)
    assert found.point.dtype == jnp.float32
    np.testing.assert_allclose(found.point, double.point, atol=1e-3)


@pytest.mark.parametrize("solve", [solvers.least_squares, solvers.simplex])
def test_nothing_to_search_is_the_start(solve):
    found = solve(lambda point, args: args, jnp.zeros(0), jnp.array([1.0, 2.0]))
    assert found.point.shape == (0,)
    assert float(found.cost) == pytest.approx(2.5)
    assert bool(found.converged)


def test_a_search_that_cannot_end_says_so():
    # exp(-x) has no minimum: the search walks on until its steps are used up.
    found = solvers.least_squares(lambda point, args: jnp.exp(-1e-3 * point), jnp.zeros(1), None)
    assert not bool(found.converged)


def test_a_search_from_the_minimum_ends_at_once():
    def left(point, data):
        return (data[1] - jnp.exp(data[0] @ point)) / np.sqrt(len(data[1]))

    search, steps = jax.jit(lambda start, data: solvers.least_squares(left, start, data)), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        where = rng.uniform(-1, 1, (3000, 2))
        noisy = np.exp(where @ [0.3, 0.5]) * (1 + 0.1 * rng.normal(size=3000))
        data = jnp.asarray(where), jnp.asarray(noisy)
        steps.append(int(search(search(jnp.zeros(2), data).point, data).steps))
    assert max(steps) <= 2
